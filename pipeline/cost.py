"""Stage: after a run, what it has cost, beside what was predicted where somebody asked for an estimate.

The prediction is that of `pipeline.estimate`; what a stage took it has written itself, beside its log. Where the
computer did other things as well, the clock ran longer: compare the time of all cores then.
"""
import functools
import math
from collections.abc import Callable, Sequence
from operator import itemgetter
from pathlib import Path

import numpy as np

from pipeline.base import cli, page
from pipeline.base.files import write_text
from pipeline.base.tables import TIME, read_table
from pipeline.base.usage import taken_by, usage_files
from pipeline.base.words import duration, memory
from pipeline.cavity.initial_state import load_initial
from pipeline.forecast.estimate_files import read_level
from pipeline.forecast.expected_error import ExpectedError
from pipeline.forecast.scene_errors import errors_of
from pipeline.runs.run_folder import RunFolder
from pipeline.scenes.effects import SOLVES
from pipeline.scenes.model import Scene

STAGES = ("eye", "voxelize", "simulate", "reconstruct", "render", "metrics")
FILES = ("eye.vtp", "initial.npz", "frames", "checkpoints", "surfaces", "images", "metrics.csv")


def compared(level: dict | None, taken: dict[str, dict[str, float]], table: dict[str, np.ndarray], disk: float,
             frame_interval: float) -> list[tuple[str, str, str, str]]:
    """Return rows: what, predicted, real, predicted over real; of a run without an estimate only what is real."""
    lines = []

    def line(name: str, predicted: Callable[[dict], float], real: float, text) -> None:
        known = math.isfinite(real)
        said, ratio = "", ""
        if level is not None:
            said = text(predicted(level))
            ratio = f"{predicted(level) / real:.2f}" if known and real > 0.0 else ""
        lines.append((name, said, text(real) if known else "unknown", ratio))

    def plain(value: float) -> str:
        return f"{value:.4g}"

    steps = table["time_step [s]"]
    line("time steps", itemgetter("steps"), float(np.nansum(np.rint(frame_interval / steps))), plain)
    for name in SOLVES:
        column = f"{name}_iterations [1]"
        if column in table:
            line(f"{name} iterations per step", itemgetter(f"{name}_iterations"),
                 _mean(table[column], 1.0 / steps), plain)
    for stage in STAGES:
        if stage in taken and (level is None or stage in level["seconds"]):
            for kind, words in (("wall", "wall time"), ("cpu", "time of all cores")):
                predicted = functools.partial(_seconds, stage, kind)
                line(f"{stage}, {words}", predicted, taken[stage][kind], duration)
    largest = max((one["memory"] for one in taken.values()), default=math.nan)
    line("memory, largest", itemgetter("memory"), largest, memory)
    line("disk", itemgetter("disk"), disk, memory)
    return lines


def _seconds(stage: str, kind: str, level: dict) -> float:
    return level["seconds"][stage][kind]


def _mean(values: np.ndarray, weights: np.ndarray) -> float:
    known = np.isfinite(values) & np.isfinite(weights)
    return float(np.average(values[known], weights=weights[known])) if known.any() else math.nan


def page_of(scene: Scene, found: Sequence[ExpectedError], lines: Sequence[tuple[str, str, str, str]],
            path: Path | None = None, remark: str = "", *, predicted: bool = True) -> str:
    """Return the page, to be written to a file; ``found`` are the errors to expect."""
    title = scene.title or scene.name
    return page.page(f"{title}: cost", [page.filled(
        __file__, scene=scene, lines=lines if predicted else [line[:3:2] for line in lines],
        predicted=predicted, remark=remark if predicted else "",
        errors=[f"{one.quantity}: {one.words} ({one.source})" for one in found])], path=path)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the stage; see ``--help``."""
    p = cli.stage_parser("cost", __doc__)
    p.add_argument("scene", type=Path, help="resolved scene (scene.json)")
    p.add_argument("initial", type=Path, metavar="initial.npz", help="arrays of the voxelize stage")
    p.add_argument("metrics", type=Path, help="metrics of the run (metrics.csv)")
    p.add_argument("--estimate", type=Path, metavar="estimate.json", help="prediction of pipeline.estimate")
    p.add_argument("--logs", type=Path, required=True, metavar="DIR", help="folder of the logs, with what stages took")
    p.add_argument("--output", type=Path, required=True, help="page to write")
    options = p.parse_args(arguments)
    run = RunFolder(options.scene.parent)
    scene = run.scene
    level = read_level(options.estimate, scene) if options.estimate else None
    errors = errors_of(scene, float(load_initial(options.initial)["cavity_volume"]))
    taken = taken_by(usage_files(options.logs, run.segments))
    table = read_table(options.metrics)
    lines = compared(level, taken, table, float(run.size_of(FILES)), scene.output.frame_interval)
    remark = (f"Predicted were {scene.output.duration:g} s, the most; the scene ended after {table[TIME][-1]:g} s."
              if scene.output.until_rest else "")
    write_text(options.output, page_of(scene, errors, lines, options.output, remark, predicted=level is not None))
    print(remark, end="\n" * bool(remark))
    for name, predicted, real, ratio in lines:
        print(f"{name:34s} {predicted:>10s} {real:>10s} {ratio:>6s}")


if __name__ == "__main__":
    cli.run(main)
