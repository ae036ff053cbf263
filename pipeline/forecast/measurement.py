"""What a scene takes on this computer, measured on the scene itself: a few steps of every phase, a few frames of every
stage that follows. Kept in outputs/measurements until the code, the computer or the scene changes.
"""
import dataclasses
import functools
import hashlib
import json
import platform
import tempfile
from collections.abc import Sequence
from pathlib import Path

from pipeline.base.computer import processor
from pipeline.base.digest import call_digest
from pipeline.base.errors import UserError
from pipeline.base.files import size_of, write_text
from pipeline.base.usage import KINDS, at_least, run_stage
from pipeline.cavity.eye_files import eye_files
from pipeline.cavity.initial_state import load_initial, save_initial
from pipeline.forecast.phases import phases_of
from pipeline.scenes.folders import scene_path
from pipeline.scenes.load import load_scene
from pipeline.scenes.model import Scene
from sim.backend.choice import backend_version
from sim.cores import available_cores

KEPT = Path("outputs/measurements")
MODULES = ("pipeline.forecast.probe", "pipeline.eye", "pipeline.voxelize", "pipeline.reconstruct", "pipeline.render",
           "pipeline.metrics", "pipeline.forecast.measurement")
WORDS = ("title", "description", "label")
PROBE_SECONDS, REHEARSAL_SECONDS = 80.0, 60.0
# Particles of a rehearsal: a share of those of the scene, as splashes are faster the finer they are resolved, but
# enough that liquids fall and meet as more of them do, and few enough for its time.
REHEARSED, FEWEST_REHEARSED, MOST_REHEARSED = 0.25, 1000, 4000
LEAST_SPACING_RATIO = 1.2  # of two rehearsals, below which they tell nothing of how splashes change with the spacing
FRAMES = ((20_000, 5), (200_000, 2))  # up to so many particles, so many frames are made of a stage; of more, one
STAGES = ("reconstruct", "render", "metrics")


@functools.cache
def computer() -> str:
    """Return the processor, its cores, and the versions that decide how fast it is."""
    return f"{processor()}, {available_cores()} cores, Python {platform.python_version()}, {backend_version()}"


def identity(scene: Scene, folder: Path, made: Sequence[Path]) -> str:
    """Return what a measurement holds for: the code, the computer, the scene without its words, and what it reads."""
    values = {key: value for key, value in dataclasses.asdict(scene).items() if key not in WORDS}
    chosen = {*scene.effects, scene.numerics.scheme}
    read = [hashlib.sha256(path.read_bytes()).hexdigest() for path in (*map(Path, eye_files(scene.eye)), *made)]
    if scene.start_from is not None:
        read.append(load_scene(scene_path(scene.start_from, folder), scene.accuracy).to_json())
    return " ".join([*(call_digest(module, chosen, None) for module in MODULES),
                     call_digest("pipeline.forecast.measurement", (), [json.loads(json.dumps(values)), read]),
                     computer()])


def measured(scene: Scene, folder: Path, made: tuple[Path, Path] | None = None, start: Path | None = None) -> dict:
    """Return what a scene takes, from an earlier measurement where there is one.

    Parameters
    ----------
    folder : of the scene that this one may start from.
    made : surface of the cavity (eye.vtp) and particles (initial.npz) where they are there already; they are then
        neither made nor timed.
    start : checkpoint of that scene, where it has been run; without it the liquids are laid level.

    Returns
    -------
    What :func:`measure` returns.
    """
    path = KEPT / f"{scene.name}_{scene.accuracy}{'_made' if made else ''}.json"
    key = identity(scene, folder, [*(made or ()), *([start] if start else ())])
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
        if kept["key"] == key:
            return kept["measured"]
    except (OSError, ValueError, KeyError, TypeError):
        pass  # there is none, or it is damaged: it is made anew
    with tempfile.TemporaryDirectory(prefix="estimate_") as name:
        found = measure(scene, folder, Path(name), made, start)
    write_text(path, json.dumps({"key": key, "measured": found}, indent=1) + "\n")
    return found


