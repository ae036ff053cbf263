"""XSPH viscosity: every particle takes a share of its neighbors' mean velocity [macklin2013, eq. 17; monaghan1989].

After the positions have moved, m_i v_i += sum_j k_ij (v_j - v_i) with W_ij at the new positions and one of

    k_ij = c (V_i + V_j) m_i m_j/(m_i + m_j) W_ij       the paper's coefficient c: for equal particles c m V W_ij,
    k_ij = (2 dt/M) mu_ij V_i V_j W_ij                  the liquids' own viscosities, mu_ij their harmonic mean,

M = integral of x^2 W over space, x one coordinate. Both are the same in k_ij and k_ji, so that the momentum stays
to round-off; v_i += c sum_j v_ij W_ij [pbf, eq. 10] has no volume and the wrong sign. The sum is a Laplacian: c is a
kinematic viscosity nu = c M/(2 dt), with M = 5 h^2/72 in 2D and h^2/15 in 3D for Wendland's kernel, h its support. So
a fixed c is thicker in shorter steps and with larger particles, and 0.5 is the largest that never overshoots.

It brakes spin too, as all forces along the difference of the velocities do: a drop that turns alone comes to rest.
With `wall: no_slip` a wall particle takes part with the velocity that makes the wall stand still, as in `viscosity`.
Equations: docs/methods/position_based.md.
"""
import dataclasses
from types import MappingProxyType

from sim.advice import NOTE, Advice, if_zero, shown, smallest
from sim.backend import data_oriented, ti
from sim.effects.effect import SHEARS, Effect
from sim.effects.parts.liquid_viscosity import EXPLICIT_WALL_FACTOR, LiquidViscosity, without_viscosity
from sim.effects.parts.viscous_advice import acting
from sim.fields import Field
from sim.parameters import parameter
from sim.smoothing_kernels import KERNELS

LARGEST = 0.5  # c, at which no velocity overshoots the mean whatever the masses


@dataclasses.dataclass(frozen=True)
class XsphParameters:
    """XSPH viscosity: a share of the neighbors' mean velocity, after the positions have moved."""

    coefficient: float | None = parameter(
        None, minimum=0.0, maximum=LARGEST,
        meaning="share c that is taken in a step, as in the papers; without it that of the liquids' own viscosities")
    wall: str = parameter("no_slip", choices=("no_slip", "free_slip"), meaning="friction at the wall; the papers have "
                                                                               "none")


def kinematic_viscosity(coefficient: float, time_step: float, numerics, dimension: int) -> float:
    """Return the kinematic viscosity, m2/s, that a coefficient stands for in steps of a length, s."""
    return coefficient * _moment(numerics, dimension) / (2.0 * time_step)  # (B9)


def _moment(numerics, dimension: int) -> float:
    """M, the integral of x^2 W, m2."""
    return KERNELS[numerics.kernel].MOMENT[dimension] * (numerics.support_ratio * numerics.particle_spacing) ** 2


@data_oriented
class Xsph(Effect):
    """Velocities drawn to those of the neighbors."""

    name = "xsph"
    Parameters = XsphParameters
    fields = (Field("velocity_change", "vector", "m/s", "what a step of XSPH adds to the velocity"),)
    uses = ("position", "velocity", "volume", "mass", "phase")
    does = frozenset({SHEARS})
    excludes = MappingProxyType({SHEARS: "both apply the shear stress"})

    def __init__(self, parameters, solver):
        super().__init__(parameters, solver)
        self.count, self.kernel, self.search, self.walls = solver.count, solver.kernel, solver.search, solver.walls
        self.pairs, self.wall_pairs = solver.pairs, solver.wall_pairs
        self.physical = parameters.coefficient is None
        self.sticks = parameters.wall == "no_slip"
        self.coefficient = parameters.coefficient or 0.0
        self.liquids = LiquidViscosity(solver)
        self.moment = _moment(solver.settings.numerics, solver.dimension)

    @classmethod
    def idle(cls, parameters, settings) -> str:
        if parameters.coefficient is None:
            return without_viscosity(settings)
        return "" if parameters.coefficient else "its coefficient is 0"

    @classmethod
    def advice(cls, parameters, scales, limits):
        if parameters is None:
            return
        yield from if_zero(cls.name, parameters, "coefficient", "(a pure number)")
        if parameters.coefficient is None:
            yield from acting(cls.name, scales)
        elif parameters.coefficient:
            step = smallest(limits)
            nu = kinematic_viscosity(parameters.coefficient, step, scales.settings.numerics, scales.settings.dimension)
            yield Advice(NOTE, cls.name, f"its coefficient of {parameters.coefficient:g} is a kinematic viscosity of "
                                         f"{shown(nu, 'm2/s')} in steps of {shown(step, 's')}, more in shorter ones")

    @classmethod
    def time_step_limit(cls, parameters, settings) -> float:
        """M rho / (4 mu) of the stiffest liquid, the step in which its viscosity is a coefficient of 0.5: (A4) of
        docs/methods/time_step.md.
        """
        if parameters.coefficient is not None:
            return float("inf")
        moment = _moment(settings.numerics, settings.dimension)
        return min((0.5 * LARGEST * moment * liquid.density / liquid.dynamic_viscosity for liquid in settings.liquids
                    if liquid.dynamic_viscosity > 0.0), default=float("inf"))

    def stable_time_step(self) -> float:
        return self.time_step_limit(self.parameters, self.solver.settings)

    @ti.func
    def _share(self, i, j, dt):
        """k_ij / (m_i W_ij), m^d."""
        share = 0.0
        if ti.static(self.physical):
            mu_i, mu_j = self.liquids.viscosity(i), self.liquids.viscosity(j)
            mean = 2.0 * mu_i * mu_j / ti.max(mu_i + mu_j, 1e-20)
            share = 2.0 * dt / self.moment * mean * self.particles.volume[i] * (
                self.particles.volume[j] / self.particles.mass[i])
        else:
            share = self.coefficient * (self.particles.volume[i] + self.particles.volume[j]) * (  # (B8)
                self.particles.mass[j] / (self.particles.mass[i] + self.particles.mass[j]))
        return share

    @ti.func
    def _wall_share(self, i, b, dt):
        """The same of a wall particle, as liquid of the same kind as i."""
        share = self.coefficient
        if ti.static(self.physical):
            share = 2.0 * dt / self.moment * self.liquids.viscosity(i) * (
                self.particles.volume[i] / self.particles.mass[i])
        return share * self.walls.volume[b]

    @ti.kernel
    def _smooth(self, dt: float):
        for i in range(self.count[None]):
            x, v = self.particles.position[i], self.particles.velocity[i]
            change = v * 0.0
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                j = self.pairs.index[k]
                weight = self.kernel.value(self.search.separation(x, self.particles.position[j]).norm())
                change += (self._share(i, j, dt) * weight) * (self.particles.velocity[j] - v)
            if ti.static(self.sticks):
                depth = self.liquids.depth(i)
                for slot in range(self.wall_pairs.count[i]):
                    k = self.wall_pairs.entry(i, slot)
                    b = self.wall_pairs.index[k]
                    weight = self.kernel.value(self.search.separation(x, self.walls.position[b]).norm())
                    factor = ti.min(self.liquids.wall_factor(depth, b), EXPLICIT_WALL_FACTOR)
                    change -= (self._wall_share(i, b, dt) * weight * factor) * v
            self.particles.velocity_change[i] = change
        for i in range(self.count[None]):
            self.particles.velocity[i] += self.particles.velocity_change[i]

    def finish(self, dt: float) -> None:
        self._smooth(dt)
