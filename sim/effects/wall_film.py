"""Film of the wetting liquid between the wall and another one: columns of it slide along the wall as a whole.

Oil that comes over a wetted wall leaves a film of aqueous behind, some 30 to 100 micrometers thick. Particles show it
as a sheet one particle thick, which cannot thin as a film does: it stretches, parts into beads, and oil closes around
them. So a column of film, from its upper end down to the liquid that it belongs to, slides with the speed of
lubrication, and whenever it has gone one particle spacing, the particle at its upper end changes places with the oil in
the corner at its lower end: that is what a sheet which has slid so far has lost above and gained below. What the
particles do by themselves counts. Of what a front leaves behind, the column gives back all but the thickness of a real
film, for the rest would never have left the liquid that the front belongs to.

Two particles change places with all that they are, so that no volume, mass or momentum is made or lost, and only where
that lowers the weights. There is none of it away from walls, where no film is, and in liquid at rest.
Equations: docs/methods/wall_film.md.
"""
import dataclasses
import math
from types import MappingProxyType

import numpy as np

from sim.advice import NOTE, SEEN_EFFECT, WARNING, Advice, if_zero, is_seen, shown, times
from sim.backend import data_oriented, real, ti
from sim.effects.effect import MIXES, REMEMBERS, Effect
from sim.effects.parts.contact_line import DEPOSIT, THICKEST, VISCOUS
from sim.fields import Field
from sim.liquid import UNLIKE, are_unlike
from sim.parameters import parameter
from sim.reductions import blocks, first, last, partial_results, running_total

THICK = 0.3  # share of a liquid among the neighbors deeper by half a spacing, from which on it is thick; with 0.8 the
# ends of a thin lens (95 % oil in a circle) are taken for film
ALONE = 0.25  # share of its like around a particle below which it is a bead, which may hover farther from the wall
BEAD_DEPTH = 2.2  # largest distance of a bead from the wall, in spacings; that of film is 1
NEXT = 2.0  # reach along the wall from a particle of film to the next, in spacings
STEEP = 0.6  # least cosine between the way there and the way down
SMALLEST_ANGLE = math.radians(5.0)  # between wall and interface: the wedge of this one is 12 spacings long
PASS = 0.9  # of a support radius: way along the wall that one pass over the neighbors surely sees
LONGEST_COLUMN = 10_000  # particles
FAR = 1e9  # m: no liquid in several layers is known
OFF, THIN, DEEP = 0, 1, 2  # what a particle is: not wetting or away from the wall; on it, in one layer; in several
MEMBER, END = 1, 2  # film, and that at the upper end of a column


@dataclasses.dataclass(frozen=True)
class WallFilmParameters:
    """Films of the wetting liquid between wall and oil slide off, which particles show too thick."""

    coefficient: float = parameter(1.0, minimum=0.0, maximum=4.0,
                                   meaning="speed of a film as thick as a particle over that of one between two "
                                           "walls, as stiff oil makes it; under a liquid that gives way it is 4 times "
                                           "as fast")


def _check_liquids(parameters, liquids, bulk_liquids):
    key = ("effects", "wall_film")
    if bulk_liquids > 2:
        yield key, f"knows films between a wall and one other liquid, but the scene has {bulk_liquids} liquids"
    elif are_unlike(liquid.density for liquid in liquids[:2]):
        yield key, (f"cannot be used where one liquid is more than {UNLIKE:g} times as dense as the other, as beside "
                    "gas: particles that change places would throw the gas about; remove it")


def _check_angle(parameters, effects, liquids):
    angle = _contact_angle(effects.values())
    if angle is None or len(liquids) < 2:
        return
    wetting = liquids[_wetting(angle)]
    if min(angle, math.pi - angle) < SMALLEST_ANGLE:
        least = math.degrees(SMALLEST_ANGLE)
        yield ("effects", "wall_film"), (
            f"cannot be used with a contact angle of {math.degrees(angle):g} deg, but from {least:g} to "
            f"{180 - least:g} deg: the wedge at the contact line would be thinner than a particle over too long a way; "
            "remove it or change the angle")
    if not wetting.dynamic_viscosity:
        yield ("effects", "wall_film"), (f"needs a film that is viscous, but the dynamic viscosity of {wetting.name} "
                                         "is 0 Pa s, not above it")


def _contact_angle(effects):
    """Contact angle through the first liquid, rad; None where no parameters of effects have one."""
    return next((effect.contact_angle for effect in effects if hasattr(effect, "contact_angle")), None)


