"""The eye turns in the head: saccades and oscillations, in the frame of the eye, in which the wall rests.

Where the eye has the angular velocity w, liquid at r from the center of rotation with the velocity u, seen from the
eye, is accelerated by

    -dw/dt x r - 2 w x u - w x (w x r)      (Euler, Coriolis, centrifugal), (G4).

The first is taken as the change of w over the whole step, so that the turn of the liquid is as large as that of the
eye whatever the step; the second turns u without changing its length [boris1970], so that it does no work. Gravity,
given in the axes of the head, turns the other way round in the eye.

A saccade of amplitude A lasts D with the peak rate P. Both follow the main sequence: D = 21 ms + 2.2 ms/deg A
[carpenter1988] and P = 1.64 A/D. Its rate is P (4 s (1 - s))^n, s the share of the time that is over, with the power n
that makes the angle A. Equations: docs/methods/gravity.md.
"""
import dataclasses
import functools
import itertools
import math

import numpy as np

from sim.advice import NOTE, SEEN_EFFECT, WARNING, Advice, Quantity, is_seen, shown, times
from sim.backend import data_oriented, real, ti
from sim.effects.effect import Effect
from sim.measures import Measure
from sim.parameters import parameter

SHORTEST, PER_ANGLE = 21e-3, 2.2e-3 / math.radians(1.0)  # s and s/rad, duration of a saccade: 2.2 ms per degree
PEAK_OVER_MEAN = 1.64  # rate of a saccade
POWERS = (0.25, 8.0)  # n, between a rate that is nearly constant and a sharp peak
STEPS = 40  # time steps in a saccade, or in half a period, at least


def _peak_over_mean(power: float) -> float:
    """Peak over mean of the rate (4 s (1 - s))^n."""
    return math.gamma(2.0 * power + 2.0) / (4.0**power * math.gamma(power + 1.0) ** 2)


SMALLEST_PEAK, LARGEST_PEAK = map(_peak_over_mean, POWERS)  # over the mean


@dataclasses.dataclass(frozen=True)
class Saccade:
    """A quick turn of the eye, or several back and forth."""

    start: float = parameter(unit="s", minimum=0.0, meaning="time at which the saccade begins")
    amplitude: float = parameter(unit="rad", minimum=0.0, maximum=math.radians(120.0),
                                 meaning="angle that the eye turns by")
    axis: tuple[float, float, float] = parameter(
        (0.0, 1.0, 0.0), minimum=-1.0, maximum=1.0,
        meaning="axis of the turn in the eye, of any length, by the right hand; (0, 1, 0) looks to the patient's left")
    duration: float | None = parameter(None, unit="s", exclusive_minimum=0.0,
                                       meaning="time it takes (default: by the main sequence)")
    peak_rate: float | None = parameter(None, unit="rad/s", exclusive_minimum=0.0,
                                        meaning="largest angular velocity (default: by the main sequence)")
    count: int = parameter(1, minimum=1, maximum=10000, meaning="number of saccades, every other one back again")
    interval: float = parameter(0.3, unit="s", exclusive_minimum=0.0, meaning="from one begin to the next")

    @property
    def lasts(self) -> float:
        """Duration D of one saccade, s."""
        return self.duration or SHORTEST + PER_ANGLE * self.amplitude

    @property
    def end(self) -> float:
        """Time at which the last saccade is over, s."""
        return self.start + (self.count - 1) * self.interval + self.lasts

    @property
    def peak_over_mean(self) -> float:
        """Largest over mean rate, P D/A."""
        return self.peak_rate * self.lasts / self.amplitude if self.peak_rate and self.amplitude else PEAK_OVER_MEAN

    @functools.cached_property
    def power(self) -> float:
        """The power n of the rate."""
        from scipy.optimize import brentq  # slow to import, and most scenes have no saccades

        return brentq(lambda n: _peak_over_mean(n) - self.peak_over_mean, *POWERS)

    @property
    def peak(self) -> float:
        """Largest angular velocity, rad/s."""
        return self.amplitude * self.peak_over_mean / self.lasts

    def _share(self, time: float) -> tuple[int, float]:
        """Which of the saccades is the last that has begun, -1 before the first, and the share of it that is over."""
        index = min(max(math.floor((time - self.start) / self.interval), -1), self.count - 1)
        return index, min(max((time - self.start - index * self.interval) / self.lasts, 0.0), 1.0)

    def angle(self, time: float) -> float:
        """Angle by which it has turned the eye at a time, rad."""
        index, share = self._share(time)
        if index < 0:
            return 0.0
        from scipy.special import betainc

        turned = float(betainc(self.power + 1.0, self.power + 1.0, share))
        return self.amplitude * (turned if index % 2 == 0 else 1.0 - turned)

    def rate(self, time: float) -> float:
        """Angular velocity at a time, rad/s."""
        index, share = self._share(time)
        if index < 0:
            return 0.0
        return (-1.0) ** index * self.peak * (4.0 * share * (1.0 - share)) ** self.power  # (G6)

    def scale(self, time: float, step: float) -> float:
        """Duration of the movement that a step from a time on falls into, s; infinite where there is none."""
        index, share = self._share(time + step)
        begun = index >= 0 and time < self.start + index * self.interval + self.lasts
        return self.lasts if begun and share > 0.0 else math.inf


