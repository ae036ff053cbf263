"""Stage: what a scene will cost before it is run: time, memory, disk and the error to expect, at every accuracy level.

    python -m pipeline.estimate config/scenes/tamponade.yaml    all levels
    python -m pipeline.estimate --calibrate                     time this computer anew (one to two minutes)

The first call times this computer; its result, outputs/calibration.json, is refused once the code or the computer has
changed. Times are of this computer with nothing else running, compilation included, for a scene that has never run.
"""
import argparse
import dataclasses
import html
import json
import math
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from pipeline.calibration import CALIBRATION, load_calibration
from pipeline.cli import run
from pipeline.dimensionless_numbers import shown
from pipeline.errors import UserError
from pipeline.files import write_text
from pipeline.metrics_table import STYLE
from pipeline.prediction import Prediction, predict
from pipeline.scene import PROJECT_CONFIG, Scene, load_accuracy_levels, load_resolved, load_scene

HOW = ("Predicted from what this computer takes for each part of the solver (outputs/calibration.json), the limits of "
       "the time step, and measured relations for the iterations. Times hold while nothing else runs.")
UNKNOWN = "unknown"


@dataclasses.dataclass(frozen=True)
class Estimate:
    """What a scene will cost, level by level."""

    scene: str
    title: str
    levels: tuple[Prediction, ...]


def cavity_size(scene: Scene) -> tuple[float, float]:
    """Volume and surface of the cavity of a scene, m^3 and m^2 (in two dimensions m^2 and m)."""
    if scene.container is not None:
        size = scene.container.size
        volume = math.prod(size)
        return volume, 2.0 * sum(volume / side for side in size)
    from pipeline.eye import cavity_mesh  # slow to import, and only an eye needs it

    mesh = cavity_mesh(scene.eye)[0]
    return float(mesh.volume), float(mesh.area)


def estimate(scenes: Sequence[Scene], calibration: dict) -> Estimate:
    """Return the estimate of a scene given at one or several levels."""
    volume, area = cavity_size(scenes[0])
    return Estimate(scenes[0].name, scenes[0].title or scenes[0].name,
                    tuple(predict(scene, volume, area, calibration) for scene in scenes))


def duration(value: float) -> str:
    """Return a time, s, as people read it."""
    for unit, size, limit in (("s", 1.0, 100.0), ("min", 60.0, 100.0), ("h", 3600.0, 72.0)):
        if value < limit * size:
            return f"{value / size:.3g} {unit}"
    return f"{value / 86400.0:.3g} days"


def memory(value: float) -> str:
    """Return a number of bytes as people read it."""
    return f"{value / 2**20:.0f} MiB" if value < 2**30 else f"{value / 2**30:.3g} GiB"


def rows(level: Prediction) -> list[tuple[str, str]]:
    """Return what is said of one level: name and number."""
    simulate = level.seconds["simulate"]
    others = sum(one["cpu"] for name, one in level.seconds.items() if name != "simulate")
    found = [
        ("particle spacing", shown(level.particle_spacing, "m")), ("liquid particles", f"{level.particles}"),
        ("wall particles", f"{level.wall_particles}"), ("time steps", f"{level.steps}"),
        ("time step, mean", shown(level.time_step, "s")), ("decided by", level.decided_by),
        ("pressure iterations per step", f"{level.pressure_iterations:.1f}"),
        ("viscosity iterations per step", f"{level.viscosity_iterations:.1f}"),
        ("simulation", duration(simulate["wall"])), ("  of it compilation", duration(level.compilation["wall"])),
        ("  time of all cores", duration(simulate["cpu"])), ("other stages, time of all cores", duration(others)),
        ("all stages", duration(level.total)), ("memory", memory(level.memory)), ("disk", memory(level.disk))]
    return found


def notes(level: Prediction) -> list[str]:
    """Return sentences on one level: expected errors with their source, and what is not counted."""
    found = [f"expected error, {one.quantity}: {one.value:.2g}{'' if one.unit == '1' else f' {one.unit}'} "
             f"({one.source})" for one in level.errors]
    if not found:
        found = [f"expected error: {UNKNOWN} (the accuracy study has no case whose effects are all in this scene)"]
    if level.uncertain:
        found.append(f"the time step that {' and '.join(level.uncertain)} allow is {UNKNOWN} before the run: there "
                     "may be more steps")
    if level.unknown:
        found.append(f"the time of {', '.join(level.unknown)} is {UNKNOWN} and counted as nothing")
    return found


