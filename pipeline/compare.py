"""Stage: two accuracy levels of one scene side by side: what the other level changes, and what it costs.

    python -m pipeline.compare outputs/tamponade/draft outputs/tamponade/standard

writes outputs/tamponade/compare_draft_standard.png (the last picture that both have, and curves over time), .csv (every
metric that both have, then the cost) and .html (all of it on one page). Both levels must have been run and drawn.
"""
import argparse
import csv
import dataclasses
import fnmatch
import io
import math
import os
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from pipeline.base import cli, page
from pipeline.base.canvas import empty_figure
from pipeline.base.errors import UserError
from pipeline.base.files import replacing, write_text
from pipeline.base.sequences import number_of
from pipeline.base.tables import TIME
from pipeline.pictures.picture_grid import as_png
from pipeline.runs.run_folder import RunFolder
from pipeline.simulation.cost_files import seconds_of

# What is drawn and comes first in the table, as far as the scene has it; the other metrics follow.
HEADLINES = ("retina_coverage_whole", "wall_coverage", "contact_arc", "fill", "center_of_mass_*_y", "speed_rms",
             "kinetic_energy", "potential_energy", "emulsified_volume", "mixing_index_*")
# Columns of metrics.csv that tell of the work done, not of what came out: the cost has those that can be compared.
WORK = ("frame", "time", "time_step", "*_iterations", "limit_hit_*")
COLORS = ("#6b7f93", "#c8553d")
ACROSS = 3          # curves in a row
WIDTH = 16.0        # of the picture, inches
MARKED = 0.1        # share of the extent of a metric from which its row is marked


@dataclasses.dataclass(frozen=True)
class Difference:
    """One metric at both levels.

    Attributes
    ----------
    ends : at the last time that both have.
    largest, time : largest difference at any time, and that time, s.
    extent : largest less smallest value of the metric, over time and in both runs.
    """

    name: str
    unit: str
    ends: tuple[float, float]
    largest: float
    time: float
    extent: float

    @property
    def share(self) -> float:
        """The largest difference over the extent."""
        return self.largest / self.extent if self.extent else 0.0

    @property
    def rank(self) -> int:
        """Place in `HEADLINES`; their number for what is not there, or never changes."""
        places = [place for place, pattern in enumerate(HEADLINES) if fnmatch.fnmatch(self.name, pattern)]
        return places[0] if places and self.extent else len(HEADLINES)

    @property
    def drawn(self) -> bool:
        """Whether the metric is drawn and comes first in the table."""
        return self.rank < len(HEADLINES)


def check(runs: Sequence[RunFolder]) -> None:
    """Refuse what are not two levels of one scene."""
    one, other = runs
    if one.scene.name != other.scene.name:
        raise UserError(f"{one.folder}, {other.folder}: must be two levels of one scene, but are of {one.scene.name} "
                        f"and {other.scene.name}")
    if one.level == other.level:
        raise UserError(f"{one.folder}, {other.folder}: must be two levels, but both are {one.level}")


def common_frames(runs: Sequence[RunFolder]) -> tuple[np.ndarray, np.ndarray]:
    """Rows of both tables, (n,) each, that are the same frame at the same time.

    Raises
    ------
    UserError : there is none.
    """
    one, other = (run.table for run in runs)
    _, first, second = np.intersect1d(one["frame"], other["frame"], return_indices=True)
    same = np.isclose(one[TIME][first], other[TIME][second], rtol=1e-6, atol=1e-9)
    if not same[1:].any():  # every run has the start
        intervals = " and ".join(f"{run.scene.output.frame_interval:g} s" for run in runs)
        raise UserError(f"{runs[0].folder}, {runs[1].folder}: have no frame after the start in common (output."
                        f"frame_interval is {intervals}); run both levels of the same scene again")
    return first[same], second[same]


def last_pictures(runs: Sequence[RunFolder], frames: Iterable[float]) -> tuple[int, list[Path]]:
    """Return the last of the frames of which both runs have a picture, and the two pictures.

    Raises
    ------
    UserError : there is none.
    """
    pictures = [{number_of(path): path for path in run.pictures} for run in runs]
    drawn = [int(frame) for frame in frames if all(int(frame) in known for known in pictures)]
    if not drawn:
        raise UserError(f"{runs[0].folder}/images, {runs[1].folder}/images: have no picture of a common frame; run the "
                        "render stage at both levels")
    return drawn[-1], [known[drawn[-1]] for known in pictures]


