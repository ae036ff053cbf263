"""Accuracy levels of one scene: what each has cost, and what changes between them."""
import dataclasses
import fnmatch
import functools
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from pipeline.base.errors import UserError
from pipeline.base.sequences import number_of
from pipeline.base.tables import TIME
from pipeline.base.words import in_a_row
from pipeline.measures.least_energy import COVERED, RESTING
from pipeline.measures.shown import Curve, Shown, shown_metrics
from pipeline.runs.run_folder import RunFolder
from pipeline.simulation.cost_files import seconds_of

# What is drawn and comes first in the tables, as far as the scene has it; the other metrics follow.
HEADLINES = (f"{COVERED}_whole", f"{COVERED}_inferior", f"{COVERED}_macula", "wall_coverage", "contact_arc", "fill",
             "center_of_mass_*_y", "speed_rms", "kinetic_energy", "potential_energy", "emulsified_volume",
             "mixing_index_*")
# Metrics that tell of the work done, not of what came out: the cost has those that can be compared.
WORK = ("time", "time_step", "*_iterations", "limit_hit")
BESIDE_COST = 3     # metrics that stand beside the cost
ALL_CORES, CLOCK = "simulation, time of all cores [s]", "simulation, time by the clock [s]"


@dataclasses.dataclass(frozen=True)
class Change:
    """One curve of a metric at all levels.

    Attributes
    ----------
    metric, curve : with the values of all runs, one behind the other, in one unit and with the same digits.
    ends : places in it of the last time that all have.
    largest, time : largest difference of any two levels at any time, and that time, s.
    extent : largest less smallest value, over time and in all runs.
    at_rest : what it would be at rest, of least energy; None where that is not known.
    """

    metric: Shown
    curve: Curve
    ends: tuple[int, ...]
    largest: float
    time: float
    extent: float
    at_rest: float | None = None

    @property
    def name(self) -> str:
        """Name for readers."""
        return f"{self.metric.name} {self.curve.part}".strip()

    @property
    def unit(self) -> str:
        """Unit for readers."""
        return self.metric.unit

    @property
    def values(self) -> tuple[float, ...]:
        """Values at the last time that all have."""
        return tuple(float(self.curve.values[end]) for end in self.ends)

    @property
    def share(self) -> float:
        """The largest difference over the extent."""
        return self.largest / self.extent if self.extent else 0.0

    @property
    def rank(self) -> int:
        """Place in `HEADLINES`; their number for what is not there, or never changes."""
        name = self.name.replace(" ", "_")
        places = [place for place, pattern in enumerate(HEADLINES) if fnmatch.fnmatch(name, pattern)]
        return places[0] if places and self.extent else len(HEADLINES)

    @property
    def drawn(self) -> bool:
        """Whether the metric is drawn and comes first in the tables."""
        return self.rank < len(HEADLINES)


def check(runs: Sequence[RunFolder]) -> None:
    """Refuse what are not levels of one scene."""
    if len(runs) < 2:
        raise UserError(f"{runs[0].folder}: a comparison needs two levels of the scene or more; name another one")
    first = runs[0]
    for number, run in enumerate(runs[1:], 1):
        if run.scene.name != first.scene.name:
            raise UserError(f"{first.folder}, {run.folder}: must be levels of one scene, but are of "
                            f"{first.scene.name} and {run.scene.name}")
        if run.level in [one.level for one in runs[:number]]:
            raise UserError(f"{run.folder}: the level {run.level} is named twice; every level can be compared once")


def common_frames(runs: Sequence[RunFolder]) -> list[np.ndarray]:
    """Rows of every table, (n,) each, that are the same frame at the same time.

    Raises
    ------
    UserError : there is none.
    """
    frames = functools.reduce(np.intersect1d, [run.table["frame"] for run in runs])
    rows = [np.searchsorted(run.table["frame"], frames) for run in runs]
    times = np.stack([run.table[TIME][chosen] for run, chosen in zip(runs, rows, strict=True)])
    same = np.isclose(times, times[0], rtol=1e-6, atol=1e-9).all(axis=0)
    if not same[1:].any():  # every run has the start
        intervals = in_a_row([f"{run.scene.output.frame_interval:g} s" for run in runs])
        raise UserError(f"{', '.join(str(run.folder) for run in runs)}: have no frame after the start in common "
                        f"(output.frame_interval is {intervals}); run all levels of the same scene again")
    return [chosen[same] for chosen in rows]


