"""Collision of immiscible liquids [mao, sections 4, 5] (docs/methods/collision.md).

A particle is inside another liquid when it lies in the convex hull of its neighbors of that liquid. It then collides
with a virtual particle of that liquid at its own place, whose mass and velocity are means of these neighbors with the
weights omega_k = V_k W_ik / sum of V_l W_il, and it is moved to the surface of the hull along the normal of the
interface. The impulse that the virtual particle takes is handed to the neighbors with the same weights. Corrections:

- omega sums to 1, which the weights of the paper do not, so that momentum is kept to round-off;
- only particles that approach collide;
- with `counter_move` the neighbors give way by what the move would shift the center of mass;
- all particles of one liquid, or of all (`order`), answer to the same state and gather what others hand them, so that
  the result depends neither on their order nor on the number of threads. What one particle takes part in at once
  adds up, though: its mass is shared out over its `load`, the sum of all weights of collisions that it is in. The
  impulse is (1 + e) u / max(1/m_i + 1/m_j, load_i/m_i + sum of omega_k load_k/m_k), with which no number of
  simultaneous collisions can gain energy (by the Cauchy-Schwarz inequality); a single one has the impulse of the paper.

A hull of neighbors around a hollow holds what is in the hollow: `least_share` asks for more than the hull.
"""
import dataclasses
from types import MappingProxyType

from sim.advice import SEEN_EFFECT, WARNING, Advice, if_alone
from sim.backend import data_oriented, ti
from sim.boundary import WALL_CLEARANCE
from sim.effects.effect import MIXES, Effect
from sim.effects.parts.convex_hull import ConvexHull
from sim.fields import Field
from sim.parameters import parameter

BEYOND = 1.001  # of the way to the surface of the hull, so that the particle ends outside


@dataclasses.dataclass(frozen=True)
class CollisionParameters:
    """Particles that got into another liquid bounce off it and are moved out, as in the paper, momentum kept."""

    order: str = parameter("alternating", choices=("alternating", "simultaneous"),
                           meaning="liquids answer one after the other, another one first in every step, or at once")
    restitution: float | None = parameter(
        None, minimum=0.0, maximum=1.0, meaning="share of the speed of approach that is given back along the normal; "
                                                "without it the whole relative velocity is turned round, as in the "
                                                "paper")
    least_share: float = parameter(0.0, minimum=0.0, maximum=1.0,
                                   meaning="share of the other liquid around a particle, by volume and kernel, below "
                                           "which it is not inside, whatever the hull says; 0 as in the paper")
    largest_move: float = parameter(0.5, minimum=0.0, maximum=1.0,
                                    meaning="longest move out of the other liquid per step, in particle spacings")
    counter_move: bool = parameter(True, meaning="the other liquid gives way, so that the center of mass stays")
    strength: float = parameter(1.0, minimum=0.0, maximum=1.0, meaning="share of impulse and move that is applied")


