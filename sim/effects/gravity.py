"""Gravity in the frame of the eye: posture and its turns over time.

In a completely full closed cavity a force field that is a gradient only shifts the pressure, so the weight of a
reference density is taken out of the solve: a_i = (1 - rho_ref/rho_i) g. The solver then meets the small buoyancy
instead of the large weight. Where the liquids have a free surface, or may fall for ever along a periodic axis, rho_ref
is 0. The inertial forces of a turn (some 0.02 m/s^2 at one second a quarter turn) are left out. Where
`eye_rotation` turns the eye in the head, posture and jolts are those of the head. Equations: docs/methods/gravity.md.
"""
import dataclasses
import functools
import itertools
import math

import numpy as np

from sim.advice import EARTH_GRAVITY, NOTE, SEEN_EFFECT, WARNING, Advice, Quantity, is_seen, long_time, shown, times
from sim.backend import data_oriented, real, ti
from sim.effects.effect import WEIGHS, Effect
from sim.effects.parts.postures import POSTURES, Course, Move, direction_of, posture_in_words, words_of
from sim.liquid import are_unlike
from sim.parameters import parameter

# A turn follows the minimum-jerk profile: its peak rate is 15/8 and its peak acceleration 10/sqrt(3) of angle over
# duration and duration squared.
PEAK_RATE, PEAK_ACCELERATION = 15.0 / 8.0, 10.0 / math.sqrt(3.0)
RIGHT_ANGLE, HALF_TURN = 0.5 * math.pi, math.pi
HEAD_UP = "angle by which the head is raised from lying, such as 30 deg"
ROLL = "angle by which a patient who lies is turned in bed, from the back toward the left side"
STEPS_OF_JOLT = 40      # time steps in a jolt, at least
LENGTH_ERROR = 0.05     # of the vectors of an orientation, whose length says nothing
MOST_SPANS = 12         # turns that are looked at one by one when times are foretold
INERTIA_OF_TURN = 1.0  # the inertial forces of a turn, which are left out, over the buoyancy, from which that is noted


@dataclasses.dataclass(frozen=True)
class Turn:
    """A turn of the patient from the posture held before to ``to``."""

    start: float = parameter(unit="s", minimum=0.0, meaning="time at which the turn begins")
    to: str = parameter(choices=tuple(POSTURES), meaning="posture after the turn")
    duration: float = parameter(1.0, unit="s", exclusive_minimum=0.0, meaning="time the turn takes")
    head_up: float = parameter(0.0, unit="rad", minimum=-RIGHT_ANGLE, maximum=RIGHT_ANGLE, meaning=HEAD_UP)
    roll: float = parameter(0.0, unit="rad", minimum=-HALF_TURN, maximum=HALF_TURN, meaning=ROLL)


@dataclasses.dataclass(frozen=True)
class Jolt:
    """A jolt of the head: its acceleration rises and falls as half a sine."""

    start: float = parameter(unit="s", minimum=0.0, meaning="time at which the jolt begins")
    acceleration: tuple[float, float, float] = parameter(
        unit="m/s**2", minimum=-200.0, maximum=200.0,
        meaning="peak acceleration of the head, in the axes of an eye that looks ahead")
    duration: float = parameter(0.05, unit="s", exclusive_minimum=0.0, meaning="time the jolt takes")


