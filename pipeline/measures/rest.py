"""Whether a scene has come to rest, by the covered share of the retina: what people read off."""
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from pipeline.base.frame_files import read_course
from pipeline.measures.events import Event
from pipeline.measures.frame_view import Measured
from pipeline.scenes.model import REST_RATE, REST_WINDOW, Scene

PARTS = ("whole", "superior", "inferior")
FEWEST_FRAMES, SHORTEST = 4, 0.5  # frames, and s, of which a change and its error are told
COLUMNS = tuple(f"retina_coverage_{part} [%]" for part in PARTS)


def rates(table: Mapping[str, np.ndarray], since: float) -> dict[str, tuple[float, float]]:
    """Return how fast the covered shares change since a time, s, and the standard error, points per second.

    Part of the retina -> both; empty for tables without the shares, or too short.

    Parameters
    ----------
    table : metrics, column -> (frames,).
    """
    time = table.get("time [s]", np.zeros(0))
    late = time >= since - 1e-9
    if (np.count_nonzero(late) < FEWEST_FRAMES or np.ptp(time[late]) < 0.9 * SHORTEST
            or not all(one in table for one in COLUMNS)):
        return {}
    fits = {part: np.polyfit(time[late], table[name][late], 1, cov=True)
            for part, name in zip(PARTS, COLUMNS, strict=True) if np.isfinite(table[name][late]).all()}
    return {part: (float(line[0]), float(np.sqrt(covariance[0, 0]))) for part, (line, covariance) in fits.items()}


def quiet_since(table: Mapping[str, np.ndarray], events: Iterable[Event]) -> float:
    """Return from when on a table is looked at, s: the last seconds, but not before the end of what happened last."""
    time = table.get("time [s]", np.zeros(0))
    if not len(time):
        return 0.0
    return float(max(time[0], time[-1] - REST_WINDOW, *(one.end for one in events if one.begin <= time[-1])))


def rests(rate: float, error: float) -> bool:
    """Tell whether a change of a covered share, and what it may be by its standard error, is that of rest."""
    return abs(rate) + error <= REST_RATE


def at_rest(table: Mapping[str, np.ndarray], events: Iterable[Event] = ()) -> bool:
    """Tell whether the covered shares hardly change any more, and nothing has happened meanwhile or is to come."""
    events = list(events)
    since = quiet_since(table, events)
    found = rates(table, since)
    return (bool(found) and float(table["time [s]"][-1]) - since > 0.9 * REST_WINDOW
            and all(one.end <= since + 1e-9 for one in events) and all(rests(*one) for one in found.values()))


def rest_in_words(table: Mapping[str, np.ndarray], events: Iterable[Event] = (), ended: bool = True) -> str:
    """Return one sentence on how fast the covered retina still changes; empty for tables without it, or too short.

    Parameters
    ----------
    events : what happens in the scene.
    ended : the scene ends here; then what else there is to know is told.
    """
    events = list(events)
    since = quiet_since(table, events)
    found = rates(table, since)
    if not found:
        return ""
    part = max(found, key=lambda name: abs(found[name][0]) + found[name][1])
    rate, error = found[part]
    still = at_rest(table, events)
    known = "nearly at rest" if still else "not known to be at rest" if rests(rate, error) else "not at rest"
    said = (f"{known}: in the last {table['time [s]'][-1] - since:.3g} s the covered share of the retina ({part}) "
            f"changes by {rate:+.2f} ± {error:.2f} percentage points per second; rest is below "
            f"{REST_RATE:g} for {REST_WINDOW:g} s")
    if ended:
        said += ("; oil that creeps along the wall may go on for minutes all the same" if still else
                 "; a longer output.duration follows it further")
    return said


def course_of_coverage(scene: Scene, initial: dict[str, np.ndarray], paths: Sequence[Path]) -> dict[str, np.ndarray]:
    """Return what rest and the events of a scene ask for, of the first frame and of those of the last seconds.

    Parameters
    ----------
    initial : arrays of ``initial.npz``.
    paths : files of the frames from the start on, in the order of time.
    """
    frames = round(REST_WINDOW / scene.output.frame_interval) + 1
    table: dict[str, list[float]] = {}
    for _, frame in read_course([*paths[:1], *paths[1:][-frames:]]):
        for column, number in row_of_coverage(Measured(scene, initial, frame)).items():
            table.setdefault(column, []).append(number)
    return {column: np.array(numbers, float) for column, numbers in table.items()}


def row_of_coverage(state: Measured) -> dict[str, float]:
    """Return what rest and the events of a scene ask for, of one frame: the columns of ``metrics.csv`` for it."""
    masks = state.wall.retina_masks()
    row = {"time [s]": state.frame.time}
    row |= {name: 100.0 * state.wall.covered_share(masks[part]) for part, name in zip(PARTS, COLUMNS, strict=True)}
    return row | {f"volume_{name} [mL]": 1e6 * volume
                  for name, volume in zip(state.frame.liquids, state.frame.fill, strict=True)}


def rest_begins(table: Mapping[str, np.ndarray], events: Iterable[Event] = ()) -> float:
    """Return from when on a scene is at rest, s after the last thing that happened in it; nan if it is not known to be.
    """
    events = list(events)
    for count in range(FEWEST_FRAMES, len(table["time [s]"]) + 1):
        part = {name: column[:count] for name, column in table.items()}
        if at_rest(part, events):
            return quiet_since(part, events) - max((one.end for one in events), default=float(table["time [s]"][0]))
    return float("nan")
