"""Gravity in the frame of the eye: posture and its turns over time."""
import dataclasses

from sim.effects.effect import Effect
from sim.parameters import parameter

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
class GravityParameters:
    """Weight of the liquids."""

    magnitude: float = parameter(9.81, unit="m/s**2", minimum=0.0, maximum=200.0, meaning="acceleration of gravity")
    posture: str = parameter("upright", choices=tuple(POSTURES), meaning="posture of the patient at the start")
    turns: tuple[Turn, ...] = parameter((), meaning="turns of the patient, in order, not overlapping")


class Gravity(Effect):
    name = "gravity"
    Parameters = GravityParameters
