"""Explicit viscosity by pair forces, across liquids too, with the harmonic mean of the viscosities.

central    a_i = (V_i/m_i) sum_j 2(d+2) mu_ij V_j (v_ij.x_ij)/r^2 G_ij [monaghan1983], with volumes: conserves
           spin as well as momentum, but on an even lattice it is 10 % too stiff or soft, by the direction of the shear.
laplacian  a_i = (V_i/m_i) sum_j 2 mu_ij V_j (x_ij.G_ij)/r^2 v_ij [morris1997]: exact to 1 % on lattices too,
           but a drop that spins in a thinner liquid is braked.

The step is limited by dx^2 rho / mu: for aqueous or for coarse tests; oil calls for `viscosity_implicit`.
Equations: docs/methods/viscosity.md.
"""
import dataclasses
from types import MappingProxyType

from sim.backend import data_oriented, ti
from sim.effects.effect import RESISTS, SHEARS, Effect
from sim.effects.parts.liquid_viscosity import (
    EXPLICIT_WALL_FACTOR,
    LiquidViscosity,
    explicit_limit,
    without_viscosity,
)
from sim.effects.parts.viscous_advice import (
    IMPLICIT_STEP_COST,
    acting,
    explicit_steps,
    missing,
    rightly_missing,
    viscous_times,
)
from sim.effects.parts.viscous_weights import harmonic_mean
from sim.fields import Field
from sim.parameters import parameter


@dataclasses.dataclass(frozen=True)
class ViscosityParameters:
    """Shear stress within and between liquids, advanced explicitly (step limited by dx^2 rho / mu)."""

    wall: str = parameter("no_slip", choices=("no_slip", "free_slip"), meaning="friction at the wall")
    form: str = parameter("central", choices=("central", "laplacian"),
                          meaning="central pair forces, which keep the spin, or the Laplacian of the velocity, "
                                  "which is more exact on even particle sets")


@data_oriented
class Viscosity(Effect):
    """Viscous pair forces at the start of the step."""

    name = "viscosity"
    Parameters = ViscosityParameters
    fields = (*LiquidViscosity.fields, Field("wall_depth", "scalar", "m", "distance to the wall"))
    uses = ("position", "phase", "velocity", "volume", "mass")
    does = frozenset({SHEARS, RESISTS})
    excludes = MappingProxyType({SHEARS: "both apply the shear stress"})

    def __init__(self, parameters, solver):
        super().__init__(parameters, solver)
        self.central = parameters.form == "central"
        self.unused_hooks = () if parameters.wall == "no_slip" else ("wall_acceleration",)
        self.factor = 2.0 * (solver.dimension + 2.0) if self.central else 2.0
        self.liquids = LiquidViscosity(solver)
        self.growth = solver.particles.arrays.get("growth")  # where liquid is injected
        self.grows = self.growth is not None

    @classmethod
    def idle(cls, parameters, settings) -> str:
        return without_viscosity(settings)

    @classmethod
    def time_step_limit(cls, parameters, settings) -> float:
        """(A4) of docs/methods/time_step.md."""
        return explicit_limit(settings)

    @classmethod
    def advice(cls, parameters, scales, limits):
        if parameters:
            yield from acting(cls.name, scales)
        elif not scales.does(SHEARS):
            yield from rightly_missing(cls.name, scales)
            if explicit_steps(cls.name, scales, limits) <= IMPLICIT_STEP_COST:
                yield from missing(cls.name, scales)

    @classmethod
    def time_scales(cls, parameters, scales):
        return viscous_times(scales)

    def stable_time_step(self) -> float:
        return self.time_step_limit(self.parameters, self.solver.settings)

    def prepare(self, dt: float) -> None:
        self.liquids.measure(self.particles.own_viscosity, self.particles.dynamic_viscosity)
        if not self.unused_hooks:
            self._measure_depth()

    @ti.kernel
    def _measure_depth(self):
        for i in range(self.solver.count[None]):
            self.particles.wall_depth[i] = self.liquids.depth(i)

    @ti.func
    def _acceleration(self, i, mu, v_ij, x_ij, gradient):
        rate = self.factor * mu * self.particles.volume[i] / self.particles.mass[i] / ti.max(
            x_ij.norm_sqr(), 1e-12 * self.solver.spacing**2)
        a = rate * x_ij.dot(gradient) * v_ij  # (V2)
        if ti.static(self.central):
            a = rate * x_ij.dot(v_ij) * gradient  # (V1)
        return a

    @ti.func
    def pair_acceleration(self, i, j, x_ij, gradient, weight):
        mean = self.particles.dynamic_viscosity[i]
        if ti.static(self.liquids.differ or self.liquids.mixes):
            mean = harmonic_mean(mean, self.particles.dynamic_viscosity[j])
        v_ij = self.particles.velocity[i] - self.particles.velocity[j]
        if ti.static(self.grows):
            v_ij -= 0.5 * (self.growth[i] + self.growth[j]) / self.solver.dimension * x_ij  # (V15)
        return self._acceleration(i, mean, v_ij, x_ij, gradient)

    @ti.func
    def wall_acceleration(self, i, b, x_ib, gradient, weight):
        factor = ti.min(self.liquids.wall_factor(self.particles.wall_depth[i], b), EXPLICIT_WALL_FACTOR)
        mu = factor * self.particles.dynamic_viscosity[i]
        return self._acceleration(i, mu, self.particles.velocity[i], x_ib, gradient)