@data_oriented
class Collision(Effect):
    """Impulses and moves at the end of the step, before the pressure of the next one."""

    name = "collision"
    Parameters = CollisionParameters
    fields = (
        Field("held_by", "integer", "", "liquid whose hull holds the particle, -1 for none"),
        Field("held_weight", "scalar", "1", "sum of V_k W_ik over the neighbors of that liquid"),
        Field("collision_load", "scalar", "1", "sum of the weights of the collisions that the particle takes part in"),
        Field("move_load", "scalar", "1", "the same of the moves, which need no approach"),
        Field("collision_impulse", "vector", "kg m/s", "velocity of approach, then the impulse handed to the others"),
        Field("collision_move", "vector", "m", "move out of the other liquid"),
    )
    uses = ("position", "velocity", "volume", "mass", "phase")
    excludes = MappingProxyType({MIXES: "one mixes the liquids, the other keeps them apart"})
    fewest_liquids = 2

    def __init__(self, parameters, solver):
        super().__init__(parameters, solver)
        self.count, self.pairs, self.kernel = solver.count, solver.pairs, solver.kernel
        self.separation, self.distance = solver.search.separation, solver.distance
        self.liquid_count = len(solver.liquids)
        self.whole_velocity = parameters.restitution is None
        self.impulse_factor = parameters.strength * (1.0 + (1.0 if self.whole_velocity else parameters.restitution))
        self.least_share, self.counter_move = parameters.least_share, parameters.counter_move
        self.move_limit = parameters.largest_move * solver.spacing
        self.strength = parameters.strength
        self.clearance = WALL_CLEARANCE * solver.spacing
        self.hull = ConvexHull(self.particles.position, self.particles.phase, self.pairs, self.separation,
                               solver.support_radius)

    @classmethod
    def idle(cls, parameters, settings) -> str:
        if parameters.strength == 0.0:
            return "its strength is 0"
        return "there is one liquid only" if len(settings.liquids) == 1 else ""

    @classmethod
    def advice(cls, parameters, scales, limits):
        if parameters is None:
            return
        if parameters.strength == 0.0:
            yield Advice(WARNING, cls.name, "does nothing: its strength is 0, not above 0")
        elif len(scales.liquids) == 1:
            yield from if_alone(cls.name, scales)
        else:
            yield Advice(SEEN_EFFECT, cls.name, f"it keeps {len(scales.liquids)} liquids apart, particle by particle; "
                                                "every hit takes energy, and it is no surface tension")

    @ti.func
    def _weights(self, i, liquid):
        """Sums of V_k W_ik over the neighbors of one liquid, and over all others with the particle itself."""
        within = 0.0
        beside = self.particles.volume[i] * self.kernel.at_zero
        for slot in range(self.pairs.count[i]):
            k = self.pairs.entry(i, slot)
            if self.particles.phase[self.pairs.index[k]] == liquid:
                within += self.pairs.weight[k]
            else:
                beside += self.pairs.weight[k]
        return within, beside

    @ti.func
    def _virtual(self, i):
        """Velocity of the virtual particle (H1), and the unit normal from the other liquid into that of i (H2)."""
        liquid = self.particles.held_by[i]
        velocity, normal = self.particles.velocity[i] * 0.0, self.particles.velocity[i] * 0.0
        for slot in range(self.pairs.count[i]):
            k = self.pairs.entry(i, slot)
            j = self.pairs.index[k]
            if self.particles.phase[j] == liquid:
                velocity += self.pairs.weight[k] / self.particles.held_weight[i] * self.particles.velocity[j]
                normal -= self.pairs.gradient[k]
            elif self.particles.phase[j] == self.particles.phase[i]:
                normal += self.pairs.gradient[k]
        length = normal.norm()
        if length > 1e-6 * self.kernel.at_zero * self.particles.volume[i] / self.solver.spacing:
            normal /= length
        else:  # evenly surrounded: back to where it came from
            back = velocity - self.particles.velocity[i]
            normal = back / ti.max(back.norm(), 1e-30)
        return velocity, normal

    @ti.kernel
    def _detect(self, turn: int):
        """Which liquid holds a particle, its velocity of approach and its move; `turn` is the liquid asked, -1 all."""
        for i in range(self.count[None]):
            self.particles.held_by[i] = -1
            self.particles.collision_impulse[i] = self.particles.velocity[i] * 0.0
            self.particles.collision_move[i] = self.particles.velocity[i] * 0.0
            most = 0.0
            for liquid in range(self.liquid_count):
                own = self.particles.phase[i]
                if liquid != own and (turn < 0 or turn == own):
                    within, beside = self._weights(i, liquid)
                    if within > most and within > self.least_share * (within + beside) and self.hull.holds(i, liquid):
                        most = within
                        self.particles.held_by[i] = liquid
            self.particles.held_weight[i] = most
            if most > 0.0:
                velocity, normal = self._virtual(i)
                relative = self.particles.velocity[i] - velocity
                approach = relative.dot(normal)
                if approach < 0.0:
                    self.particles.collision_impulse[i] = approach * normal
                    if ti.static(self.whole_velocity):
                        self.particles.collision_impulse[i] = relative
                way = ti.min(BEYOND * self.hull.exit_distance(i, self.particles.held_by[i], normal), self.move_limit)
                self.particles.collision_move[i] = self.strength * way * normal

    @ti.func
    def _share(self, i, k):
        """Weight omega with which the neighbor in entry k of the row of i hands its impulse to i; 0 if it does not."""
        j = self.pairs.index[k]
        share = 0.0
        if self.particles.held_by[j] == self.particles.phase[i]:
            share = self.pairs.weight[k] * self.particles.volume[i] / (
                self.particles.volume[j] * self.particles.held_weight[j])
        return share

    @ti.func
    def _collides(self, i):
        return self.particles.held_by[i] >= 0 and self.particles.collision_impulse[i].norm_sqr() > 0.0

    @ti.kernel
    def _collide(self):
        """Turn velocities of approach into impulses, and share out what a particle takes part in more than once."""
        for i in range(self.count[None]):
            load = ti.select(self._collides(i), 1.0, 0.0)
            move_load = ti.select(self.particles.held_by[i] >= 0, 1.0, 0.0)
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                share = self._share(i, k)
                move_load += share
                if self._collides(self.pairs.index[k]):
                    load += share
            self.particles.collision_load[i] = load
            self.particles.move_load[i] = move_load
        for i in range(self.count[None]):
            if self.particles.held_by[i] >= 0:
                mass = 0.0
                loaded = self.particles.collision_load[i] / self.particles.mass[i]
                most = ti.max(self.particles.move_load[i], 1.0)
                for slot in range(self.pairs.count[i]):
                    k = self.pairs.entry(i, slot)
                    j = self.pairs.index[k]
                    if self.particles.phase[j] == self.particles.held_by[i]:
                        share = self.pairs.weight[k] / self.particles.held_weight[i]
                        mass += share * self.particles.mass[j]
                        loaded += share * self.particles.collision_load[j] / self.particles.mass[j]
                        most = ti.max(most, self.particles.move_load[j])
                self.particles.collision_impulse[i] *= self.impulse_factor / ti.max(  # (H3)
                    1.0 / self.particles.mass[i] + 1.0 / mass, loaded)
                if ti.static(self.counter_move):
                    self.particles.collision_move[i] *= mass / (mass + self.particles.mass[i]) / most  # (H4)

    @ti.kernel
    def _apply(self):
        for i in range(self.count[None]):
            impulse = -self.particles.collision_impulse[i]
            move = self.particles.collision_move[i]
            handed = move * 0.0
            touched = self.particles.held_by[i] >= 0
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                share = self._share(i, k)
                if share > 0.0:
                    j = self.pairs.index[k]
                    touched = True
                    impulse += share * self.particles.collision_impulse[j]
                    handed += share * self.particles.mass[j] * self.particles.collision_move[j]
            if touched:
                self.particles.velocity[i] += impulse / self.particles.mass[i]
                if ti.static(self.counter_move):
                    move -= handed / self.particles.mass[i]
                x = self.particles.position[i] + move
                overlap = self.distance.value(x) + self.clearance
                if overlap > 0.0:
                    x -= overlap * self.distance.normal(x)
                self.particles.position[i] = x

    def finish(self, dt: float) -> None:
        turns = [-1]
        if self.parameters.order == "alternating":
            first = self.solver.step_count % self.liquid_count
            turns = [(first + turn) % self.liquid_count for turn in range(self.liquid_count)]
        for turn in turns:
            self._detect(turn)
            self._collide()
            self._apply()