@dataclasses.dataclass(frozen=True)
class Oscillation:
    """A turn back and forth without end, as a sine from the start of the scene on."""

    amplitude: float = parameter(unit="rad", minimum=0.0, maximum=math.radians(90.0),
                                 meaning="largest angle to either side")
    frequency: float = parameter(unit="Hz", exclusive_minimum=0.0, maximum=1000.0, meaning="periods per second")
    axis: tuple[float, float, float] = parameter(
        (0.0, 1.0, 0.0), minimum=-1.0, maximum=1.0, meaning="axis of the turn in the eye, of any length")

    @property
    def pulsation(self) -> float:
        """Pulsation 2 pi f, 1/s."""
        return 2.0 * math.pi * self.frequency

    @property
    def lasts(self) -> float:
        """Duration of a turn from one side to the other, half a period, s."""
        return 0.5 / self.frequency

    @property
    def peak(self) -> float:
        """Largest angular velocity, rad/s."""
        return self.amplitude * self.pulsation

    def angle(self, time: float) -> float:
        """Angle at a time, rad."""
        return self.amplitude * math.sin(self.pulsation * time)

    def rate(self, time: float) -> float:
        """Angular velocity at a time, rad/s."""
        return self.peak * math.cos(self.pulsation * time)  # (G7)

    def scale(self, time: float, step: float) -> float:
        """Duration of the movement that a step from a time on falls into, s."""
        return self.lasts


@dataclasses.dataclass(frozen=True)
class EyeRotationParameters:
    """Turns of the eye in the head, by saccades one after the other or by one oscillation."""

    saccades: tuple[Saccade, ...] = parameter((), meaning="saccades, in order, not overlapping")
    oscillation: Oscillation | None = parameter(None, meaning="turn back and forth without end, instead of saccades")
    center: tuple[float, float, float] = parameter(
        (0.0, 0.0, 0.0), unit="m", minimum=-0.1, maximum=0.1, meaning="center of the rotation")

    @property
    def movements(self) -> tuple:
        """All saccades, or the oscillation."""
        return self.saccades + ((self.oscillation,) if self.oscillation else ())

    @property
    def peak(self) -> float:
        """Largest angular velocity, rad/s."""
        return max((movement.peak for movement in self.movements), default=0.0)

    @property
    def shortest(self) -> float:
        """Duration of the shortest turn to one side, s."""
        return min((movement.lasts for movement in self.movements), default=math.inf)

    def angular_velocity(self, time: float) -> np.ndarray:
        """Angular velocity of the eye in its own axes, (3,), rad/s."""
        return sum((movement.rate(time) * unit(movement.axis) for movement in self.movements), np.zeros(3))

    def into_eye(self, vector: np.ndarray, time: float) -> np.ndarray:
        """A vector (3,) given in the axes of the head, in those of the eye, which agree where the eye looks ahead."""
        for movement in self.movements:  # a later one turns about the axis that the earlier ones have turned
            vector = turned(vector, unit(movement.axis), -movement.angle(time))
        return vector