@dataclasses.dataclass(frozen=True)
class GravityParameters:
    """Weight of the liquids."""

    magnitude: float = parameter(9.81, unit="m/s**2", minimum=0.0, maximum=200.0, meaning="acceleration of gravity")
    posture: str = parameter("upright", choices=tuple(POSTURES), meaning="posture of the patient at the start")
    head_up: float = parameter(0.0, unit="rad", minimum=-RIGHT_ANGLE, maximum=RIGHT_ANGLE, meaning=HEAD_UP)
    roll: float = parameter(0.0, unit="rad", minimum=-HALF_TURN, maximum=HALF_TURN, meaning=ROLL)
    turns: tuple[Turn, ...] = parameter((), meaning="turns of the patient, in order, not overlapping")
    orientation: tuple[tuple[float, float, float, float], ...] = parameter(
        (), file="head_orientation",
        meaning="in place of posture and turns a CSV file of the orientation of the head, or its lines: time in s and "
                "direction of gravity in the head (x to the patient's left, y superior, z anterior)")
    second_means: float = parameter(1.0, unit="s", minimum=1e-3, maximum=1e8,
                                    meaning="time of turns and orientation that passes in a simulated second")
    jolts: tuple[Jolt, ...] = parameter((), meaning="jolts of the head")

    @property
    def weighs_liquids(self) -> bool:
        """Whether liquids ever have a weight."""
        return self.magnitude > 0.0 or bool(self.jolts)

    @functools.cached_property
    def course(self) -> Course:
        """Directions of gravity over simulated time."""
        scale = self.second_means
        if self.orientation:
            rows = [(time / scale, _unit(direction)) for time, *direction in self.orientation]
            return Course(rows[0][1], words_of(rows[0][1]), tuple(
                Move(begin, end, start, to, False, words_of(to))
                for (begin, start), (end, to) in itertools.pairwise(rows)))
        held = first = tuple(direction_of(self.posture, self.head_up, self.roll))
        moves = []
        for turn in self.turns:
            to = tuple(direction_of(turn.to, turn.head_up, turn.roll))
            moves.append(Move(turn.start / scale, (turn.start + turn.duration) / scale, held, to, True,
                              posture_in_words(turn.to, turn.head_up, turn.roll)))
            held = to
        return Course(first, posture_in_words(self.posture, self.head_up, self.roll), tuple(moves))

    def largest_jolt(self, dimension: int) -> float:
        """Largest acceleration in a jolt, m/s2."""
        return max((math.hypot(*jolt.acceleration[:dimension]) for jolt in self.jolts), default=0.0)

    def moves_within(self, duration: float) -> list[Move]:
        """Moves of gravity that begin within a duration, s."""
        return [move for move in self.course.moves if move.begin < duration]


def _unit(direction) -> tuple[float, ...]:
    length = math.hypot(*direction)
    return tuple(component / length for component in direction)


def _check_turns(parameters):
    for index, (turn, following) in enumerate(itertools.pairwise(parameters.turns)):
        end = turn.start + turn.duration
        if following.start < end - 1e-9:
            yield (("effects", "gravity", "turns", index + 1, "start"),
                   f"is {following.start:g} s, but the turn before ends at {end:g} s, and turns must not overlap")


def _check_postures(parameters):
    for key, one in ((("posture",), parameters), *((("turns", i, "to"), turn) for i, turn in enumerate(
            parameters.turns))):
        name = one.posture if one is parameters else one.to
        if name == "upright" and (one.head_up or one.roll):
            yield (("effects", "gravity", *key), "is upright, but head_up or roll is told, which are of a patient who "
                                                 "lies; begin with supine, prone, left_side or right_side")


def _check_orientation(parameters):
    key, rows = ("effects", "gravity", "orientation"), parameters.orientation
    if not rows:
        return
    if parameters.turns:
        yield key, "is given together with turns, but only one of them can tell how the head turns; remove one"
    length = [math.hypot(*row[1:]) for row in rows]
    for index, one in enumerate(length):
        if abs(one - 1.0) > LENGTH_ERROR:
            yield ((*key, index), f"has a direction of gravity of length {one:.3g}, but it must be 1 (within "
                                  f"{100 * LENGTH_ERROR:g} %)")
    if rows[0][0] != 0.0:
        yield (*key, 0), f"is at {rows[0][0]:g} s, but the first line must be at 0 s"
    for index, (before, after) in enumerate(itertools.pairwise(rows)):
        if after[0] <= before[0]:
            yield ((*key, index + 1), f"is at {after[0]:g} s, but must be later than the line before, at "
                                      f"{before[0]:g} s")
    start = np.dot(direction_of(parameters.posture, parameters.head_up, parameters.roll), rows[0][1:])
    if parameters.posture != "upright" and start < math.cos(math.radians(20.0)):
        yield (("effects", "gravity", "posture"), f"is {parameters.posture}, but orientation begins otherwise; remove "
                                                  "posture (null), for orientation tells it")


def _check_time_lapse(parameters, output):
    key = ("effects", "gravity", "second_means")
    shown_as = output.second_means or 1.0
    if parameters.second_means != 1.0 and not math.isclose(shown_as, parameters.second_means):
        yield (key, f"is {parameters.second_means:g} s, but output.second_means is {shown_as:g} s; both must be the "
                    "same, so that clocks in pictures and curves tell the time of the turns")
    if parameters.second_means != 1.0 and parameters.jolts:
        yield (("effects", "gravity", "jolts"), "are there, but second_means is not 1 s: a jolt cannot be told in a "
                                                "time-lapse; remove one of them")


