"""The phases of a scene in which its steps differ: while liquid is injected, in a turn, jolt or saccade, and between.

Each phase of a full cavity is looked at in its middle, with the liquids laid level in their volumes of that moment, as
the posture at its begin has them: within a turn they are not yet where they will come to rest.
"""
import dataclasses
import itertools
from pathlib import Path

import numpy as np

from pipeline.scenes.fill import fill_at_start
from pipeline.scenes.folders import scene_path
from pipeline.scenes.load import load_scene
from pipeline.scenes.model import Initial, Scene
from pipeline.simulation.solver_setup import initial_phases
from sim.effects import REGISTRY

FOR_DIGESTS = "runs effects"


@dataclasses.dataclass(frozen=True)
class Phase:
    """A part of a scene: from ``begin`` to ``end``, s, and what is in the cavity in its middle.

    fill : liquid -> share of the cavity; None where the liquids are left as they are at the start.
    """

    name: str
    begin: float
    end: float
    fill: dict[str, float] | None = None

    @property
    def middle(self) -> float:
        """Time in the middle, s."""
        return 0.5 * (self.begin + self.end)


def phases_of(scene: Scene, cavity_volume: float, folder: Path, begun: bool = False) -> list[Phase]:
    """Return the phases of a scene; one with a free surface has its start only: what follows, a rehearsal shows.

    Parameters
    ----------
    cavity_volume : m^3 (in two dimensions m^2).
    folder : of the scene that this one may start from.
    begun : whether the end of that scene is known, so that the liquids lie as they really do where none is injected.
    """
    duration = scene.output.duration
    if not scene.closed:
        return [Phase("start", 0.0, duration)]
    effects = [(REGISTRY[name], parameters) for name, parameters in scene.effects.items()]
    # What exchanges liquids is named last.
    effects.sort(key=lambda one: (one[0].overrides("fill_at"), list(REGISTRY).index(one[0].name)))
    fill = fill_at_start(scene, lambda name: load_scene(scene_path(name, folder), scene.accuracy))
    refilled = any(effect.overrides("fill_at") for effect, _ in effects)
    spans = [span for effect, parameters in effects for span in effect.spans(parameters, fill, cavity_volume)]
    times = sorted({0.0, duration, *(time for _, *ends in spans for time in ends if time < duration)})
    found = []
    for begin, end in itertools.pairwise(times):
        names = [name for name, first, last in spans if first <= begin and end <= last]
        phase = Phase(" and ".join(names) or "rest", begin, end, None if begun and not refilled else fill)
        for effect, parameters in effects if phase.fill else ():
            phase = dataclasses.replace(
                phase, fill=effect.fill_at(parameters, phase.fill, phase.middle, cavity_volume))
        found.append(phase)
    return found


def state_in(scene: Scene, solver, start: dict, phase: Phase) -> dict:
    """Return the state of a solver in the middle of a phase.

    Parameters
    ----------
    start : state of the solver at the start (``Solver.state``).
    """
    if phase.fill is None:
        return start | {"time": phase.middle if phase.begin else 0.0}
    state = start | {"time": phase.middle}
    fill = {name: share for name, share in phase.fill.items() if share}
    laid = dataclasses.replace(scene, initial=Initial(fill=fill))
    kinds = initial_phases(laid, start["particles.position"].astype(float), solver.down(phase.begin)[: scene.dimension])
    volume = start["particles.volume"]
    density = np.array([liquid.density for liquid in scene.liquids], volume.dtype)
    state |= {"particles.phase": kinds.astype(start["particles.phase"].dtype),
              "particles.mass": volume * density[kinds]}
    state.pop("particles.volume_fraction", None)  # effects that mix start from the liquids then
    volumes = {liquid.name: float(volume[kinds == index].sum(dtype=float))
               for index, liquid in enumerate(scene.liquids)}
    for effect in solver.effects:
        own = effect.state_at(phase.middle, volumes, phase.fill)
        state |= {f"{effect.name}.{name}": value for name, value in own.items()}
    return state
