"""Cohesion: pairwise attraction within a liquid [akinci2013, eq. 1; song, eq. 9] (docs/methods/cohesion.md).

F_ij = -gamma K_ij m_i m_j C(r) e_ij with K_ij = 2/(Gamma_i + Gamma_j), within a liquid; in mixtures gamma becomes
sum gamma_k alpha_k,i alpha_k,j, so that an interface that mixes loses its tension. The spline C attracts beyond
r = 0.27 h and repels below; its 2D form has the same shape, scaled to the same integral over space.

A tension in N/m becomes gamma = sigma / (k a rho^2 h^2). a is what the integral over pairs across a plane gives:
sigma = (pi/8) n^2 int r^4 f dr in 3D and (1/3) n^2 int r^3 f dr in 2D, with f the force of a pair and n the number
density. k is what the pressure jump of drops at rest gives over that, 2.5 to 4.2 in 2D and 2.1 to 3.7 in 3D: the
particles of both liquids order themselves along the interface. So the tension is known to a third only;
`interface_tension` is within 2 %.

At a free surface k is taken as 1, and the tension is known to a factor of two at best. With position-based fluids the
stresses in a flat slab in 2D added up to 0.97 sigma, in one in 3D, 8 dx thick, to 0.18 (it keeps the order of its
lattice); puddles on a floor that does not attract them were as high as with 0.9 sigma in 2D (196 particles, not quite
at rest) and 0.8 sigma in 3D (1500; 0.5 in twice the step); drops in 2D oscillated as with 0.35 to 1.4 sigma, by scheme
and size.

Position-based fluids correct what is too dense only, so that nothing but the step holds the pull of what is stretched:
drops of 200 to 700 particles burst in steps of 1.5 sqrt(rho dx^3/(2 pi sigma)), sigma that of the integral. In steps of
half of it one of 1728 with little viscosity began to spin by itself; the limit is a quarter. With pressures of either
sign a longer step crowds a full cavity to more than twice its density: thin liquids hold in 0.25 of that step in 2D and
in 0.35 in 3D, not in 0.35 and 0.5; the eye with water and oil of 1 Pa s holds in 0.83, not in 0.92.
"""
import dataclasses
import math
from types import MappingProxyType

from sim.advice import if_zero, without_unit
from sim.backend import data_oriented, real, ti
from sim.effects.effect import PULLS, Effect
from sim.effects.parts.same_liquid import Likeness
from sim.parameters import parameter

PLANE = {2: 0.0049222, 3: 0.0029830}  # a (C7): tension of a plane over gamma rho^2 h^2
LARGEST_STEP = 0.25  # over sqrt(rho dx^3/(2 pi sigma))
MEASURED = {2: 3.2, 3: 2.8}  # k: pressure jump of drops over that of the integral


@dataclasses.dataclass(frozen=True)
class CohesionParameters:
    """Pairwise attraction within a liquid (Akinci et al. 2013, eq. 1; Song et al., eq. 9): either gamma or tension."""

    gamma: float | None = parameter(None, unit="N*m**3/kg**2", minimum=0.0, maximum=1e6,
                                    meaning="cohesion coefficient, as in the papers")
    tension: float | None = parameter(None, unit="N/m", minimum=0.0, maximum=1.0,
                                      meaning="tension of the interface, to about a third")

    def coefficients(self, settings) -> list[float]:
        """Return gamma of every liquid.

        In a full cavity the tensions of the two liquids on both sides of an interface add up, so each has half; k is
        that of an interface between two liquids, and 1 at a free surface.
        """
        if self.tension is None:
            return [self.gamma] * len(settings.liquids)
        support = settings.numerics.support_ratio * settings.numerics.particle_spacing
        share = 0.5 / MEASURED[settings.dimension] if settings.closed else 1.0
        scale = PLANE[settings.dimension] * support**2
        return [share * self.tension / (scale * liquid.density**2) for liquid in settings.liquids]  # (C6)


def _check_strength(parameters):
    if (parameters.gamma is None) == (parameters.tension is None):
        given = "neither gamma nor tension" if parameters.gamma is None else "both gamma and tension"
        yield ("effects", "cohesion"), f"gives {given}, but needs one of the two"


@data_oriented
class Cohesion(Effect):
    """Attraction between particles of the same liquid."""

    name = "cohesion"
    Parameters = CohesionParameters
    uses = ("mass", "phase", "compression_rate")
    excludes = MappingProxyType({PULLS: "both pull the interface together"})
    checks = (_check_strength,)

    def __init__(self, parameters, solver):
        super().__init__(parameters, solver)
        self.gamma = ti.field(real(), shape=len(solver.liquids))
        for k, gamma in enumerate(parameters.coefficients(solver.settings)):
            self.gamma[k] = gamma
        self.likeness = Likeness(solver)
        self.support = solver.support_radius
        self.scale = {2: 12.83 / self.support**2, 3: 32.0 / (math.pi * self.support**3)}[solver.dimension]

    @classmethod
    def idle(cls, parameters, settings) -> str:
        return "" if any(parameters.coefficients(settings)) else "its coefficient is 0"

    @classmethod
    def pulls(cls, parameters) -> bool:
        return bool(parameters.tension or parameters.gamma)

    @classmethod
    def advice(cls, parameters, scales, limits):
        if parameters:
            yield from if_zero(cls.name, parameters, "gamma", "N m3/kg2")
            yield from if_zero(cls.name, parameters, "tension", "N/m")
            yield from without_unit(cls.name, parameters, "gamma")

    @classmethod
    def wave_speeds(cls, parameters, scales):
        support = scales.settings.numerics.support_ratio * scales.spacing
        gamma = max(parameters.coefficients(scales.settings))
        yield math.sqrt(0.06 * gamma * scales.density * support)

    def expected_speeds(self):
        gammas, liquids = self.parameters.coefficients(self.solver.settings), self.solver.liquids
        strongest = max(gamma * liquid.density for gamma, liquid in zip(gammas, liquids, strict=True))
        yield math.sqrt(0.06 * strongest * self.support)  # its inner pressure is some 0.03 gamma rho^2 h

    @classmethod
    def time_step_limit(cls, parameters, settings) -> float:
        """Capillary limit of the stiffest liquid: (A5) of docs/methods/time_step.md."""
        numerics = settings.numerics
        area = (numerics.support_ratio * numerics.particle_spacing) ** 2
        return min((LARGEST_STEP * math.sqrt(numerics.particle_spacing**3 / (
            2.0 * math.pi * PLANE[settings.dimension] * gamma * liquid.density * area)) for gamma, liquid in zip(
                parameters.coefficients(settings), settings.liquids, strict=True) if gamma), default=float("inf"))

    def stable_time_step(self) -> float:
        return self.time_step_limit(self.parameters, self.solver.settings)

    @ti.func
    def spline(self, r):
        """C(r), 1/m^d."""
        q = ti.min(r / self.support, 1.0)
        product = (1.0 - q) ** 3 * q**3
        return self.scale * ti.select(q > 0.5, product, 2.0 * product - 1.0 / 64.0)  # (C2)

    @ti.func
    def pair_acceleration(self, i, j, x_ij, gradient, weight):
        r = ti.max(x_ij.norm(), 1e-6 * self.support)
        correction = 2.0 / (self.particles.compression_rate[i] + self.particles.compression_rate[j])
        strength = self.likeness.weighted(i, j, self.gamma) * correction * self.particles.mass[j]  # (C1)
        return (-strength * self.spline(r) / r) * x_ij