def measure(scene: Scene, folder: Path, work: Path, made: tuple[Path, Path] | None, start: Path | None) -> dict:
    """Measure a scene, with files in the folder ``work``.

    Returns
    -------
    probe, rehearsals : of ``pipeline.forecast.probe``, the latter with their ``spacing``, m, none for a full cavity;
    compilation : s that the first build of the solver took beyond a later one; stages : what they take
    (:func:`time_stage`); cavity_volume, m^3 (m^2); memory : bytes, of the simulation.
    """
    resolved, stages = work / "scene.json", {}
    write_text(resolved, scene.to_json())
    if made is None:
        mesh, initial = made = work / "eye.vtp", work / "initial.npz"
        for stage, output, *given in (("eye", mesh), ("voxelize", initial, mesh)):
            took = run_stage(stage, resolved, *given, "--output", output, "--report", work / f"{stage}.json")
            stages[stage] = took | {"disk": float(size_of(output))}
    mesh, initial = made
    volume = float(load_initial(initial)["cavity_volume"])
    phases = phases_of(scene, volume, folder, begun=start is not None)
    write_text(work / "phases.json", json.dumps([dataclasses.asdict(phase) for phase in phases]))
    first = run_stage("forecast.probe", resolved, initial, "--output", work / "compiled.json")
    took = run_stage("forecast.probe", resolved, initial, "--phases", work / "phases.json", "--seconds", PROBE_SECONDS,
                     *(("--start", start) if start else ()), "--output", work / "probe.json", quiet=False)
    probe = json.loads((work / "probe.json").read_text())
    frames = next((frames for most, frames in FRAMES if probe["particles"] <= most), 1)
    stages |= {stage: time_stage(stage, resolved, initial, mesh, work, frames) for stage in STAGES}
    return {
        "probe": probe, "rehearsals": [] if scene.closed else [
            {"spacing": spacing} | rehearse(coarser(scene, spacing), work / f"rehearsal_{index}")
            for index, spacing in enumerate(rehearsal_spacings(scene, probe["particles"]))],
        "stages": stages, "cavity_volume": volume,
        "compilation": {kind: max(0.0, first[kind] - probe["start"][kind]) for kind in KINDS},
        "memory": took["memory"]}


def time_stage(stage: str, scene: Path, initial: Path, mesh: Path, work: Path, count: int) -> dict:
    """Run a stage after the simulation on so many frames; with one thread, as Snakemake.

    Returns
    -------
    start, frame : wall and cpu, s, of a process and of a frame; memory, disk : bytes, disk for each frame.
    """
    made = work / "made"
    frames = made / "frames"
    _link_frames(work / "frames", frames, count)
    output = made / {"reconstruct": "surfaces", "render": "images", "metrics": "metrics.csv"}[stage]
    more = {"reconstruct": ("--eye", mesh, "--threads", 1), "render": (), "metrics": (
        "--summary", made / "metrics.html", "--plots", made / "plots", "--eye", mesh)}[stage]
    given = (mesh, frames, made / "surfaces") if stage == "render" else (frames,)
    took = run_stage(stage, scene, initial, *given, "--output", output, *more, threads=1)
    # Of one frame alone the whole run is taken: a start counted with it errs on the safe side.
    frame = {kind: took.get(f"frame_{kind}", took[kind]) for kind in KINDS}
    start = {kind: max(0.0, took[kind] - count * frame[kind]) for kind in KINDS}
    for one in (frame, start):
        one["wall"] = at_least(one["wall"], one["cpu"])
    return {"start": start, "frame": frame, "memory": took["memory"], "disk": size_of(output) / count}


def _link_frames(source: Path, folder: Path, count: int) -> None:
    """Fill a folder with that many frames, which are links to those there are, again and again."""
    from pipeline.base.frame_files import find_frames, frame_path

    if folder.exists():
        return
    folder.mkdir(parents=True)
    found = find_frames(source)
    for index in range(count):
        frame_path(folder, index).symlink_to(found[index % len(found)].absolute())


def rehearsal_spacings(scene: Scene, particles: int) -> list[float]:
    """Return the particle spacings, m, with which a scene is rehearsed, the finest first.

    Its liquids can still be told apart in them; a second one shows how splashes change with the spacing.
    """
    spacing = scene.numerics.particle_spacing
    sides = [side for block in scene.blocks for side in block.sides]
    funnels = [funnel.thickness for funnel in (scene.container.funnels if scene.container else ())]
    most = min(max(FEWEST_REHEARSED, REHEARSED * particles), MOST_REHEARSED)
    found = []
    for number in (most, FEWEST_REHEARSED):
        wanted = spacing * (particles / number) ** (1.0 / scene.dimension)
        found.append(max(spacing, min([wanted, *(0.25 * side for side in sides), *(0.5 * thin for thin in funnels)])))
    return found if found[-1] > LEAST_SPACING_RATIO * found[0] else found[:1]


def coarser(scene: Scene, spacing: float) -> Scene:
    """Return a scene with a coarser spacing, m, and time steps that may be longer in the same proportion."""
    numerics = scene.numerics
    ratio = spacing / numerics.particle_spacing
    fixed = numerics.time_step and ratio * numerics.time_step
    return dataclasses.replace(scene, numerics=dataclasses.replace(
        numerics, particle_spacing=spacing, time_step=fixed, maximum_time_step=ratio * numerics.maximum_time_step))


def rehearse(scene: Scene, work: Path) -> dict:
    """Run a coarse scene with a container to its end; no frames where it is refused, as a fixed time step may be."""
    from pipeline.cavity.container import container_arrays

    work.mkdir()
    write_text(work / "scene.json", scene.to_json())
    save_initial(work / "initial.npz", container_arrays(scene))
    try:
        run_stage("forecast.probe", work / "scene.json", work / "initial.npz", "--rehearse", "--seconds",
                  REHEARSAL_SECONDS, "--output", work / "rehearsal.json", quiet=False)
    except UserError as error:
        return {"frames": [], "failed": list(error.messages)}
    return json.loads((work / "rehearsal.json").read_text())