def text_of(found: Estimate) -> str:
    """Return the estimate as lines of text."""
    columns = [dict(rows(level)) for level in found.levels]
    width = max(map(len, columns[0]))
    widths = [max(len(level.accuracy), *map(len, column.values())) for level, column in
              zip(found.levels, columns, strict=True)]
    heads = "  ".join(f"{level.accuracy:>{size}}" for level, size in zip(found.levels, widths, strict=True))
    lines = [f"{found.scene}. {HOW}", f"{'':{width}}  {heads}"]
    lines += [f"{name:{width}}  " + "  ".join(f"{column[name]:>{size}}" for column, size in
                                              zip(columns, widths, strict=True)) for name in columns[0]]
    lines += [f"{level.accuracy}: {note}." for level in found.levels for note in notes(level)]
    return "\n".join(lines) + "\n"


def html_of(found: Estimate) -> str:
    """Return the estimate as a page."""
    columns = [dict(rows(level)) for level in found.levels]
    heads = "".join(f"<th>{level.accuracy}</th>" for level in found.levels)
    body = "".join(f"<tr><td>{name.strip()}</td>" + "".join(f"<td>{html.escape(column[name])}</td>"
                                                            for column in columns) + "</tr>" for name in columns[0])
    said = "".join(f"<li>{level.accuracy}: {html.escape(note)}.</li>" for level in found.levels
                   for note in notes(level))
    title = html.escape(found.title)
    return (f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{title}: estimate</title>'
            f"<style>{STYLE}</style></head><body><h1>{title}</h1><p>{HOW}</p>"
            f"<table><tr><th></th>{heads}</tr>{body}</table><ul>{said}</ul></body></html>\n")


def json_of(found: Estimate) -> str:
    """Return the estimate as JSON, in SI units."""
    return json.dumps(dataclasses.asdict(found), indent=2) + "\n"


FORMATS = {"text": text_of, "html": html_of, "json": json_of}


def calibrate(path: Path) -> None:
    """Time this computer and write the calibration, in a process of its own."""
    print("timing this computer: one to two minutes, with nothing else running", file=sys.stderr, flush=True)
    code = subprocess.run([sys.executable, "-m", "pipeline.calibrate", "--output", str(path)], check=False).returncode
    if code:
        raise UserError(f"{path}: the calibration has failed")


def scenes_of(path: Path, accuracy: str | None) -> list[Scene]:
    """Return a scene at every level, or at one."""
    if path.suffix == ".json":
        if accuracy is not None:
            raise UserError(f'--accuracy is "{accuracy}", but {path} is resolved already; name its scene file, or '
                            "leave --accuracy out")
        return [load_resolved(path)]
    return [load_scene(path, level) for level in (
        [accuracy] if accuracy else load_accuracy_levels(PROJECT_CONFIG / "accuracy.yaml"))]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the stage; see ``--help``."""
    p = argparse.ArgumentParser(prog="python -m pipeline.estimate", description=__doc__,
                                formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("scene", type=Path, nargs="?", help="scene file (config/scenes/tamponade.yaml), or a resolved "
                                                       "scene (.json), which has one level")
    p.add_argument("--accuracy", help="one accuracy level (default: all)")
    p.add_argument("--calibrate", action="store_true", help="time this computer, even where that has been done")
    p.add_argument("--renew", action="store_true", help="time this computer anew where its calibration is out of date")
    p.add_argument("--calibration", type=Path, default=CALIBRATION, metavar="FILE",
                   help=f"what was timed (default {CALIBRATION})")
    p.add_argument("--format", choices=FORMATS, help="what to write (default: as the name of the file says, else text)")
    p.add_argument("--output", type=Path, action="append", default=[], metavar="FILE",
                   help="file to write, .html, .json or text; may be given more than once (default: standard output)")
    options = p.parse_args(arguments)
    if options.scene is None and not options.calibrate:
        raise UserError("scene is missing: name a scene file, or give --calibrate")
    scenes = scenes_of(options.scene, options.accuracy) if options.scene else []
    if options.calibrate or not options.calibration.is_file():
        calibrate(options.calibration)
    try:
        calibration = load_calibration(options.calibration)
    except UserError:
        if not options.renew:
            raise
        calibrate(options.calibration)
        calibration = load_calibration(options.calibration)
    if not scenes:
        return
    found = estimate(scenes, calibration)
    for path in options.output:
        suffix = path.suffix.lstrip(".")
        write_text(path, FORMATS[options.format or (suffix if suffix in FORMATS else "text")](found))
    if not options.output:
        sys.stdout.write(FORMATS[options.format or "text"](found))


if __name__ == "__main__":
    run(main)
