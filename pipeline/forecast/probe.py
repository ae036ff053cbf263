"""Take a few steps of a scene as it is, in each of its phases, and write what they took (part of `pipeline.estimate`).

With --rehearse a scene is run to its end instead: the estimate gives a coarser one, of which it asks only how large the
steps are and how often the solves go round.
"""
import dataclasses
import json
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipeline.base.cli import run, stage_parser
from pipeline.base.errors import UserError
from pipeline.base.files import write_text
from pipeline.base.frame_files import frame_path, load_checkpoint, save_checkpoint, write_frame
from pipeline.base.progress import progress
from pipeline.base.usage import at_least, usage
from pipeline.cavity.initial_state import load_initial
from pipeline.forecast.phases import Phase, state_in
from pipeline.scenes.devices import chosen_device
from pipeline.scenes.load import load_resolved
from pipeline.scenes.model import Scene
from pipeline.simulation.runner import Runner, restore
from pipeline.simulation.solver_setup import build_solver, frame_of
from sim.cores import useful_threads

COMPILING = 2  # steps at the start of a process, in which kernels are compiled or read from Taichi's cache
STEPS, FEWEST = 90, 6  # in all phases together; in each in any case
SHORTEST = 3.0  # s of all phases together: more steps where they are short, as others take of a computer for moments
SETTLING = 2.0 / 3.0  # of the steps of a phase, in which the solves get used to it; the others count
LONG = 1e3  # s, until which a probe would go on: its steps are not shortened to meet a frame
ROUNDS = ("pressure_iterations", "viscosity_iterations")


def clocks() -> np.ndarray:
    """Seconds on the clock and of all cores of this process, (2,)."""
    return np.array([time.perf_counter(), time.process_time()])


def as_usage(seconds: np.ndarray) -> dict[str, float]:
    """Return seconds (2,) by name; the clock never runs shorter than all cores together need."""
    wall, cpu = map(float, np.maximum(seconds, 0.0))
    return {"wall": at_least(wall, cpu), "cpu": cpu}


def take_steps(solver, number: int, seconds: tuple[float, float] = (0.0, float("inf")), threads: int = 1
               ) -> list[dict[str, float]]:
    """Take steps, and return of each its time_step (s), wall and cpu (s), iterations, and the seconds of every part.

    Parameters
    ----------
    number : of steps.
    seconds : on a computer that does nothing else, at least and at most, whatever the number: what others take of it
        does not leave the solves less time to settle.
    threads : of the solver on the CPU.
    """
    found, began, before = [], time.process_time(), clocks()
    parts = {}
    for dt in solver.advance(solver.time + LONG):
        now, sums = clocks(), dict(solver.seconds)
        found.append({"time_step": dt, **as_usage(now - before)}
                     | {name: float(solver.statistics.get(name, 0.0)) for name in ROUNDS}
                     | {f"part {name}": value - parts.get(name, 0.0) for name, value in sums.items()})
        parts, before = sums, clocks()
        spent = (time.process_time() - began) / threads
        if (len(found) >= number and spent > seconds[0]) or (len(found) >= FEWEST and spent > seconds[1]):
            break
    return found


def typical(steps: Sequence[dict[str, float]]) -> dict[str, float]:
    """Return the mean iterations and length of steps; of times the median, which no disturbed step changes."""
    return {name: float((np.mean if name in (*ROUNDS, "time_step") else np.median)([step[name] for step in steps]))
            for name in steps[0]}


def settled(steps: Sequence[dict[str, float]]) -> dict[str, float]:
    """Return what is typical of steps once the solves have settled."""
    return typical(steps[int(SETTLING * len(steps)):])


def mix_ahead(solver, seconds: float) -> None:
    """Let what spreads act alone for so long: the solves are easier where liquids have mixed, and a probe is short."""
    for effect in solver.effects:
        if effect.overrides("mix_ahead"):
            solver.search.sort()
            solver.search.build()
            effect.mix_ahead(seconds)