def differences(runs: Sequence[RunFolder], rows: Sequence[np.ndarray]) -> list[Difference]:
    """Compare all metrics that both runs have, those of `HEADLINES` first.

    Parameters
    ----------
    rows : rows of both tables that are at the same times (:func:`common_frames`).
    """
    found, times = [], runs[0].table[TIME][rows[0]]
    for column in runs[0].table:
        name, _, unit = column.rstrip("]").partition(" [")
        if column not in runs[1].table or any(fnmatch.fnmatch(name, pattern) for pattern in WORK):
            continue
        values = [run.table[column][chosen] for run, chosen in zip(runs, rows, strict=True)]
        apart = np.abs(values[1] - values[0])
        if not np.isfinite(apart).any():
            continue
        where, extent = int(np.nanargmax(apart)), float(np.nanmax(values) - np.nanmin(values))
        found.append(Difference(name, "" if unit == "1" else unit, (float(values[0][-1]), float(values[1][-1])),
                                float(apart[where]), float(times[where]), extent))
    return sorted(found, key=lambda one: one.rank)


def cost(run: RunFolder) -> dict[str, float]:
    """Return what a run has cost: name with unit -> number; what was not recorded is not in it."""
    found = {"particle spacing [mm]": 1e3 * run.scene.numerics.particle_spacing}
    if all(path.exists() for path in run.cost_files):
        found |= {"liquid particles": run.costs[-1]["particles"], "time steps": sum(one["steps"] for one in run.costs)}
        found |= {"simulation, time by the clock [s]": float(seconds_of(run.costs, "wall_seconds").sum()),
                  "simulation, time of all cores [s]": float(seconds_of(run.costs, "cpu_seconds").sum())}
    return found


def in_short(runs: Sequence[RunFolder], found: Sequence[Difference]) -> str:
    """Return one sentence: what changes most, and how much more it costs."""
    one, other = runs
    most = sorted((change for change in found if change.drawn), key=lambda change: -change.share)[:3]
    parts = [f"{_words(change.name)} {_number(change.ends[0])} and {_number(change.ends[1])} {change.unit}".rstrip()
             for change in most]
    costs, name = [cost(run) for run in runs], "simulation, time of all cores [s]"
    price = ""
    if all(each.get(name, 0.0) > 0.0 for each in costs):
        price = f"; {other.level} took {costs[1][name] / costs[0][name]:.3g} times the computing time of {one.level}"
    return (f"at the end of {one.level} and {other.level}, what differs most over time: "
            f"{', '.join(parts) or 'nothing'}{price}")


def _words(name: str) -> str:
    return name.replace("_", " ")


def _number(value: float) -> str:
    return f"{value:.4g}" if math.isfinite(value) else ""


def picture_of(runs: Sequence[RunFolder], rows: Sequence[np.ndarray], found: Sequence[Difference]) -> bytes:
    """Return the pictures of both levels above the curves of all `HEADLINES`, as PNG."""
    from matplotlib.image import imread

    frame, paths = last_pictures(runs, runs[0].table["frame"][rows[0]])
    pictures = [imread(path) for path in paths]
    high = 0.5 * WIDTH * max(picture.shape[0] / picture.shape[1] for picture in pictures) + 0.5
    drawn = [one for one in found if one.drawn]
    lines = math.ceil(len(drawn) / ACROSS)
    canvas = empty_figure((WIDTH, high + 2.6 * lines))
    top, *below = canvas.subfigures(1 + bool(lines), 1, squeeze=False,
                                    height_ratios=[high, 2.6 * lines][:1 + bool(lines)])[:, 0]
    time = runs[0].table[TIME][np.flatnonzero(runs[0].table["frame"] == frame)[0]]
    for axes, each, picture, color in zip(top.subplots(1, 2), runs, pictures, COLORS, strict=True):
        axes.imshow(picture)
        axes.axis("off")
        numbers = cost(each)
        count = f", {numbers['liquid particles']} particles" if "liquid particles" in numbers else ""
        axes.set_title(f"{each.level}: {numbers['particle spacing [mm]']:g} mm{count}, {time:g} s", color=color,
                       fontsize=13, fontweight="bold")
    panels = list(below[0].subplots(lines, ACROSS, squeeze=False).flat) if below else []
    for axes, one in zip(panels, drawn, strict=False):
        column = f"{one.name} [{one.unit or '1'}]"
        for each, color, thick in zip(runs, COLORS, (2.2, 1.4), strict=True):
            axes.plot(each.table[TIME], each.table[column], color=color, lw=thick, label=each.level)
        axes.set_title(f"{_words(one.name)}{one.unit and f' [{one.unit}]'}", loc="left", fontsize=10)
        axes.grid(alpha=0.3)
        axes.margins(x=0.02)
        axes.tick_params(labelsize=8)
    for axes in panels[len(drawn):]:
        axes.axis("off")
    if below:
        panels[0].legend(frameon=False, fontsize=9)
        below[0].supxlabel("simulated time [s]", fontsize=9)
    return as_png(canvas, dpi=110)