def _wetting(angle: float) -> int:
    """Phase of the liquid that wets the wall, and so makes films."""
    return int(angle > 0.5 * math.pi)


@data_oriented
class WallFilm(Effect):
    """Columns of film that slide down between wall and oil."""

    name = "wall_film"
    Parameters = WallFilmParameters
    fields = (
        Field("film_way", "scalar", "m", "way s_i that a column has slid since its upper end changed places",
              carried=True),
        Field("film_time", "scalar", "s", "time since it lay in several layers until it counts as left behind, then -1",
              carried=True),
        Field("wall_distance", "scalar", "m", "distance to the wall"),
        Field("film_kind", "integer", "", "wetting liquid on the wall: 1 in one layer, 2 in several, 0 for all else"),
        Field("way_to_thick", "scalar", "m", "way along the wall to liquid in several layers"),
        Field("way_to_thick_next", "scalar", "m", "the same over one neighbor more"),
        Field("film_member", "integer", "", "1 for film, farther from thick liquid than a wedge, 2 at its upper end"),
        Field("film_next", "integer", "", "particle below it on the wall, -1 for none"),
        Field("film_direction", "vector", "1", "direction of its weight along the wall"),
        Field("film_speed", "scalar", "m/s", "speed of lubrication u_i"),
    )
    uses = ("id", "phase", "position", "velocity", "volume", "mass")
    periodic = False
    excludes = MappingProxyType({
        MIXES: "a film is told by liquids that do not mix",
        REMEMBERS: "particles that change places would not keep their stress"})
    fewest_liquids = 2
    checks = (_check_liquids, _check_angle)

    def __init__(self, parameters, solver):
        super().__init__(parameters, solver)
        self.count, self.spacing, self.dimension = solver.count, solver.spacing, solver.dimension
        self.pairs, self.wall_pairs = solver.pairs, solver.wall_pairs
        self.distance = solver.distance
        angle = _contact_angle(effect.parameters for effect in solver.effects)
        self.wetting = _wetting(angle)
        film, other = (solver.liquids[phase] for phase in (self.wetting, 1 - self.wetting))
        self.density_difference = film.density - other.density
        self.wedge = (1.0 / math.tan(min(angle, math.pi - angle)) + 1.0) * self.spacing  # (N1)
        self.passes = math.ceil(self.wedge / (PASS * solver.support_radius))
        self.mobility = parameters.coefficient * self.spacing**2 / (12.0 * film.dynamic_viscosity)  # m^4/(N s)
        tension = max(effect.tension_of(effect.parameters) for effect in solver.effects)
        self.capillary_speed = tension / film.dynamic_viscosity
        self.viscosity_ratio = other.dynamic_viscosity / film.dynamic_viscosity
        self.radius = {2: math.sqrt(solver.cavity_volume / math.pi),
                       3: math.cbrt(0.75 * solver.cavity_volume / math.pi)}[self.dimension]
        self.begins = True  # what is film now was not left behind by a front that was seen
        self.weight = ti.Vector.field(self.dimension, real(), shape=())  # (rho_f - rho_o) g, N/m^3
        self.thin, self.ends = (ti.field(ti.i32, shape=solver.particles.capacity) for _ in range(2))
        self.thin_count, self.film_count, self.end_count, self.exchanges = (
            ti.field(ti.i32, shape=()) for _ in range(4))
        self.partial = partial_results(1)
        self.moved = [getattr(self.particles, name) for name in ("id", "phase", "mass", "volume")]

    @classmethod
    def idle(cls, parameters, settings) -> str:
        if not parameters.coefficient:
            return "its coefficient is 0"
        if not any(getattr(effect, "pulls_contact_line", False) for effect in settings.effects):
            return "no interface with a tension in N/m is in the scene"
        if not any(getattr(effect, "weighs_liquids", False) for effect in settings.effects):
            return "nothing weighs on a film"
        if len({liquid.density for liquid in settings.liquids[:2]}) < 2:
            return "the liquids weigh the same, so that no film slides"
        return ""

    @classmethod
    def advice(cls, parameters, scales, limits):
        speed = cls._speed(parameters or WallFilmParameters(), scales)
        reach = speed * scales.duration
        if parameters:
            yield from if_zero(cls.name, parameters, "coefficient", "(a pure number)")
            if parameters.coefficient and speed:
                yield Advice(SEEN_EFFECT if is_seen(reach, scales) else NOTE, cls.name,
                             f"lets a film as thick as a particle slide at {shown(speed, 'm/s')}, within the scene by "
                             f"{times(reach, scales)}")
        elif is_seen(reach, scales) and cls._fronts_move(scales):
            yield Advice(WARNING, cls.name,
                         "is missing and would be seen: what oil leaves behind on a wetted wall stays there as a film "
                         f"one particle thick, which would slide off at {shown(speed, 'm/s')}")

    @classmethod
    def _fronts_move(cls, scales) -> bool:
        """Whether liquid enters, or the patient turns, so that oil comes over a wetted wall."""
        return any(effect.brings(one) or len(list(effect.held(one, scales.duration))) > 1
                   for effect, one in scales.effects)

    @classmethod
    def _speed(cls, parameters, scales) -> float:
        """Speed of a film as thick as a particle, m/s; 0 where none can slide."""
        angle = _contact_angle(one for _, one in scales.effects)
        if angle is None or not scales.tension or len(scales.liquids) != 2 or scales.does(MIXES):
            return 0.0
        viscosity = scales.liquids[_wetting(angle)].dynamic_viscosity
        if not viscosity or are_unlike(liquid.density for liquid in scales.liquids):
            return 0.0
        weight = scales.density_difference * scales.gravity
        return parameters.coefficient * weight * scales.spacing**2 / (12.0 * viscosity)

    def stable_time_step(self) -> float:
        """An end of a column goes half a spacing at most, s: (A7) of docs/methods/time_step.md."""
        speed = self.mobility * abs(self.density_difference) * np.linalg.norm(self.solver.gravity())
        return 0.5 * self.spacing / speed if speed else float("inf")

    def start(self, missing: set[str]) -> None:
        for name in missing:
            getattr(self.particles, name).fill(0.0)
        self.begins = True

    def state(self) -> dict:
        return {"begins": self.begins}

    def restore(self, state: dict) -> None:
        if state:
            self.begins = bool(state["begins"])

    def finish(self, dt: float) -> dict[str, float]:
        gravity = self.solver.gravity()
        self.weight[None] = ti.Vector([float(v) for v in self.density_difference * gravity])
        for number in (self.film_count, self.end_count, self.exchanges):
            number[None] = 0
        self._find_thin(dt)
        if self.thin_count[None] and np.any(gravity):
            self._find_film(dt)
        self.begins = False
        return {"film_particles": float(self.film_count[None]), "film_columns": float(self.end_count[None]),
                "film_exchanges": float(self.exchanges[None])}

    def _find_film(self, dt: float) -> None:
        ways = self.particles.way_to_thick, self.particles.way_to_thick_next
        for number in range(self.passes):
            self._pass_on(ways[number % 2], ways[(number + 1) % 2])
        self._join(ways[self.passes % 2])
        if self.film_count[None]:
            self._slide(dt, int(self.begins))

    @ti.func
    def _wets(self, i):
        return self.particles.phase[i] == self.wetting

    @ti.func
    def _kind(self, i):
        """What particle i is."""
        depth, kind = self.particles.wall_distance[i], OFF
        if self._wets(i) and depth < BEAD_DEPTH * self.spacing:
            alike, total, deep_alike, deep = 0.0, 1e-20, 0.0, 1e-20
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                j = self.pairs.index[k]
                weight = self.pairs.weight[k]
                like = ti.select(self._wets(j), weight, 0.0)
                deeper = self.particles.wall_distance[j] > depth + 0.5 * self.spacing
                alike += like
                total += weight
                deep_alike += ti.select(deeper, like, 0.0)
                deep += ti.select(deeper, weight, 0.0)
            if depth < self.spacing or alike < ALONE * total:
                kind = ti.select(deep_alike < THICK * deep, THIN, DEEP)
        return kind

    @ti.kernel
    def _find_thin(self, dt: float):
        """Distances to the wall; who is on it in one layer or several; a list of the former."""
        for i in range(self.count[None]):
            self.particles.wall_distance[i] = -self.distance.value(self.particles.position[i])
            self.particles.film_kind[i] = OFF
        members = self.wall_pairs.member_count[None]
        for m in range(members):
            i = self.wall_pairs.member[m]
            self.particles.film_kind[i] = self._kind(i)
        for i in range(self.count[None]):
            kind = self.particles.film_kind[i]
            self.particles.film_member[i] = 0
            self.particles.way_to_thick[i] = self.particles.way_to_thick_next[i] = ti.select(kind == DEEP, 0.0, FAR)
            if kind != THIN:
                self.particles.film_way[i] = 0.0
            if kind == DEEP:
                self.particles.film_time[i] = 0.0
            elif kind == THIN and self.particles.film_time[i] >= 0.0:
                self.particles.film_time[i] += dt
        for block in range(blocks(members)):
            found = 0
            for m in range(first(block, members), last(block, members)):
                found += ti.cast(self.particles.film_kind[self.wall_pairs.member[m]] == THIN, ti.i32)
            self.partial[0, block] = found
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.thin_count[None] = ti.cast(running_total(self.partial, 0, members), ti.i32)
        for block in range(blocks(members)):
            place = ti.cast(self.partial[0, block], ti.i32)
            for m in range(first(block, members), last(block, members)):
                i = self.wall_pairs.member[m]
                if self.particles.film_kind[i] == THIN:
                    self.thin[place] = i
                    place += 1

    @ti.kernel
    def _pass_on(self, way: ti.template(), target: ti.template()):
        """Ways along the wall to liquid in several layers, over one neighbor more."""
        for t in range(self.thin_count[None]):
            i = self.thin[t]
            least = way[i]
            for slot in range(self.pairs.count[i]):
                j = self.pairs.index[self.pairs.entry(i, slot)]
                if way[j] < FAR:
                    least = ti.min(least, way[j] + (self.particles.position[i] - self.particles.position[j]).norm())
            target[i] = least

    @ti.kernel
    def _join(self, way: ti.template()):
        """Film, how fast it slides and where to; the particle below each on the wall; upper ends of columns."""
        for t in range(self.thin_count[None]):
            i = self.thin[t]
            normal = self.distance.normal(self.particles.position[i])
            down = self.weight[None] - self.weight[None].dot(normal) * normal
            self.particles.film_direction[i] = down / ti.max(down.norm(), 1e-12)
            self.particles.film_speed[i] = self.mobility * down.norm()  # (N2)
            self.particles.film_member[i] = ti.select(way[i] > self.wedge, MEMBER, 0)
        for t in range(self.thin_count[None]):
            i = self.thin[t]
            down = self.particles.film_direction[i]
            weight = self.weight[None] / self.weight[None].norm()
            slope = down.dot(weight)
            below, best, ends = -1, FAR, True
            for slot in range(self.pairs.count[i]):
                j = self.pairs.index[self.pairs.entry(i, slot)]
                if self.particles.film_kind[j] != OFF:
                    away = self.particles.position[j] - self.particles.position[i]
                    length = away.norm()
                    along = away.dot(down)
                    if length < NEXT * self.spacing:
                        if along > STEEP * length and 2.0 * length - along < best:
                            below, best = j, 2.0 * length - along
                        ends = ends and -away.dot(weight) < STEEP * slope * length  # around a top all are ends
            self.particles.film_next[i] = below  # (N3)
            if ends and self.particles.film_member[i] == MEMBER:
                self.particles.film_member[i] = END
        ti.loop_config(serialize=True)
        for _ in range(1):
            film, columns = 0, 0
            for t in range(self.thin_count[None]):
                i = self.thin[t]
                if self.particles.film_member[i] == 0:
                    self.particles.film_way[i] = 0.0
                else:
                    film += 1
                if self.particles.film_member[i] == END:
                    self.ends[columns] = i
                    columns += 1
            self.film_count[None] = film
            self.end_count[None] = columns

    @ti.func
    def _other_in_corner(self, i):
        """Neighbor of the other liquid that has most of the wetting one around it, -1 for none."""
        found, best = -1, 0.0
        for slot in range(self.pairs.count[i]):
            j = self.pairs.index[self.pairs.entry(i, slot)]
            if not self._wets(j):
                around = 0.0
                for s in range(self.pairs.count[j]):
                    k = self.pairs.entry(j, s)
                    around += ti.select(self._wets(self.pairs.index[k]), self.pairs.weight[k], 0.0)
                if around > best:
                    found, best = j, around
        return found

    @ti.func
    def _other_below(self, i):
        """Neighbor of the other liquid on the wall that is farthest down the way, -1 for none."""
        found, best = -1, FAR
        for slot in range(self.pairs.count[i]):
            j = self.pairs.index[self.pairs.entry(i, slot)]
            if not self._wets(j) and self.particles.wall_distance[j] < self.spacing:
                away = self.particles.position[j] - self.particles.position[i]
                length, along = away.norm(), away.dot(self.particles.film_direction[i])
                if length < NEXT * self.spacing and along > STEEP * length and 2.0 * length - along < best:
                    found, best = j, 2.0 * length - along
        return found

    @ti.func
    def _has_other(self, i):
        found = False
        for slot in range(self.pairs.count[i]):
            found = found or not self._wets(self.pairs.index[self.pairs.entry(i, slot)])
        return found

    @ti.func
    def _partner(self, end):
        """Particle of the other liquid at the lower end of a column: in the corner between film and what it belongs to,
        or below a column that belongs to nothing; -1 for none.
        """
        i, lowest, corner, steps = end, end, -1, 0
        while i >= 0 and steps < LONGEST_COLUMN:
            if self._has_other(i):
                corner = i
            lowest = i
            i = ti.select(self.particles.film_kind[i] == THIN, self.particles.film_next[i], -1)
            steps += 1
        found = -1
        if self.particles.film_kind[lowest] == THIN and self.particles.film_member[lowest] != 0:
            found = self._other_below(lowest)
        elif corner >= 0:
            found = self._other_in_corner(corner)
        return found

    @ti.func
    def _next_of_film(self, i):
        """Particle below one of film, if that is film too, else -1."""
        j = self.particles.film_next[i]
        if j >= 0:
            j = ti.select(self.particles.film_member[j] != 0, j, -1)
        return j

    @ti.func
    def _change_places(self, i, j):
        """Exchange two particles; what belongs to a place, as velocity and pressure, stays there, but for what keeps
        the momentum.
        """
        mass, other = self.particles.mass[i], self.particles.mass[j]
        excess = (mass - other) / (mass + other) * (self.particles.velocity[i] - self.particles.velocity[j])  # (N5)
        self.particles.velocity[i] += excess
        self.particles.velocity[j] += excess
        for field in ti.static(self.moved):
            kept = field[i]
            field[i] = field[j]
            field[j] = kept
        for k in ti.static((i, j)):
            self.particles.film_way[k] = 0.0
            self.particles.film_time[k] = 0.0

    @ti.func
    def _left_behind(self, i):
        """Thickness of the film that a front leaves behind which has passed particle i, m."""
        speed = self.wedge / self.particles.film_time[i]
        capillary = speed / self.capillary_speed
        to_two_thirds = ti.pow(capillary, 2.0 / 3.0)
        thicker = ti.select(self.viscosity_ratio * to_two_thirds > 1.0, VISCOUS, THICKEST)
        return DEPOSIT * thicker * self.radius * to_two_thirds  # (N6)

    @ti.kernel
    def _slide(self, dt: float, begins: int):
        """Move the columns on; where one has gone a particle spacing, its upper end changes places.

        The latter by one thread, in the order of the particles: no two ends take the same one.
        """
        for e in range(self.end_count[None]):
            end = self.ends[e]
            i, steps, lag = end, 0, 0.0
            while i >= 0 and steps < LONGEST_COLUMN:
                lag += self.particles.film_speed[i] - self.particles.velocity[i].dot(self.particles.film_direction[i])
                steps += 1
                i = self._next_of_film(i)
            self.particles.film_way[end] += dt * ti.max(lag / steps, 0.0)  # (N4)
        ti.loop_config(serialize=True)
        for _ in range(1):
            changes = 0
            if begins == 1:
                for t in range(self.thin_count[None]):
                    if self.particles.film_member[self.thin[t]] != 0:
                        self.particles.film_time[self.thin[t]] = -1.0
            for e in range(self.end_count[None]):
                end = self.ends[e]
                i, steps = end, 0
                while i >= 0 and steps < LONGEST_COLUMN:
                    if self.particles.film_time[i] >= 0.0:
                        self.particles.film_way[end] += ti.max(self.spacing - self._left_behind(i), 0.0)  # (N7)
                        self.particles.film_time[i] = -1.0
                    steps += 1
                    i = self._next_of_film(i)
                if self.particles.film_way[end] >= self.spacing:
                    other = self._partner(end)
                    if other >= 0:
                        way = self.particles.position[other] - self.particles.position[end]
                        if way.dot(self.weight[None]) > 0.0 and not self._wets(other):
                            below = self._next_of_film(end)
                            if below >= 0:
                                self.particles.film_way[below] += self.particles.film_way[end] - self.spacing
                            self._change_places(end, other)
                            changes += 1
            self.exchanges[None] = changes