def unit(axis) -> np.ndarray:
    """Unit vector (3,) along an axis."""
    return np.asarray(axis, float) / np.linalg.norm(axis)


def turned(vector: np.ndarray, axis: np.ndarray, angle: float) -> np.ndarray:
    """A vector turned about a unit vector by an angle in rad (Rodrigues)."""
    return (math.cos(angle) * vector + math.sin(angle) * np.cross(axis, vector)
            + (1.0 - math.cos(angle)) * (axis @ vector) * axis)


def _check_movements(parameters, dimension):
    key = ("effects", "eye_rotation")
    if parameters.saccades and parameters.oscillation:
        yield (*key, "oscillation"), "is given beside saccades, but an eye does one or the other"
    places = [(*key, "saccades", index) for index in range(len(parameters.saccades))]
    for place, saccade in zip(places, parameters.saccades, strict=True):
        if not SMALLEST_PEAK <= saccade.peak_over_mean <= LARGEST_PEAK:
            yield ((*place, "peak_rate"),
                   f"is {saccade.peak_over_mean:.3g} times the mean rate, but must be {SMALLEST_PEAK:.3g} to "
                   f"{LARGEST_PEAK:.3g} times it (amplitude over duration)")
        if saccade.count > 1 and saccade.interval < saccade.lasts - 1e-9:
            yield (*place, "interval"), (f"is {saccade.interval:g} s, but each of the saccades takes "
                                         f"{saccade.lasts:g} s, and they must not overlap")
    for place, (one, following) in zip(places[1:], itertools.pairwise(parameters.saccades), strict=True):
        if following.start < one.end - 1e-9:
            yield ((*place, "start"), f"is {following.start:g} s, but the saccade before ends at {one.end:g} s, and "
                                      "saccades must not overlap")
    movements = [((*key, "oscillation"), parameters.oscillation)] if parameters.oscillation else []
    for place, movement in [*movements, *zip(places, parameters.saccades, strict=True)]:
        if not any(movement.axis):
            yield (*place, "axis"), "is (0, 0, 0), but must have a direction"
        elif dimension == 2 and any(movement.axis[:2]):
            yield (*place, "axis"), "must be along z in two dimensions, as in [0, 0, 1]"


def _gaze(parameters: EyeRotationParameters, time: float) -> float:
    ahead = parameters.into_eye(np.array([0.0, 0.0, 1.0]), time)
    return np.degrees(np.arccos(np.clip(ahead[-1], -1.0, 1.0)))


def _eye_rate(parameters: EyeRotationParameters, time: float) -> float:
    return np.degrees(np.linalg.norm(parameters.angular_velocity(time)))


