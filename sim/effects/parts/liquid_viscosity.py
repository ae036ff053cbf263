"""Viscosity of the liquid or mixture at a particle, and its friction at a wall: shared by both viscosities.

A drop moves as the liquid around it allows: its drag lies between 4 and 6 pi mu R U, with mu that of the liquid around
[hadamard1911; rybczynski1911]. In a drop of one or two particles nothing can circulate, and with the harmonic mean of
two viscosities it would slip through a stiff liquid as if that were thin. So a particle that is alone in a more
viscous liquid is given the viscosity of what surrounds it. The wall counts as its like: a film on it slides.

A contact line rolls over the wall in a corner that is not resolved; particles at rest on the wall would hold it twice
as hard as the corner does [cox1986]. So the wall holds those that see the other liquid less, by a share that gives the
line its speed (study `validation`, family `contact_line`), or not at all, where the friction of the corner takes its
place (``sim.effects.parts.line_friction``). Equations: docs/methods/viscosity.md.
"""

from sim.backend import data_oriented, real, ti
from sim.fields import Field

ALONE, AMONG = 0.2, 0.4  # share of its like around a particle: that of one alone, and one as at an interface (0.4-0.7)

AT_LINE = 0.1  # share of the other liquid around a particle from which on it is at the contact line
LEAST_GRIP = 0.1  # least share of the wall's friction there, for supports below 2.2 spacings

EXPLICIT_WALL_FACTOR = 3.0  # largest one that an explicit step takes: more would ask for shorter steps


def without_viscosity(settings) -> str:
    """Why no viscous force acts in a scene; empty where some does."""
    return "" if any(liquid.dynamic_viscosity for liquid in settings.liquids) else (
        "the dynamic viscosity of every liquid is 0 Pa s")


def explicit_limit(settings) -> float:
    """Time step of an explicit viscous force, 0.125 dx^2 rho / mu of the stiffest liquid, s: (A4) of
    docs/methods/time_step.md.
    """
    limits = [0.125 * settings.numerics.particle_spacing**2 * liquid.density / liquid.dynamic_viscosity
              for liquid in settings.liquids if liquid.dynamic_viscosity > 0.0]
    return min(limits, default=float("inf"))


def grip_at_line(support_ratio: float) -> float:
    """Share of the wall's friction at a contact line, for a support over the particle spacing (V12).

    Chosen for 2.5 and 3: the wider the support, the wider is the strip next to the line that is held less.

    >>> [grip_at_line(ratio) for ratio in (2.0, 2.5, 2.75, 3.0, 4.0)]
    [0.1, 0.25, 0.375, 0.5, 1.0]
    """
    return min(max(0.5 * support_ratio - 1.0, LEAST_GRIP), 1.0)


@data_oriented
class LiquidViscosity:
    """Dynamic viscosities of the particles of a solver; an effect that measures them declares `fields`.

    Parameters
    ----------
    corner : whether the friction of the corner holds a contact line, and the wall does not.
    """

    fields = (
        Field("own_viscosity", "scalar", "Pa s", "viscosity of the particle's liquid or mixture"),
        Field("dynamic_viscosity", "scalar", "Pa s", "the same, or that of its surroundings where it is alone in them"),
    )

    def __init__(self, solver, corner: bool = False):
        self.count, self.pairs, self.wall_pairs = solver.count, solver.pairs, solver.wall_pairs
        self.phase, self.position = solver.particles.arrays["phase"], solver.position
        self.distance, self.walls, self.spacing = solver.distance, solver.walls, solver.spacing
        self.mixes = "volume_fraction" in solver.particles.arrays
        self.fractions = solver.particles.arrays.get("volume_fraction")
        self.number = len(solver.liquids)
        self.of_liquid = ti.field(real(), shape=self.number)
        for k, liquid in enumerate(solver.liquids):
            self.of_liquid[k] = liquid.dynamic_viscosity
        self.differ = len({liquid.dynamic_viscosity for liquid in solver.liquids}) > 1
        pulling = [effect for effect in solver.settings.effects if getattr(effect, "pulls_contact_line", False)]
        self.tension = pulling[0] if pulling else None
        self.has_line = not self.mixes and bool(pulling)
        self.line_grip = 0.0 if corner else grip_at_line(solver.settings.numerics.support_ratio)

    @ti.func
    def viscosity(self, i):
        """Viscosity of the liquid, or of the mixture: product of mu_k^alpha_k, Pa s."""
        mu = self.of_liquid[self.phase[i]]
        if ti.static(self.mixes):
            mu = 1.0
            for k in ti.static(range(self.number)):
                mu *= ti.pow(self.of_liquid[k], self.fractions[i][k])  # (V10)
        return mu

    @ti.kernel
    def measure(self, own: ti.template(), felt: ti.template()):
        """Set `own_viscosity` and `dynamic_viscosity`, which are given, from the present neighbor rows."""
        for i in range(self.count[None]):
            own[i] = self.viscosity(i)
            felt[i] = own[i]
        if ti.static(self.differ):
            for i in range(self.count[None]):
                felt[i] += self._missing(own, i)

    @ti.func
    def _missing(self, own: ti.template(), i):
        """What a particle that is alone in a more viscous liquid lacks of the viscosity around it, Pa s."""
        mu = own[i]
        alike, around, total = 0.0, 0.0, 1e-20
        for slot in range(self.pairs.count[i]):
            k = self.pairs.entry(i, slot)
            weight, other = self.pairs.weight[k], own[self.pairs.index[k]]
            alike += weight * ti.select(other > mu, mu / other, 1.0)
            around += weight * other
            total += weight
        for slot in range(self.wall_pairs.count[i]):
            weight = self.wall_pairs.weight[self.wall_pairs.entry(i, slot)]
            alike += weight
            around += weight * mu
            total += weight
        alone = ti.math.clamp((AMONG - alike / total) / (AMONG - ALONE), 0.0, 1.0)
        return alone * ti.max(around / total - mu, 0.0)  # (V10)

    @ti.func
    def depth(self, i):
        """Distance of particle i to the wall, at least 0.1 dx, m."""
        return ti.max(-self.distance.value(self.position[i]), 0.1 * self.spacing)

    @ti.func
    def wall_factor(self, depth, b):
        """Velocity of a particle at a depth less that of wall particle b, over the particle's own, for no slip.

        The velocity is taken to be linear and zero at the wall's surface [morris1997].
        """
        return 1.0 + self.walls.depth[b] / depth  # (V4)

    @ti.func
    def grip(self, i):
        """Share of the wall's friction that holds particle i: less next to a contact line that tension pulls."""
        unlike, total = 0.0, 1e-20
        if ti.static(self.has_line):
            neighbors = ti.select(self.wall_pairs.count[i] > 0, self.pairs.count[i], 0)
            for slot in range(neighbors):
                k = self.pairs.entry(i, slot)
                alike = (self.phase[self.pairs.index[k]] == 0) == (self.phase[i] == 0)
                unlike += ti.select(alike, 0.0, self.pairs.weight[k])
                total += self.pairs.weight[k]
        return 1.0 - (1.0 - self.line_grip) * ti.min(unlike / (AT_LINE * total), 1.0)  # (V12)