def _check_plane(parameters, dimension):
    if dimension != 2:
        return
    allowed = [name for name, direction in POSTURES.items() if direction[2] == 0.0]
    if parameters.orientation:
        if any(row[3] for row in parameters.orientation):
            yield (("effects", "gravity", "orientation"), "points out of the plane of a scene in two dimensions, but z "
                                                          "must be 0 in all lines")
        return
    postures = {("posture",): (parameters.posture, parameters.roll)} | {
        ("turns", i, "to"): (turn.to, turn.roll) for i, turn in enumerate(parameters.turns)}
    for key, (posture, roll) in postures.items():
        if posture not in allowed or roll:
            yield (("effects", "gravity", *key), f"is {posture}{' with a roll' if roll else ''}, which points out of "
                                                 f"the plane of a scene in two dimensions, but must be one of "
                                                 f"{', '.join(allowed)}")


def _falling_speed(directions, scales, gravity: float) -> float:
    """Speed of the fall from the top of the liquid to the wall below, with any direction of gravity, m/s."""
    heights = []
    for direction in directions:
        up = -np.array(direction[: scales.settings.dimension])
        box = np.outer([0.0, 1.0], scales.start.box)
        tops = [np.maximum(up * block.lower, up * block.upper).sum() for block in scales.start.blocks]
        heights.append(max(tops) - np.minimum(up * box[0], up * box[1]).sum())
    return math.sqrt(2.0 * gravity * max(heights))


def _advice_on_other_gravity(parameters, eye):
    if eye is not None and parameters.magnitude and not 9.0 <= parameters.magnitude <= 10.5:
        yield (("effects", "gravity", "magnitude"),
               f"is {parameters.magnitude:g} m/s2, but on Earth it is 9.81 m/s2, which is 1 g")