@data_oriented
class EyeRotation(Effect):
    """Inertial forces in the frame of an eye that turns."""

    name = "eye_rotation"
    Parameters = EyeRotationParameters
    uses = ("position", "velocity")
    periodic = False
    turns_eye = True
    checks = (_check_movements,)
    measures = (
        Measure("gaze", "deg", "angle between the optic axis and straight ahead", _gaze, of_eye=True),
        Measure("eye_rate", "deg/s", "angular velocity of the eye", _eye_rate, of_eye=True),
    )

    def __init__(self, parameters, solver):
        super().__init__(parameters, solver)
        self.dimension = solver.dimension
        self.center = ti.Vector(list(parameters.center[: solver.dimension]))
        # Means over a step, along z alone in two dimensions: dw/dt and w, and w times the step.
        self.acceleration, self.rate, self.turn = (ti.Vector.field(3, real(), shape=()) for _ in range(3))

    @classmethod
    def idle(cls, parameters, settings) -> str:
        return "" if parameters.peak else "the eye turns by 0 deg"

    @classmethod
    def into_eye(cls, parameters, vector: np.ndarray, time: float) -> np.ndarray:
        return parameters.into_eye(vector, time)

    @classmethod
    def spans(cls, parameters, fill, cavity_volume):
        for one in parameters.saccades if not parameters.oscillation else ():
            yield "saccades", one.start, one.end

    @classmethod
    def advice(cls, parameters, scales, limits):
        if parameters is None:
            return
        for saccade in parameters.saccades:
            if saccade.end > scales.duration:
                yield Advice(WARNING, cls.name, f"a saccade is not reached or not over: the last one ends at "
                                                f"{shown(saccade.end, 's')}, but the scene at "
                                                f"{shown(scales.duration, 's')}")
        way = max((one.amplitude for one in parameters.movements), default=0.0) * scales.length
        if not is_seen(way, scales):
            yield Advice(WARNING, cls.name, f"cannot be seen: the wall moves by {times(way, scales)}")
            return
        yield Advice(SEEN_EFFECT, cls.name, f"the wall moves by {times(way, scales)}, at up to "
                                            f"{shown(parameters.peak * scales.length, 'm/s')}")
        if not scales.viscous:
            yield Advice(WARNING, cls.name, "drags nothing along: the scene has no viscosity, so the liquid slips "
                                            "along a round wall")
            return
        for liquid in scales.liquids:
            layer = math.sqrt(2.0 * liquid.dynamic_viscosity / liquid.density * parameters.shortest / math.pi)
            if not is_seen(layer, scales):
                yield Advice(NOTE, cls.name, f"the layer of {liquid.name} that the wall drags along is not resolved: "
                                             f"{times(layer, scales)}; its shear stress at the wall is too low")

    @classmethod
    def speeds(cls, parameters, scales):
        yield Quantity("rotation", parameters.peak * scales.length, "m/s",
                       "largest speed of the wall in a saccade or oscillation of the eye")

    @classmethod
    def time_scales(cls, parameters, scales):
        yield Quantity("rotation", parameters.shortest, "s",
                       "shortest saccade, or half a period of the oscillation")

    def expected_speeds(self):
        yield 0.5 * self.parameters.peak * self.solver.walls.extent  # the wall, which the liquid lags behind

    def stable_time_step(self) -> float:
        """A share of the movement that the next step falls into, s: (A6) of docs/methods/time_step.md."""
        longest = self.solver.settings.numerics.maximum_time_step
        return min(movement.scale(self.solver.time, longest) for movement in self.parameters.movements) / STEPS

    def prepare(self, dt: float) -> None:
        begin, end = (self.parameters.angular_velocity(time) for time in (self.solver.time, self.solver.time + dt))
        rate = 0.5 * (begin + end)
        self.rate[None] = ti.Vector(list(rate))
        self.turn[None] = ti.Vector(list(rate * dt))
        self.acceleration[None] = ti.Vector(list((end - begin) / dt if dt else np.zeros(3)))

    @ti.func
    def _cross(self, w, v):
        """w x v; in two dimensions w points out of the plane."""
        result = v * 0.0
        if ti.static(self.dimension == 2):
            result = ti.Vector([-w[2] * v[1], w[2] * v[0]])
        if ti.static(self.dimension == 3):
            result = w.cross(v)
        return result

    @ti.func
    def body_acceleration(self, i):
        r = self.particles.position[i] - self.center
        u = self.particles.velocity[i]
        rate, turn = self.rate[None], self.turn[None]
        a = -self._cross(self.acceleration[None], r) - self._cross(rate, self._cross(rate, r))
        # Half the angle 2 w dt of the turn has the tangent w dt.
        s = 2.0 / (1.0 + turn.norm_sqr())
        return a - s * self._cross(rate, u - self._cross(turn, u))  # (G5)
