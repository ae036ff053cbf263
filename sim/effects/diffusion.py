"""Diffusion of volume fractions by conservative pair fluxes (S1 Eq. 13, corrected: one coefficient for all liquids).

The volume of liquid k that moves from j to i in one step is q = 2 dt D V_i V_j (alpha_k,i - alpha_k,j)
(x_ij.G_ij)/r^2: antisymmetric, and its sum over k is zero, so every liquid's volume, the sum of the fractions and
each particle's volume are conserved. The factor 2 belongs to the Laplacian. The moved volume carries the mass and
the momentum of its donor. Sub-steps keep each new fraction a convex combination of old ones.
"""
import dataclasses
import math

import numpy as np
import taichi as ti

from sim.effects.effect import Effect
from sim.fields import Field
from sim.parameters import parameter
from sim.runtime import real


@dataclasses.dataclass(frozen=True)
class DiffusionParameters:
    """Mixing of the liquids by diffusion of their volume fractions (S1 Eq. 13, corrected)."""

    coefficient: float = parameter(unit="m**2/s", minimum=0.0, maximum=1e-2, meaning="diffusion coefficient D_m")


@ti.data_oriented
class Diffusion(Effect):
    """Volume fractions that diffuse between liquid particles; none crosses the wall."""

    name = "diffusion"
    Parameters = DiffusionParameters
    fields = (
        Field("volume_fraction", "liquids", "1", "volume fraction of every liquid", carried=True),
        Field("volume_fraction_next", "liquids", "1", "volume fractions after the sub-step"),
        Field("velocity_next", "vector", "m/s", "velocity after the exchange of momentum"),
        Field("exchange_rate", "scalar", "1/s", "sum of the pair coefficients: inverse of the explicit limit"),
    )
    uses = ("position", "velocity", "volume", "mass", "phase")

    def __init__(self, parameters, solver):
        super().__init__(parameters, solver)
        self.coefficient = parameters.coefficient
        self.count, self.pairs, self.kernel = solver.count, solver.pairs, solver.kernel
        self.liquid_count = len(solver.liquids)
        self.density = ti.field(real(), shape=self.liquid_count)
        for k, liquid in enumerate(solver.liquids):
            self.density[k] = liquid.density
        self.largest_rate = ti.field(real(), shape=())
        self.start()

    def start(self) -> None:
        phase = self.solver.particles.to_numpy("phase")
        self.solver.particles.from_numpy("volume_fraction", np.eye(self.liquid_count)[phase])

    @ti.func
    def _coefficient(self, i, k):
        """2 D V_j |W'|/r of pair row entry k, 1/s."""
        j = self.pairs.index[k]
        r = self.solver.search.separation(self.particles.position[i], self.particles.position[j]).norm()
        return (-2.0 * self.coefficient * self.particles.volume[j]) * self.kernel.gradient_factor(r)

    @ti.kernel
    def _measure(self):
        for i in range(self.count[None]):
            total = 0.0
            for k in range(i * self.pairs.width, i * self.pairs.width + self.pairs.count[i]):
                total += self._coefficient(i, k)
            self.particles.exchange_rate[i] = total
        ti.loop_config(serialize=True)
        for _ in range(1):
            largest = 0.0
            for i in range(self.count[None]):
                largest = ti.max(largest, self.particles.exchange_rate[i])
            self.largest_rate[None] = largest

    @ti.kernel
    def _exchange(self, dt: float):
        for i in range(self.count[None]):
            own = self.particles.volume_fraction[i]
            velocity = self.particles.velocity[i]
            change = own * 0.0
            mass_change = 0.0
            momentum = velocity * 0.0  # relative to the particle's own velocity
            for k in range(i * self.pairs.width, i * self.pairs.width + self.pairs.count[i]):
                j = self.pairs.index[k]
                flux = (dt * self._coefficient(i, k)) * (self.particles.volume_fraction[j] - own)
                change += flux
                arriving = 0.0
                for liquid in ti.static(range(self.liquid_count)):
                    moved = self.density[liquid] * flux[liquid]
                    mass_change += moved
                    arriving += ti.max(moved, 0.0)
                momentum += arriving * (self.particles.velocity[j] - velocity)
            volume = self.particles.volume[i]
            self.particles.volume_fraction_next[i] = own + change
            mass = self.particles.mass[i] + volume * mass_change
            self.particles.velocity_next[i] = velocity + volume / mass * momentum
        for i in range(self.count[None]):
            self.particles.volume_fraction[i] = self.particles.volume_fraction_next[i]
            self.particles.velocity[i] = self.particles.velocity_next[i]
            mass = 0.0
            for liquid in ti.static(range(self.liquid_count)):
                mass += self.density[liquid] * self.particles.volume_fraction[i][liquid]
            self.particles.mass[i] = mass * self.particles.volume[i]

    def prepare(self, dt: float) -> None:
        if self.coefficient == 0.0:
            return
        self._measure()
        steps = max(1, math.ceil(dt * self.largest_rate[None]))
        for _ in range(steps):
            self._exchange(dt / steps)