@data_oriented
class Gravity(Effect):
    """Weight of each particle, less that of the reference density."""

    name = "gravity"
    Parameters = GravityParameters
    uses = ("mass", "volume", "position")
    does = frozenset({WEIGHS})
    checks = (_check_turns, _check_postures, _check_orientation, _check_time_lapse, _check_plane)
    doubts = (_advice_on_other_gravity,)

    def __init__(self, parameters, solver):
        super().__init__(parameters, solver)
        densities = [liquid.density for liquid in solver.liquids]
        # In a full cavity any reference is exact; the lighter one keeps accelerations bounded at gas-like ratios.
        self.reference_density = min(densities) if are_unlike(densities) else densities[0]
        if not solver.settings.closed or self._may_fall(solver.settings.periods):
            self.reference_density = 0.0
        self.vector = ti.Vector.field(solver.dimension, real(), shape=())

    def _may_fall(self, periods) -> bool:
        """Whether anything may pull along a periodic axis, in which no wall holds the liquids."""
        course = self.parameters.course
        pulls = [course.first, *(jolt.acceleration for jolt in self.parameters.jolts)]
        along = [axis for axis, period in enumerate(periods) if period]
        return any(course.moves or any(pull[axis] for pull in pulls) for axis in along)

    @classmethod
    def idle(cls, parameters, settings) -> str:
        return "" if parameters.weighs_liquids else "its magnitude is 0 m/s2, and there are no jolts"

    @classmethod
    def weight_of(cls, parameters) -> float:
        return parameters.magnitude

    @classmethod
    def largest_weight_of(cls, parameters, dimension: int) -> float:
        return parameters.magnitude + parameters.largest_jolt(dimension)

    @classmethod
    def down_at_start(cls, parameters) -> np.ndarray:
        return np.array(parameters.course.first)

    @classmethod
    def held(cls, parameters, duration):
        return parameters.course.held(duration)

    @classmethod
    def spans(cls, parameters, fill, cavity_volume):
        turns = parameters.course.turns()
        if len(turns) > MOST_SPANS:
            yield "turns", turns[0].begin, turns[-1].end
        else:
            yield from (("turn", turn.begin, turn.end) for turn in turns)
        for jolt in parameters.jolts:
            yield "jolt", jolt.start, jolt.start + jolt.duration

    @classmethod
    def events(cls, parameters, fill, cavity_volume):
        for turn in parameters.course.turns():
            yield f"turn to {turn.words}", turn.begin, turn.end
        for jolt in parameters.jolts:
            yield "jolt", jolt.start, jolt.start + jolt.duration

    @classmethod
    def advice(cls, parameters, scales, limits):
        gravity, closed = scales.gravity or EARTH_GRAVITY, scales.settings.closed
        if parameters and parameters.magnitude == 0.0 and not parameters.jolts:
            yield Advice(WARNING, cls.name, "does nothing: its magnitude is 0 m/s2, not above 0")
        acceleration = scales.buoyancy(gravity)
        directions = parameters.course.directions if parameters else [POSTURES["upright"]]
        speed = scales.buoyant_speed(gravity) if closed else _falling_speed(directions, scales, gravity)
        reach = scales.reach(acceleration, speed)
        if not scales.gravity:
            if parameters is None and is_seen(reach, scales):
                cause = (f"the liquids differ by {scales.density_difference:.3g} kg/m3" if closed else
                         "the liquid has a free surface")
                yield Advice(WARNING, cls.name, f"is missing and would be seen: {cause}, and 9.81 m/s2 would move them "
                                                f"by up to {times(reach, scales)}")
        elif acceleration == 0.0:
            yield Advice(WARNING, cls.name, "cannot be seen: the liquids differ by 0 kg/m3, not by more than 0, and in "
                                            "a full cavity equal weights only shift the pressure")
        elif not is_seen(reach, scales):
            yield Advice(WARNING, cls.name, f"cannot be seen: within the scene it moves liquid by "
                                            f"{times(reach, scales)}")
        else:
            yield Advice(SEEN_EFFECT, cls.name, f"within the scene it can move liquid by {times(reach, scales)}")
        if parameters:
            yield from cls._advice_on_turns(parameters, scales)

    @classmethod
    def _advice_on_turns(cls, parameters, scales):
        events = [(f"the turn to {turn.words}", turn.begin) for turn in parameters.course.turns()]
        for what, start in events + [("a jolt", jolt.start) for jolt in parameters.jolts]:
            if start >= scales.duration:
                yield Advice(WARNING, cls.name, f"{what} is not reached: it starts at {shown(start, 's')}, but the "
                                                f"scene ends at {shown(scales.duration, 's')}")
        if parameters.second_means != 1.0:
            settles = cls._settling_time(parameters, scales)
            held = [end - begin for begin, end, *_ in parameters.course.held(scales.duration)]
            brief = sum(time < settles for time in held)
            yield Advice(WARNING if brief else NOTE, cls.name,
                         f"a time-lapse: {long_time(parameters.second_means)} of the turns pass in a simulated second, "
                         f"but the liquids settle in their own time, about {shown(settles, 's')} after a turn, which "
                         f"looks like {long_time(settles * parameters.second_means)}; "
                         + (f"{brief} of {len(held)} postures are held for less, and do not come to rest (a patient "
                            "who holds one for a minute does)" if brief else
                            "a posture that is held for longer ends as a patient has it after a minute"))
        buoyancy, inertia = scales.buoyancy(scales.gravity), cls.omitted_acceleration(parameters, scales)
        if buoyancy and inertia > INERTIA_OF_TURN * buoyancy:
            yield Advice(NOTE, cls.name, "the inertial forces of a turn are left out: the wall accelerates by up to "
                                         f"{shown(inertia, 'm/s2')}, {inertia / buoyancy:.2g} times the buoyancy "
                                         f"(small below {INERTIA_OF_TURN:g})")

    @classmethod
    def _settling_time(cls, parameters, scales) -> float:
        """Time that a drop of half the length of the cavity takes through it, in the stiffest liquid, s.

        At the speed of a drop in a far stiffer liquid, drho g a^2 / (3 mu) with a = L/2, over two lengths.
        """
        weight = scales.density_difference * parameters.magnitude * scales.length
        viscous = 24.0 * scales.stiffest.dynamic_viscosity / weight if weight else 0.0
        return max(viscous, math.sqrt(scales.length / scales.buoyancy(parameters.magnitude)) if weight else 0.0)

    @classmethod
    def speeds(cls, parameters, scales):
        gravity, closed = parameters.magnitude, scales.settings.closed
        if gravity and not closed:
            yield Quantity("fall", _falling_speed(parameters.course.directions, scales, gravity), "m/s",
                           "sqrt(2 g H), fall from the top of the liquid to the wall below")
        elif gravity:
            yield Quantity("buoyant", scales.buoyant_speed(gravity), "m/s",
                           "the smaller of sqrt(2 g drho/rho L) and, with viscosity, drho g L2/mu of the stiffest "
                           "liquid")
        jolted = []
        for jolt in parameters.jolts:
            peak = float(np.linalg.norm(jolt.acceleration[: scales.settings.dimension]))
            impulse = scales.buoyancy(peak) * jolt.duration * 2.0 / math.pi
            jolted.append(min(impulse, scales.buoyant_speed(peak)) if closed else impulse)
        if jolted:
            yield Quantity("jolt", max(jolted), "m/s",
                           "impulse of the jolt on the difference of weights, at most its buoyant speed")

    @classmethod
    def wall_speeds(cls, parameters, scales):
        moves = parameters.moves_within(scales.duration)
        if moves:
            speed = max((PEAK_RATE if move.smooth else 1.0) * move.angle / (move.end - move.begin) * scales.length
                        for move in moves)
            yield Quantity("turn", speed, "m/s", "of the wall; not counted, for a turn changes the direction of "
                                                 "gravity only")

    @classmethod
    def omitted_acceleration(cls, parameters, scales) -> float:
        # What a time-lapse hurries is no acceleration of a head, and that between lines of a file is not known.
        scale = parameters.second_means
        return max((PEAK_ACCELERATION * move.angle / (scale * (move.end - move.begin))**2 * scales.length
                    for move in parameters.moves_within(scales.duration) if move.smooth), default=0.0)

    @classmethod
    def time_scales(cls, parameters, scales):
        gravity, closed, length = parameters.magnitude, scales.settings.closed, scales.length
        viscosity = scales.stiffest.dynamic_viscosity
        if scales.buoyancy(gravity) > 0.0:
            yield Quantity("buoyancy" if closed else "gravity", math.sqrt(length / scales.buoyancy(gravity)), "s",
                           "sqrt(L rho/(drho g)): difference of weights against inertia" if closed else
                           "sqrt(L/g): free fall through L")
            if closed and scales.viscous and viscosity > 0.0:
                yield Quantity("buoyancy, viscous", viscosity / (scales.density_difference * gravity * length), "s",
                               "mu/(drho g L) of the stiffest liquid: difference of weights against viscosity")
        turns = parameters.course.turns()
        if turns:
            yield Quantity("turn", min(turn.end - turn.begin for turn in turns), "s", "shortest turn of the posture")

    @classmethod
    def wave_speeds(cls, parameters, scales):
        if scales.settings.closed:  # the fall through the cavity, whatever viscosity makes of it, and jolts in full
            yield math.sqrt(2.0 * scales.buoyancy(parameters.magnitude) * scales.width)
            for jolt in parameters.jolts:
                yield 2.0 / math.pi * math.hypot(*jolt.acceleration) * jolt.duration

    def direction(self, time: float) -> np.ndarray:
        """Direction of gravity in the eye at `time`, (3,); turns follow the minimum-jerk profile."""
        return self.solver.into_eye(self.parameters.course.at(time), time)

    def at(self, time: float) -> np.ndarray:
        """Gravity less the acceleration of the head at `time`, in the eye, (dimension,), m/s^2."""
        total = self.parameters.magnitude * self.direction(time)
        for jolt in self.parameters.jolts:
            phase = (time - jolt.start) / jolt.duration
            if 0.0 < phase < 1.0:
                total = total - self.solver.into_eye(np.sin(np.pi * phase) * np.array(jolt.acceleration), time)  # (G3)
        return total[: self.solver.dimension]

    gravity_at = at
    down_at = direction

    def weight_at(self, time: float) -> np.ndarray:
        return self.parameters.magnitude * self.direction(time)

    def expected_energy(self) -> float:
        solver, fall = self.solver, 0.0
        share = max(abs(1.0 - self.reference_density / liquid.density) for liquid in solver.liquids)
        position = solver.particles.to_numpy("position").astype(float)
        for direction in self.parameters.course.directions:
            up = -np.array(direction)[: solver.dimension]
            bottom = (solver.walls.position.to_numpy() @ up).min()
            height = (position @ up).max() - bottom if np.any(up) else 0.0
            fall = max(fall, share * self.parameters.magnitude * height)
        return fall

    def expected_speeds(self):
        for jolt in self.parameters.jolts:
            yield np.linalg.norm(jolt.acceleration) * jolt.duration * 2.0 / np.pi

    def largest_acceleration(self) -> float:
        """Largest acceleration that gravity gives any liquid at the present time, m/s^2."""
        share = max(abs(1.0 - self.reference_density / liquid.density) for liquid in self.solver.liquids)
        return share * float(np.linalg.norm(self.at(self.solver.time)))

    def stable_time_step(self) -> float:
        """A share of the jolt that the next step falls into, s: (A6) of docs/methods/time_step.md."""
        now, longest = self.solver.time, self.solver.settings.numerics.maximum_time_step
        return min((jolt.duration for jolt in self.parameters.jolts
                    if jolt.start - longest < now < jolt.start + jolt.duration), default=float("inf")) / STEPS_OF_JOLT

    def prepare(self, dt: float) -> None:
        self.vector[None] = ti.Vector(list(self.at(self.solver.time)))

    @ti.func
    def body_acceleration(self, i):
        # (G1)
        return (1.0 - self.reference_density * self.particles.volume[i] / self.particles.mass[i]) * self.vector[None]

    @ti.func
    def potential(self, i):
        """Hydrostatic pressure of the reference density, Pa, zero at the origin."""
        return self.reference_density * self.vector[None].dot(self.particles.position[i])
