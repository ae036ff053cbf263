"""Stage: what a scene will cost before it is run: time, memory, disk and the error to expect.

    python -m pipeline.estimate tamponade                     at the level of config/config.yaml
    python -m pipeline.estimate tamponade --accuracy all      at every level, one column each

A few steps of the very scene are taken in each of its phases, and a few frames of the stages that follow are made: in
seconds to three minutes for every level, once; outputs/measurements keeps what was measured until the code, the
computer or the scene changes. Times are of this computer with nothing else running.
"""
import dataclasses
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from pipeline.base import page
from pipeline.base.cli import run, stage_parser
from pipeline.base.errors import UserError
from pipeline.base.files import write_text
from pipeline.base.threads import checked_threads
from pipeline.base.words import duration, memory
from pipeline.forecast.measurement import measured
from pipeline.forecast.prediction import Prediction, predict
from pipeline.scenes.devices import HELP, chosen_device
from pipeline.scenes.folders import SCENES, scene_file, scenes_folder
from pipeline.scenes.load import PROJECT_CONFIG, load_accuracy_levels, load_resolved, load_scene
from pipeline.scenes.model import Scene
from pipeline.scenes.threads import solver_threads
from sim.advice import shown
from sim.cores import available_cores

HOW = ("Measured on a few steps of the scene itself and extended to all of them. Times hold while nothing else runs, "
       "and with compiled kernels, as this estimate leaves them behind.")
UNKNOWN = "unknown"


@dataclasses.dataclass(frozen=True)
class Estimate:
    """What a scene will cost, level by level."""

    scene: str
    title: str
    levels: tuple[Prediction, ...]


def rows(level: Prediction) -> list[tuple[str, str]]:
    """Return what is said of one level: name and number."""
    simulate = level.seconds["simulate"]
    others = sum(one["cpu"] for name, one in level.seconds.items() if name != "simulate")
    return [
        ("particle spacing", shown(level.particle_spacing, "m")), ("liquid particles", f"{level.particles}"),
        ("wall particles", f"{level.wall_particles}"), ("time steps", f"{level.steps}"),
        ("  of them taken to measure", f"{level.probed_steps}"), ("time step, mean", shown(level.time_step, "s")),
        ("pressure iterations per step", f"{level.pressure_iterations:.1f}"),
        ("viscosity iterations per step", f"{level.viscosity_iterations:.1f}"),
        ("simulation", duration(simulate["wall"])), ("  time of all cores", duration(simulate["cpu"])),
        ("other stages, time of all cores", duration(others)), ("all stages", duration(level.total)),
        ("compilation, done by the estimate", duration(level.compilation["wall"])),
        ("memory", memory(level.memory)), ("disk", memory(level.disk))]


def notes(level: Prediction) -> list[str]:
    """Return sentences on one level: expected errors with their source, and what could not be measured."""
    found = [f"expected error, {one.quantity}: {one.words} ({one.source})" for one in level.errors]
    if not found:
        found = [f"expected error: {UNKNOWN} (the accuracy study has no case whose effects are all in this scene)"]
    return found + list(level.notes)


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


def html_of(found: Estimate, path: Path | None = None) -> str:
    """Return the estimate as a page, to be written to a file."""
    columns = [dict(rows(level)) for level in found.levels]
    lines = [(name.strip(), *(column[name] for column in columns)) for name in columns[0]]
    return page.page(f"{found.title}: estimate", [page.filled(
        __file__, how=HOW, heads=("", *(level.accuracy for level in found.levels)), lines=lines,
        notes=[f"{level.accuracy}: {note}." for level in found.levels for note in notes(level)])],
        path=path)


def json_of(found: Estimate) -> str:
    """Return the estimate as JSON, in SI units."""
    return json.dumps(dataclasses.asdict(found), indent=2) + "\n"


FORMATS = {"text": text_of, "html": html_of, "json": json_of}


def scenes_of(path: Path, accuracy: str | None) -> list[Scene]:
    """Return a scene at one level, or at all."""
    if path.suffix == ".json":
        if accuracy is not None:
            raise UserError(f'--accuracy is "{accuracy}", but {path} is resolved already; name its scene file, or '
                            "leave --accuracy out")
        return [load_resolved(path)]
    levels = load_accuracy_levels(PROJECT_CONFIG / "accuracy.yaml") if accuracy == "all" else [accuracy]
    return [load_scene(path, level) for level in levels]


def as_run(scene: Scene, cores: int, device: str) -> Scene:
    """Return a scene with its device, and with the threads that its solver gets where a run has so many cores."""
    return dataclasses.replace(scene, numerics=dataclasses.replace(
        scene.numerics, threads=solver_threads(scene, cores), device=device))


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the stage; see ``--help``."""
    p = stage_parser("estimate", __doc__)
    p.add_argument("scene", type=scene_file, help="scene, by its name or file, or a resolved scene (.json)")
    p.add_argument("--accuracy", metavar="LEVEL", help="accuracy level, or all (default: that of config.yaml)")
    p.add_argument("--made", type=Path, nargs=2, metavar=("EYE.vtp", "INITIAL.npz"),
                   help="cavity and particles of the scene, if they are made already; they then cost nothing more")
    p.add_argument("--format", choices=FORMATS, help="what to write (default: as the name of the file says, else text)")
    p.add_argument("--output", type=Path, action="append", default=[], metavar="FILE",
                   help="file to write, .html, .json or text; may be given more than once (default: standard output)")
    p.add_argument("--start", type=Path, metavar="FILE.npz",
                   help="checkpoint of the scene that this one starts from; liquids are laid level while there is none")
    p.add_argument("--cores", type=int, metavar="N", help="cores that the run will have, as after -j of Snakemake "
                                                          "(default: all)")
    p.add_argument("--device", help=f"{HELP} (default: numerics.device of the scene)")
    options = p.parse_args(arguments)
    cores = available_cores() if options.cores is None else options.cores
    if cores < 1:
        raise UserError(f"--cores is {cores}, but must be at least 1")
    scenes = scenes_of(options.scene, options.accuracy)
    for scene in scenes:
        checked_threads(scene.numerics.threads, f"{options.scene}: numerics.threads")
    scenes = [as_run(scene, cores, chosen_device(options.device, scene, options.scene)) for scene in scenes]
    if options.made and len(scenes) > 1:
        raise UserError("--made names the particles of one level, but --accuracy is all; leave one of them out")
    folder = SCENES if options.scene.suffix == ".json" else scenes_folder(options.scene)
    start = options.start if options.start and options.start.exists() else None
    levels = tuple(predict(scene, measured(scene, folder, options.made and tuple(options.made), start), cores)
                   for scene in scenes)
    found = Estimate(scenes[0].name, scenes[0].title or scenes[0].name, levels)
    for path in options.output:
        suffix = path.suffix.lstrip(".")
        chosen = options.format or (suffix if suffix in FORMATS else "text")
        write_text(path, html_of(found, path) if chosen == "html" else FORMATS[chosen](found))
    if not options.output:
        sys.stdout.write(FORMATS[options.format or "text"](found))


if __name__ == "__main__":
    run(main)
