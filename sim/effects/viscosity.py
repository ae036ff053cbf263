"""Explicit viscosity by central pair forces (Monaghan form, volumes), across liquids too.

a_i = (V_i/m_i) sum_j 2(d+2) mu_ij V_j (v_ij.x_ij)/r^2 G_ij with the harmonic mean of the viscosities. The step is
limited by dx^2 rho / mu: for aqueous or for coarse tests; oil calls for `viscosity_implicit`.
"""
import dataclasses

import taichi as ti

from sim.effects.effect import Effect
from sim.parameters import parameter
from sim.runtime import real


@dataclasses.dataclass(frozen=True)
class ViscosityParameters:
    """Shear stress within and between liquids, advanced explicitly (step limited by dx^2 rho / mu)."""

    wall: str = parameter("no_slip", choices=("no_slip", "free_slip"), meaning="friction at the wall")


@ti.data_oriented
class Viscosity(Effect):
    """Viscous pair forces at the start of the step."""

    name = "viscosity"
    Parameters = ViscosityParameters
    uses = ("velocity", "volume", "mass", "phase")

    def __init__(self, parameters, solver):
        super().__init__(parameters, solver)
        self.factor = 2.0 * (solver.dimension + 2.0)
        self.no_slip = 1.0 if parameters.wall == "no_slip" else 0.0
        self.viscosity = ti.field(real(), shape=len(solver.liquids))
        for k, liquid in enumerate(solver.liquids):
            self.viscosity[k] = liquid.dynamic_viscosity

    @classmethod
    def time_step_limit(cls, parameters, settings) -> float:
        """0.125 dx^2 rho / mu of the stiffest liquid."""
        limits = [0.125 * settings.numerics.particle_spacing**2 * liquid.density / liquid.dynamic_viscosity
                  for liquid in settings.liquids if liquid.dynamic_viscosity > 0.0]
        return min(limits, default=float("inf"))

    def stable_time_step(self) -> float:
        return self.time_step_limit(self.parameters, self.solver.settings)

    @ti.func
    def pair_acceleration(self, i, j, x_ij, gradient, weight):
        mu_i, mu_j = self.viscosity[self.particles.phase[i]], self.viscosity[self.particles.phase[j]]
        mean = 2.0 * mu_i * mu_j / ti.max(mu_i + mu_j, 1e-20)
        v_ij = self.particles.velocity[i] - self.particles.velocity[j]
        r2 = ti.max(x_ij.norm_sqr(), 1e-12 * self.solver.spacing**2)
        return (self.factor * mean * self.particles.volume[i] / self.particles.mass[i] * v_ij.dot(x_ij) / r2) * gradient

    @ti.func
    def wall_acceleration(self, i, b, x_ib, gradient, weight):
        mu = self.no_slip * self.viscosity[self.particles.phase[i]]
        r2 = ti.max(x_ib.norm_sqr(), 1e-12 * self.solver.spacing**2)
        return (self.factor * mu * self.particles.volume[i] / self.particles.mass[i]
                * self.particles.velocity[i].dot(x_ib) / r2) * gradient