def rows_of(runs: Sequence[RunFolder], found: Sequence[Difference]) -> list[list[str]]:
    """Return the table as text, the heads first: every metric, then the cost."""
    one, other = runs
    lines = [["what", "unit", one.level, other.level, "largest difference", "at [s]", "of its extent"]]
    lines += [[_words(change.name), change.unit, *map(_number, change.ends), _number(change.largest),
               _number(change.time) if change.largest else "", f"{100 * change.share:.1f} %"] for change in found]
    costs = [cost(run) for run in runs]
    for name in [name for name in costs[0] if name in costs[1]]:
        words, _, unit = name.rstrip("]").partition(" [")
        lines.append([words, unit, *(f"{each[name]:.6g}" for each in costs), "", "", ""])
    return lines


def csv_of(lines: Sequence[Sequence[str]]) -> str:
    """Return the table as CSV."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(lines)
    return text.getvalue()


def page_of(runs: Sequence[RunFolder], found: Sequence[Difference], picture: bytes, folder: Path) -> str:
    """Return the page, with the picture in it and links to those of the runs, to be written into a folder."""
    heads, *lines = rows_of(runs, found)
    title = f"{runs[0].title}: {runs[0].level} and {runs[1].level}"
    # Others are noise about zero, of which a share says nothing.
    marked = [number for number, change in enumerate(found) if change.drawn and change.share >= MARKED]
    return page.page(title, [
        page.paragraph(f"In short: {in_short(runs, found)}."),
        page.picture(picture, title),
        page.paragraph(
            "Values at the last time that both have, and the largest difference at any time, also as a share of the "
            f"extent of the metric over time; of what is drawn, rows from {100 * MARKED:g} % on are marked.",
            "Times are those of the solver, whatever else the computer did."),
        page.table(heads, lines, words=[1], marked=marked),
    ], links={os.path.relpath(run.folder / "index.html", folder): f"run at {run.level}" for run in runs
              if (run.folder / "index.html").is_file()})


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the stage; see ``--help``."""
    p = argparse.ArgumentParser(prog="python -m pipeline.compare", description=__doc__,
                                formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("folders", nargs=2, type=Path, metavar="FOLDER", help="results of a level: outputs/<scene>/<level>")
    p.add_argument("--output", type=Path, metavar="NAME",
                   help="files to write, without .html, .png and .csv (default: compare_<level>_<other> beside FOLDER)")
    options = p.parse_args(arguments)
    runs = [RunFolder(folder) for folder in options.folders]
    check(runs)
    rows = common_frames(runs)
    found = differences(runs, rows)
    picture = picture_of(runs, rows, found)
    target = options.output or options.folders[0].parent / f"compare_{runs[0].level}_{runs[1].level}"
    with replacing(target.with_name(f"{target.name}.png")) as partial:
        partial.write_bytes(picture)
    write_text(target.with_name(f"{target.name}.csv"), csv_of(rows_of(runs, found)))
    write_text(target.with_name(f"{target.name}.html"), page_of(runs, found, picture, target.parent))
    print(f"{runs[0].scene.name}: {in_short(runs, found)}")


if __name__ == "__main__":
    cli.run(main)