def last_pictures(runs: Sequence[RunFolder], frames: Iterable[float]) -> tuple[int, list[Path]]:
    """Return the last of the frames of which all runs have a picture, and the pictures.

    Raises
    ------
    UserError : there is none.
    """
    pictures = [{number_of(path): path for path in run.pictures} for run in runs]
    drawn = [int(frame) for frame in frames if all(int(frame) in known for known in pictures)]
    if not drawn:
        raise UserError(f"{', '.join(f'{run.folder}/images' for run in runs)}: have no picture of a common frame; run "
                        "the render stage at all levels")
    return drawn[-1], [known[drawn[-1]] for known in pictures]


def changes(runs: Sequence[RunFolder], rows: Sequence[np.ndarray]) -> list[Change]:
    """Compare all metrics that all runs have, those of `HEADLINES` first.

    Parameters
    ----------
    rows : rows of the tables that are at the same times (:func:`common_frames`).
    """
    columns = [column for column in runs[0].table if all(column in run.table for run in runs)]
    joined = {column: np.concatenate([run.table[column] for run in runs]) for column in columns}
    starts = np.cumsum([0, *(len(run.table[TIME]) for run in runs)])[:-1]
    places = [start + chosen for start, chosen in zip(starts, rows, strict=True)]
    found, times, resting = [], runs[0].table[TIME][rows[0]], runs[-1].least_energy
    shown = shown_metrics(joined, runs[0].metrics)
    bands = {one.metric.uncertainty for one in shown}
    for one in shown:
        if one.metric.name in bands or any(fnmatch.fnmatch(one.metric.name, pattern) for pattern in WORK):
            continue
        for curve in one.curves:
            values = np.stack([curve.values[chosen] for chosen in places])
            apart = values.max(axis=0) - values.min(axis=0)
            if not np.isfinite(apart).any():
                continue
            where, extent = int(np.nanargmax(apart)), float(np.nanmax(values) - np.nanmin(values))
            at_rest = resting.shares.get(curve.part) if resting and one.metric.name == COVERED else None
            found.append(Change(one, curve, tuple(int(chosen[-1]) for chosen in places), float(apart[where]),
                                float(times[where]), extent, at_rest))
    return sorted(found, key=lambda one: one.rank)


def cost(run: RunFolder) -> dict[str, float]:
    """Return what a run has cost: name with unit -> number; what was not recorded is not in it."""
    found = {"particle spacing [mm]": 1e3 * run.scene.numerics.particle_spacing}
    if all(path.exists() for path in run.cost_files):
        found |= {"liquid particles": run.costs[-1]["particles"], "time steps": sum(one["steps"] for one in run.costs)}
        found |= {CLOCK: float(seconds_of(run.costs, "wall_seconds").sum()),
                  ALL_CORES: float(seconds_of(run.costs, "cpu_seconds").sum())}
    return found


def in_short(runs: Sequence[RunFolder], found: Sequence[Change]) -> str:
    """Return one sentence: what is known at rest, or else changes most, and how much more it costs."""
    known = [one for one in found if one.drawn and one.at_rest is not None]
    most = sorted((one for one in found if one.drawn), key=lambda one: -one.share)[:BESIDE_COST]
    parts = [f"{one.name} {in_a_row([one.curve.text(end) for end in one.ends])} {one.unit}".rstrip() + (
        "" if one.at_rest is None else f" ({RESTING}: {one.curve.beside(one.at_rest, one.ends[-1])} {one.unit})")
        for one in known or most]
    costs = [cost(run).get(ALL_CORES, 0.0) for run in runs]
    price = ""
    if all(one > 0.0 for one in costs):
        times = in_a_row([f"{run.level} took {one / costs[0]:.3g} times" for run, one in zip(runs[1:], costs[1:],
                                                                                      strict=True)])
        price = f"; {times} the computing time of {runs[0].level} (all cores)"
    what = "" if known else "what differs most over time: "
    return f"at the end of {in_a_row([run.level for run in runs])}, {what}{', '.join(parts) or 'nothing'}{price}"


def of_level(run: RunFolder) -> str:
    """A level, its spacing and its particles in words."""
    numbers = cost(run)
    count = f", {numbers['liquid particles']:,} particles" if "liquid particles" in numbers else ""
    return f"{run.level}: {numbers['particle spacing [mm]']:g} mm{count}"
