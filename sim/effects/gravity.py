"""Gravity in the frame of the eye: posture and its turns over time.

In a completely full closed cavity a force field that is a gradient only shifts the pressure, so the weight of a
reference density is taken out of the solve: a_i = (1 - rho_ref/rho_i) g. The solver then meets the small buoyancy
instead of the large weight. Where the liquids have a free surface or a periodic axis, along which they may fall for
ever, rho_ref is 0. The inertial forces of a turn (some 0.02 m/s^2 at one second a quarter turn) are left out. Where
`eye_rotation` turns the eye in the head, posture and jolts are those of the head. Equations: docs/methods/gravity.md.
"""
import dataclasses
import itertools
import math

import numpy as np
import taichi as ti

from sim.advice import EARTH_GRAVITY, NOTE, SEEN_EFFECT, WARNING, Advice, Quantity, is_seen, shown, times
from sim.effects.effect import WEIGHS, Effect
from sim.parameters import parameter
from sim.runtime import real

POSTURES = {  # direction of gravity in the eye: x to the patient's left, y superior, z anterior along the optic axis
    "upright": (0.0, -1.0, 0.0),
    "supine": (0.0, 0.0, -1.0),
    "prone": (0.0, 0.0, 1.0),
    "left_side": (1.0, 0.0, 0.0),
    "right_side": (-1.0, 0.0, 0.0),
}
# A turn follows the minimum-jerk profile: its peak rate is 15/8 and its peak acceleration 10/sqrt(3) of angle over
# duration and duration squared.
PEAK_RATE, PEAK_ACCELERATION = 15.0 / 8.0, 10.0 / math.sqrt(3.0)
INERTIA_OF_TURN = 1.0  # the inertial forces of a turn, which are left out, over the buoyancy, from which that is noted


@dataclasses.dataclass(frozen=True)
class Turn:
    """A turn of the patient from the posture held before to ``to``."""

    start: float = parameter(unit="s", minimum=0.0, meaning="time at which the turn begins")
    to: str = parameter(choices=tuple(POSTURES), meaning="posture after the turn")
    duration: float = parameter(1.0, unit="s", exclusive_minimum=0.0, meaning="time the turn takes")


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
    turns: tuple[Turn, ...] = parameter((), meaning="turns of the patient, in order, not overlapping")
    jolts: tuple[Jolt, ...] = parameter((), meaning="jolts of the head")

    @property
    def postures(self) -> list[str]:
        """Postures of the patient, one after the other."""
        return [self.posture, *(turn.to for turn in self.turns)]

    def largest_jolt(self, dimension: int) -> float:
        """Largest acceleration in a jolt, m/s2."""
        return max((math.hypot(*jolt.acceleration[:dimension]) for jolt in self.jolts), default=0.0)

    def turn_angles(self, duration: float) -> list[tuple[Turn, float]]:
        """Turns that begin within a duration, s, with their angles in rad."""
        cosines = [float(np.dot(POSTURES[one], POSTURES[other])) for one, other in itertools.pairwise(self.postures)]
        return [(turn, math.acos(cosine)) for turn, cosine in zip(self.turns, cosines, strict=True)
                if turn.start < duration]


def _check_turns(parameters):
    for index, (turn, following) in enumerate(itertools.pairwise(parameters.turns)):
        end = turn.start + turn.duration
        if following.start < end - 1e-9:
            yield (("effects", "gravity", "turns", index + 1, "start"),
                   f"is {following.start:g} s, but the turn before ends at {end:g} s, and turns must not overlap")


def _check_plane(parameters, dimension):
    if dimension != 2:
        return
    allowed = [name for name, direction in POSTURES.items() if direction[2] == 0.0]
    postures = {("posture",): parameters.posture} | {
        ("turns", i, "to"): turn.to for i, turn in enumerate(parameters.turns)}
    for key, posture in postures.items():
        if posture not in allowed:
            yield (("effects", "gravity", *key), f"is {posture}, which points out of the plane of a scene in two "
                                                 f"dimensions, but must be one of {', '.join(allowed)}")


