"""What happens in a scene that its curves show: the end of an injection, turns of the posture, saccades."""
import dataclasses
from collections.abc import Mapping

import numpy as np

from pipeline.scenes.model import Scene
from sim.effects import REGISTRY

FOR_DIGESTS = "runs effects"


@dataclasses.dataclass(frozen=True)
class Event:
    """An event in words, from ``begin`` to ``end``, s; at a moment both are the same."""

    words: str
    begin: float
    end: float


def events_of(scene: Scene, table: Mapping[str, np.ndarray], cavity_volume: float) -> list[Event]:
    """Return the events of a scene within its duration, in the order of time.

    Parameters
    ----------
    table : metrics, column -> (frames,), whose first volumes tell what is in the cavity at the start.
    cavity_volume : m3 (m2 in 2D).
    """
    fill = fill_in_table(scene, table, cavity_volume)
    found = [Event(words.replace("_", " "), begin, end) for name, parameters in scene.effects.items()
             for words, begin, end in REGISTRY[name].events(parameters, fill, cavity_volume)]
    return sorted((one for one in found if 0.0 < one.begin <= scene.output.duration), key=lambda one: one.begin)


def fill_in_table(scene: Scene, table: Mapping[str, np.ndarray], cavity_volume: float) -> dict[str, float]:
    """Return the share of the cavity, of a volume in m3 (m2 in 2D), that each liquid holds in the first frame."""
    start = {liquid.name: table.get(f"volume_{liquid.name} [mL]") for liquid in scene.liquids}
    return {name: 1e-6 * float(volume[0]) / cavity_volume for name, volume in start.items() if volume is not None}
