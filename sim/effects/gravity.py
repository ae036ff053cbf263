"""Gravity in the frame of the eye: posture and its turns over time.

In a completely full closed cavity a force field that is a gradient only shifts the pressure, so the weight of a
reference density is taken out of the solve: a_i = (1 - rho_ref/rho_i) g. The solver then meets the small buoyancy
instead of the large weight. Where the liquids have a free surface or a periodic axis, along which they may fall for
ever, rho_ref is 0. The inertial forces of a turn (some 0.02 m/s^2 at one second a quarter turn) are left out. Where
`eye_rotation` turns the eye in the head, posture and jolts are those of the head. Equations: docs/methods/gravity.md.
"""
import dataclasses

import numpy as np
import taichi as ti

from sim.effects.effect import Effect
from sim.effects.eye_rotation import EyeRotationParameters
from sim.parameters import parameter
from sim.runtime import real

POSTURES = {  # direction of gravity in the eye: x to the patient's left, y superior, z anterior along the optic axis
    "upright": (0.0, -1.0, 0.0),
    "supine": (0.0, 0.0, -1.0),
    "prone": (0.0, 0.0, 1.0),
    "left_side": (1.0, 0.0, 0.0),
    "right_side": (-1.0, 0.0, 0.0),
}


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

    def __init__(self, parameters, solver):
        super().__init__(parameters, solver)
        densities = [liquid.density for liquid in solver.liquids]
        # In a full cavity any reference is exact; the lighter one keeps accelerations bounded at gas-like ratios.
        self.reference_density = densities[0] if max(densities) <= 2.0 * min(densities) else min(densities)
        if not solver.settings.closed or any(solver.settings.periods):
            self.reference_density = 0.0
        self.vector = ti.Vector.field(solver.dimension, real(), shape=())
        self.rotation = next((p for p in solver.settings.effects if isinstance(p, EyeRotationParameters)), None)

    @classmethod
    def idle(cls, parameters, settings) -> str:
        return "" if parameters.magnitude or parameters.jolts else "its magnitude is 0 m/s2, and there are no jolts"

    def direction(self, time: float) -> np.ndarray:
        """Direction of gravity in the eye at `time`, (3,); turns follow the minimum-jerk profile."""
        held = np.asarray(POSTURES[self.parameters.posture])
        for turn in self.parameters.turns:
            s = min(max((time - turn.start) / turn.duration, 0.0), 1.0)
            held = rotate_towards(held, POSTURES[turn.to], s**3 * (10.0 - 15.0 * s + 6.0 * s * s))  # (G2)
        return self._in_eye(held, time)

    def _in_eye(self, vector: np.ndarray, time: float) -> np.ndarray:
        """A vector (3,) of the head in the axes of the eye."""
        return self.rotation.into_eye(vector, time) if self.rotation else vector

    def at(self, time: float) -> np.ndarray:
        """Gravity less the acceleration of the head at `time`, in the eye, (dimension,), m/s^2."""
        total = self.parameters.magnitude * self.direction(time)
        for jolt in self.parameters.jolts:
            phase = (time - jolt.start) / jolt.duration
            if 0.0 < phase < 1.0:
                total = total - self._in_eye(np.sin(np.pi * phase) * np.array(jolt.acceleration), time)  # (G3)
        return total[: self.solver.dimension]

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