def _falling_speed(postures, scales, gravity: float) -> float:
    """Speed of the fall from the top of the liquid to the wall below, in any of the postures, m/s."""
    heights = []
    for posture in postures:
        up = -np.array(POSTURES[posture][: scales.scene.dimension])
        box = np.outer([0.0, 1.0], scales.scene.container.size)
        tops = [np.maximum(up * block.lower, up * block.upper).sum() for block in scales.scene.blocks]
        heights.append(max(tops) - np.minimum(up * box[0], up * box[1]).sum())
    return math.sqrt(2.0 * gravity * max(heights))


def rotate_towards(start, end, fraction: float) -> np.ndarray:
    """Unit vector on the great circle from `start` to `end`; opposite vectors turn about the horizontal x axis."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    angle = np.arccos(np.clip(start @ end, -1.0, 1.0))
    side = end - (start @ end) * start
    if np.linalg.norm(side) < 1e-9:
        side = np.cross(start, (1.0, 0.0, 0.0)) if abs(start[0]) < 0.9 else np.cross(start, (0.0, 1.0, 0.0))
    side = side / np.linalg.norm(side)
    return np.cos(fraction * angle) * start + np.sin(fraction * angle) * side


@ti.data_oriented
class Gravity(Effect):
    """Weight of each particle, less that of the reference density."""

    name = "gravity"
    Parameters = GravityParameters
    uses = ("mass", "volume", "position")
    does = frozenset({WEIGHS})
    checks = (_check_turns, _check_plane)

    def __init__(self, parameters, solver):
        super().__init__(parameters, solver)
        densities = [liquid.density for liquid in solver.liquids]
        # In a full cavity any reference is exact; the lighter one keeps accelerations bounded at gas-like ratios.
        self.reference_density = densities[0] if max(densities) <= 2.0 * min(densities) else min(densities)
        if not solver.settings.closed or any(solver.settings.periods):
            self.reference_density = 0.0
        self.vector = ti.Vector.field(solver.dimension, real(), shape=())

    @classmethod
    def idle(cls, parameters, settings) -> str:
        return "" if parameters.magnitude or parameters.jolts else "its magnitude is 0 m/s2, and there are no jolts"

    @classmethod
    def weight_of(cls, parameters) -> float:
        return parameters.magnitude

    @classmethod
    def largest_weight_of(cls, parameters, dimension: int) -> float:
        return parameters.magnitude + parameters.largest_jolt(dimension)

    @classmethod
    def down_at_start(cls, parameters) -> np.ndarray:
        return np.array(POSTURES[parameters.posture])

    @classmethod
    def spans(cls, parameters, fill, cavity_volume):
        for what, events in (("turn", parameters.turns), ("jolt", parameters.jolts)):
            for one in events:
                yield what, one.start, one.start + one.duration

    @classmethod
    def events(cls, parameters, fill, cavity_volume):
        for turn in parameters.turns:
            yield f"turn to {turn.to}", turn.start, turn.start + turn.duration
        for jolt in parameters.jolts:
            yield "jolt", jolt.start, jolt.start + jolt.duration

    @classmethod
    def advice(cls, parameters, scales, limits):
        gravity, closed = scales.gravity or EARTH_GRAVITY, scales.scene.closed
        if parameters and parameters.magnitude == 0.0 and not parameters.jolts:
            yield Advice(WARNING, cls.name, "does nothing: its magnitude is 0 m/s2, not above 0")
        acceleration = scales.buoyancy(gravity)
        postures = parameters.postures if parameters else ["upright"]
        speed = scales.buoyant_speed(gravity) if closed else _falling_speed(postures, scales, gravity)
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
        events = [(f"the turn to {turn.to}", turn) for turn in parameters.turns]
        for what, event in events + [("a jolt", jolt) for jolt in parameters.jolts]:
            if event.start >= scales.duration:
                yield Advice(WARNING, cls.name, f"{what} is not reached: it starts at {shown(event.start, 's')}, but "
                                                f"the scene ends at {shown(scales.duration, 's')}")
        buoyancy, inertia = scales.buoyancy(scales.gravity), cls.omitted_acceleration(parameters, scales)
        if buoyancy and inertia > INERTIA_OF_TURN * buoyancy:
            yield Advice(NOTE, cls.name, "the inertial forces of a turn are left out: the wall accelerates by up to "
                                         f"{shown(inertia, 'm/s2')}, {inertia / buoyancy:.2g} times the buoyancy "
                                         f"(small below {INERTIA_OF_TURN:g})")

    @classmethod
    def speeds(cls, parameters, scales):
        gravity, closed = parameters.magnitude, scales.scene.closed
        if gravity and not closed:
            yield Quantity("fall", _falling_speed(parameters.postures, scales, gravity), "m/s",
                           "sqrt(2 g H), fall from the top of the liquid to the wall below")
        elif gravity:
            yield Quantity("buoyant", scales.buoyant_speed(gravity), "m/s",
                           "the smaller of sqrt(2 g drho/rho L) and, with viscosity, drho g L2/mu of the stiffest "
                           "liquid")
        jolted = []
        for jolt in parameters.jolts:
            peak = float(np.linalg.norm(jolt.acceleration[: scales.scene.dimension]))
            impulse = scales.buoyancy(peak) * jolt.duration * 2.0 / math.pi
            jolted.append(min(impulse, scales.buoyant_speed(peak)) if closed else impulse)
        if jolted:
            yield Quantity("jolt", max(jolted), "m/s",
                           "impulse of the jolt on the difference of weights, at most its buoyant speed")

    @classmethod
    def wall_speeds(cls, parameters, scales):
        turns = parameters.turn_angles(scales.duration)
        if turns:
            speed = max(PEAK_RATE * angle / turn.duration * scales.length for turn, angle in turns)
            yield Quantity("turn", speed, "m/s", "of the wall; not counted, for a turn changes the direction of "
                                                 "gravity only")

    @classmethod
    def omitted_acceleration(cls, parameters, scales) -> float:
        return max((PEAK_ACCELERATION * angle / turn.duration**2 * scales.length
                    for turn, angle in parameters.turn_angles(scales.duration)), default=0.0)

    @classmethod
    def time_scales(cls, parameters, scales):
        gravity, closed, length = parameters.magnitude, scales.scene.closed, scales.length
        viscosity = scales.stiffest.dynamic_viscosity
        if scales.buoyancy(gravity) > 0.0:
            yield Quantity("buoyancy" if closed else "gravity", math.sqrt(length / scales.buoyancy(gravity)), "s",
                           "sqrt(L rho/(drho g)): difference of weights against inertia" if closed else
                           "sqrt(L/g): free fall through L")
            if closed and scales.viscous and viscosity > 0.0:
                yield Quantity("buoyancy, viscous", viscosity / (scales.density_difference * gravity * length), "s",
                               "mu/(drho g L) of the stiffest liquid: difference of weights against viscosity")
        if parameters.turns:
            yield Quantity("turn", min(turn.duration for turn in parameters.turns), "s",
                           "shortest turn of the posture")

    @classmethod
    def wave_speeds(cls, parameters, scales):
        if scales.scene.closed:  # the fall through the cavity, whatever viscosity makes of it, and jolts in full
            yield math.sqrt(2.0 * scales.buoyancy(parameters.magnitude) * scales.width)
            for jolt in parameters.jolts:
                yield 2.0 / math.pi * math.hypot(*jolt.acceleration) * jolt.duration

    def direction(self, time: float) -> np.ndarray:
        """Direction of gravity in the eye at `time`, (3,); turns follow the minimum-jerk profile."""
        held = np.asarray(POSTURES[self.parameters.posture])
        for turn in self.parameters.turns:
            s = min(max((time - turn.start) / turn.duration, 0.0), 1.0)
            held = rotate_towards(held, POSTURES[turn.to], s**3 * (10.0 - 15.0 * s + 6.0 * s * s))  # (G2)
        return self.solver.into_eye(held, time)

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
        for posture in self.parameters.postures:
            up = -np.array(POSTURES[posture])[: solver.dimension]
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