def probe(scene: Scene, initial: dict[str, np.ndarray], phases: Sequence[Phase], seconds: float, folder: Path,
          start: Path | None = None) -> dict:
    """Take steps in every phase, and write frames and a checkpoint into a folder.

    Liquids that are left as they are go on from one phase to the next, so that the solves go on settling, and mix in
    between as long as they would in the scene.

    Parameters
    ----------
    start : checkpoint of another scene that this one starts from.

    Returns
    -------
    particles, wall_particles; limit : time step of the liquid at rest, s; start : what a process takes before the
    steps that count; frame : what writing a frame takes; phases : ``settled`` steps of every one that could be probed,
    failed : why others could not; disk : bytes of a frame and of a checkpoint.
    """
    from sim.errors import RunError
    from sim.time_step import step_at_rest

    solver = build_solver(scene, initial)
    if start:
        restore(Runner(solver), load_checkpoint(start), start, begins=True)
    start_state, found, failed, writing = solver.state(), [], [], []
    state, mixed = start_state, 0.0
    warm = take_steps(solver, COMPILING)
    began = usage()
    with progress(len(phases), f"{scene.name}: probe at {scene.accuracy}", unit="phase") as bar:
        for index, phase in enumerate(phases):
            bar.set_postfix_str(phase.name)
            try:
                solver.restore(state_in(scene, solver, state, phase))
                if scene.closed:
                    mix_ahead(solver, phase.middle - mixed)
                steps = take_steps(solver, max(FEWEST, STEPS // len(phases)),
                                   (SHORTEST / len(phases), seconds / len(phases)),
                                   1 if solver.on_gpu else scene.numerics.threads or useful_threads())
                found.append(dataclasses.asdict(phase) | settled(steps) | {"steps": len(steps)})
                if phase.fill is None:
                    state, mixed = solver.state(), phase.middle
            except (RunError, OverflowError) as error:
                failed.append(f"{phase.name} from {phase.begin:g} to {phase.end:g} s: {error}")
                continue
            for _ in range(1 if writing else 2):  # the first time VTK is imported
                before = clocks()
                write_frame(frame_path(folder, index), frame_of(scene, solver, {}))
            writing.append(clocks() - before)
            bar.update()
    if not found:
        raise UserError(f"{scene.name}: no step of it could be probed ({'; '.join(failed)})")
    checkpoint = folder / "checkpoint.npz"
    save_checkpoint(checkpoint, start_state)
    usual = len(warm) * np.array([found[0]["wall"], found[0]["cpu"]])  # such steps are counted with the others
    return {
        "particles": solver.count[None], "wall_particles": solver.walls.count, "limit": step_at_rest(solver),
        "start": as_usage(np.array([began["wall"], began["cpu"]]) - usual),
        "frame": as_usage(np.median(writing, axis=0)), "phases": found, "failed": failed,
        "disk": {"frame": max(path.stat().st_size for path in folder.glob("frame_*")),
                 "checkpoint": checkpoint.stat().st_size}}


def rehearse(scene: Scene, initial: dict[str, np.ndarray], seconds: float) -> dict:
    """Run a scene to its end, or as far as it gets in so many seconds.

    Returns
    -------
    frames : ``typical`` steps of every interval between frames; failed : why it went no further.
    """
    from sim.errors import RunError

    solver = build_solver(scene, initial)
    frames, failed, began = [], [], time.perf_counter()
    intervals = scene.frame_count - 1
    with progress(intervals, f"{scene.name}: rehearse with {solver.count[None]} particles") as bar:
        for index in range(intervals):
            steps = []
            try:
                for dt in solver.advance((index + 1) * scene.output.frame_interval):
                    steps.append({"time_step": dt} | {name: float(solver.statistics.get(name, 0.0)) for name in ROUNDS})
            except (RunError, OverflowError) as error:
                failed.append(str(error))
            if steps:
                frames.append(typical(steps))
            if failed or time.perf_counter() - began > seconds:
                break
            bar.update()
    return {"frames": frames, "failed": failed}


def main(arguments: Sequence[str] | None = None) -> None:
    """Command line of the probe."""
    p = stage_parser("forecast.probe", __doc__)
    p.add_argument("scene", type=Path, help="resolved scene (scene.json)")
    p.add_argument("initial", type=Path, help="its particles (initial.npz)")
    p.add_argument("--phases", type=Path, metavar="FILE", help="phases to probe (JSON); without it the solver is only "
                                                               "built, so that its kernels are compiled")
    p.add_argument("--start", type=Path, metavar="FILE", help="checkpoint that the scene starts from")
    p.add_argument("--rehearse", action="store_true", help="run the scene to its end")
    p.add_argument("--seconds", type=float, default=80.0, help="time for all steps (default 80)")
    p.add_argument("--output", type=Path, required=True, help="file to write (JSON)")
    options = p.parse_args(arguments)
    scene, initial = load_resolved(options.scene), load_initial(options.initial)
    from sim.backend.runtime import initialize
    from sim.errors import RunError

    initialize(scene.numerics.precision, scene.numerics.threads, chosen_device(None, scene, options.scene),
               keep_to_core=True)
    imports = usage()
    try:
        if options.rehearse:
            found = rehearse(scene, initial, options.seconds)
        elif options.phases is None:
            take_steps(build_solver(scene, initial), COMPILING)
            found = {}
        else:
            phases = [Phase(**one) for one in json.loads(options.phases.read_text())]
            found = probe(scene, initial, phases, options.seconds, options.output.parent / "frames", options.start)
            found["imports"] = imports
    except (RunError, OverflowError) as error:
        raise UserError(f"{scene.name}: its first steps went bad: {error}") from error
    write_text(options.output, json.dumps(found) + "\n")


if __name__ == "__main__":
    run(main)
