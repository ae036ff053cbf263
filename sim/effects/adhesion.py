"""Adhesion: attraction of a liquid to the wall [akinci2013, eq. 6; pbf, eq. 14] (docs/methods/cohesion.md).

F_ib = -beta m_i psi_b A(r) e_ib with psi_b = rho_i V_b, the mass that the wall particle would have as liquid. A acts
between half the support radius and all of it: nearer particles are left to the pressure. Its 2D form has the same
shape, scaled to the same integral over space. The wall is held in place and takes up the momentum.

What a drop at the wall does depends on the liquids' difference in cohesion and adhesion, not on a contact angle that
was asked for: for that there is `interface_tension`.
"""
import dataclasses
from types import MappingProxyType

from sim.advice import if_zero, without_unit
from sim.backend import data_oriented, ti
from sim.effects.effect import PULLS, Effect
from sim.effects.parts.same_liquid import Likeness
from sim.parameters import parameter


@dataclasses.dataclass(frozen=True)
class AdhesionParameters:
    """Attraction of a liquid to the wall (Akinci et al. 2013, eq. 6)."""

    beta: float = parameter(unit="N*m**3/kg**2", minimum=0.0, maximum=1e6, meaning="adhesion coefficient")
    liquid: str | None = parameter(None, liquid=True, meaning="the liquid that the wall attracts; all without it")


@data_oriented
class Adhesion(Effect):
    """Attraction of particles to the wall."""

    name = "adhesion"
    Parameters = AdhesionParameters
    uses = ("phase", "mass", "volume")
    excludes = MappingProxyType({PULLS: "its contact angle says how the wall is wetted"})

    def __init__(self, parameters, solver):
        super().__init__(parameters, solver)
        self.beta = parameters.beta
        names = [liquid.name for liquid in solver.liquids]
        self.liquid = -1 if parameters.liquid is None else names.index(parameters.liquid)
        self.likeness = Likeness(solver)
        self.support, self.walls = solver.support_radius, solver.walls
        self.scale = {2: 0.01083 / self.support**2, 3: 0.007 / self.support**3}[solver.dimension]

    @classmethod
    def idle(cls, parameters, settings) -> str:
        return "" if parameters.beta else "its beta is 0 N m3/kg2"

    @classmethod
    def advice(cls, parameters, scales, limits):
        if parameters:
            yield from if_zero(cls.name, parameters, "beta", "N m3/kg2")
            yield from without_unit(cls.name, parameters, "beta")

    @ti.func
    def spline(self, r):
        """A(r), 1/m^d."""
        q = r / self.support
        inside = ti.max(-4.0 * q * q + 6.0 * q - 2.0, 0.0)  # positive between h/2 and h
        return self.scale * ti.sqrt(ti.sqrt(inside))  # (C5)

    @ti.func
    def wall_acceleration(self, i, b, x_ib, gradient, weight):
        r = ti.max(x_ib.norm(), 1e-6 * self.support)
        density = self.particles.mass[i] / self.particles.volume[i]
        share = 1.0
        if ti.static(self.liquid >= 0):
            share = self.likeness.share(i, self.liquid)
        return (-self.beta * share * density * self.walls.volume[b] * self.spline(r) / r) * x_ib  # (C4)
