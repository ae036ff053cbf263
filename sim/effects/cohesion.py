"""Cohesion: pairwise attraction within a liquid (Akinci et al. 2013; S1 Eq. 9).

F_ij = -gamma K_ij m_i m_j C(r) e_ij with K_ij = 2/(Gamma_i + Gamma_j). The spline C attracts beyond r = 0.27 h and
repels below; its 2D form has the same shape, scaled to the same integral over space.
"""
import dataclasses
import math

import taichi as ti

from sim.effects.effect import Effect
from sim.parameters import parameter


@dataclasses.dataclass(frozen=True)
class CohesionParameters:
    """Pairwise attraction within a liquid (Akinci et al. 2013; S1 Eq. 9)."""

    gamma: float = parameter(unit="N*m**3/kg**2", minimum=0.0, maximum=1e6, meaning="cohesion coefficient")


@ti.data_oriented
class Cohesion(Effect):
    """Attraction between particles of the same liquid."""

    name = "cohesion"
    Parameters = CohesionParameters
    uses = ("mass", "phase", "compression_rate")

    def __init__(self, parameters, solver):
        super().__init__(parameters, solver)
        self.gamma = parameters.gamma
        self.support = solver.support_radius
        self.scale = {2: 12.83 / self.support**2, 3: 32.0 / (math.pi * self.support**3)}[solver.dimension]

    @ti.func
    def spline(self, r):
        """C(r), 1/m^d."""
        q = ti.min(r / self.support, 1.0)
        product = (1.0 - q) ** 3 * q**3
        return self.scale * ti.select(q > 0.5, product, 2.0 * product - 1.0 / 64.0)

    @ti.func
    def pair_acceleration(self, i, j, x_ij, gradient, weight):
        r = ti.max(x_ij.norm(), 1e-6 * self.support)
        same = ti.select(self.particles.phase[i] == self.particles.phase[j], 1.0, 0.0)
        correction = 2.0 / (self.particles.compression_rate[i] + self.particles.compression_rate[j])
        return (-self.gamma * same * correction * self.particles.mass[j] * self.spline(r) / r) * x_ij
