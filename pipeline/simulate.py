"""Stage: run the solver over one segment of a scene, from checkpoint to checkpoint."""
import dataclasses
import functools
import json
import time
from pathlib import Path

from pipeline.advice.report import report_of, text_of
from pipeline.base.checksum import checksum_at_end
from pipeline.base.cli import CommandLine, run, stage_parser
from pipeline.base.errors import UserError
from pipeline.base.files import replacing_folder, write_text
from pipeline.base.frame_files import frame_path, load_checkpoint, save_checkpoint, write_frame
from pipeline.base.progress import progress
from pipeline.base.words import duration
from pipeline.cavity.initial_state import load_initial
from pipeline.scenes.devices import HELP, chosen_device
from pipeline.scenes.effects import SOLVES
from pipeline.scenes.load import load_resolved
from pipeline.scenes.memory_check import too_large
from pipeline.scenes.model import Scene
from pipeline.scenes.threads import chosen_threads
from pipeline.simulation.cost_files import STARTED_FROM
from pipeline.simulation.runner import Runner, restore
from pipeline.simulation.solver_setup import build_solver, frame_of

FOR_DIGESTS = "beside pipeline.advice.report"  # what is printed first changes no frame
PACE_AFTER = 60.0  # s of steps after which it is known how long the rest takes
WARM_UP = 2  # steps at the start of a process, in which kernels are compiled: their time is no cost of an effect


def simulate_segment(scene: Scene, runner: Runner, segment: int, folder: Path, restart: Path | None = None) -> tuple[
        dict, list[dict[str, float]]]:
    """Advance the solver of `runner` over one segment and write its frames into `folder`.

    Parameters
    ----------
    restart : checkpoint that the segment started from.

    Returns
    -------
    The times of the solver's parts after the steps of the warm-up (`sim.profiling.times`), empty if there were no more
    steps; and what every frame took since the one before, s: no frame holds it, so that equal runs have equal files.

    Raises
    ------
    UserError
        When the run goes bad; the message names step, particle and part, and what is left to start from.
    """
    from sim.errors import RunError
    from sim.profiling import times
    from sim.time_step import SMALL_STEP, step_at_rest

    frames = scene.frames_of_segment(segment)
    solver = runner.solver
    first, warm, shown, clocks = solver.step_count, {}, 0.0, []
    pace_from = None  # simulated time and clock
    usual, told = step_at_rest(solver), False
    good = solver.state()
    most = f"{'at most ' * scene.output.until_rest}{scene.segment_count}"
    label = f"{scene.name}: simulate segment {segment + 1} of {most}"
    with progress(len(frames), label) as bar:
        for number, index in enumerate(frames):
            begin, before = solver.time, dict(solver.seconds)
            wall, cpu = time.perf_counter(), time.process_time()
            until = index * scene.output.frame_interval

            def after_step(solver, dt, number=number, begin=begin, until=until):
                nonlocal warm, told, shown, pace_from
                if solver.step_count == first + WARM_UP:
                    warm = times(solver)
                    pace_from = solver.time, time.perf_counter()
                elif pace_from and (spent := time.perf_counter() - pace_from[1]) > PACE_AFTER:
                    refuse_endless(scene, spent, pace_from[0], solver.time)
                    pace_from = None
                if dt < SMALL_STEP * usual and not told:
                    told = warn_of_small_steps(scene, solver, dt, usual)
                bar.set_postfix_str(f"t {solver.time:.3f} s, dt {dt * 1e3:.2f} ms, "
                                    f"{solver.statistics['pressure_iterations']} pressure iterations")
                now = number + (solver.time - begin) / (until - begin)
                bar.update(now - shown)
                shown = now

            try:
                statistics = runner.advance(good, until, after_step)
            except (RunError, OverflowError) as error:
                solver = runner.solver
                at = solver.time if solver else float(good["time"])
                raise UserError(f"{scene.name}: the run went bad at {at:.4g} s: "
                                f"{diagnosis(solver, good, until, error)}; {kept(scene, restart)}{advice(error)}"
                                ) from error
            solver = runner.solver
            good = solver.state()
            if index == 0:
                solver.prepare_output()
                bar.update(1 - shown)
                shown = 1.0
            clocks.append({"frame": index, "wall_seconds": time.perf_counter() - wall,
                           "cpu_seconds": time.process_time() - cpu} | {
                f"{effect.name}_seconds": solver.seconds[effect.name] - before.get(effect.name, 0.0)
                for effect in solver.effects if effect.name in solver.seconds})
            warn_of_limits(scene, until, statistics)
            write_frame(frame_path(folder, index), frame_of(scene, solver, statistics))
    return warm if solver.step_count > first + WARM_UP else {}, clocks


def refuse_endless(scene: Scene, spent: float, begin: float, now: float) -> None:
    """Raise where the rest of a scene takes longer than it allows, at the pace of what was done in `spent` s."""
    rest = spent / (now - begin) * (scene.output.duration - now)
    if rest > scene.allowed_time:
        raise UserError(f"{scene.name}: after {duration(spent)} the clock of the scene has gone from {begin:.4g} to "
                        f"{now:.4g} s, and at this pace the rest takes {duration(rest)}, but allowed_time is "
                        f"{duration(scene.allowed_time)}: allow more in the scene, or take a coarser accuracy level, "
                        "longer steps or a shorter output.duration")


def diagnosis(solver, good: dict, until: float, error: Exception) -> str:
    """What went bad and where, found by repeating the steps since the last frame; else the error itself.

    `solver` is None where it was given up for a wider one that could not be built.
    """
    from sim.errors import RunError
    from sim.solver import Divergence

    if solver is None or not isinstance(error, Divergence | OverflowError):
        return str(error)
    try:
        solver.replay(good, until)
    except (RunError, OverflowError) as found:
        return str(found)
    return f"{error} (which did not happen again when the steps since the last frame were repeated)"


def advice(error: Exception) -> str:
    """What may help a run that diverged; other errors say that themselves."""
    from sim.solver import Divergence

    if not isinstance(error, Divergence | OverflowError):
        return ""
    return ", try a smaller numerics.courant_number, numerics.maximum_time_step or, if given, numerics.time_step"


def kept(scene: Scene, restart: Path | None) -> str:
    """What is left to start from after a run went bad."""
    if restart is None:
        return f"there is no checkpoint before, {scene.name} starts anew"
    return f"the last good checkpoint is kept, {restart}"


def warn_of_small_steps(scene: Scene, solver, dt: float, usual: float) -> bool:
    """Say that a violent motion takes small steps; return that it was said."""
    print(f"{scene.name}: warning: at {solver.time:.4g} s the time step falls to {dt:.2g} s, where {usual:.2g} s do "
          f"for the liquid at rest: it moves at up to {solver.largest[0]:.3g} m/s, accelerated by up to "
          f"{solver.largest[1]:.3g} m/s2; the run goes on in small steps", flush=True)
    return True


def warn_of_limits(scene: Scene, until: float, statistics: dict[str, float]) -> None:
    """Say which solves have ended at their limit of iterations before the frame at ``until``, s."""
    from sim.schemes import REGISTRY as SCHEMES

    limits = dict.fromkeys(SOLVES, (scene.numerics.maximum_iterations, "numerics.maximum_iterations"))
    limits["pressure"] = SCHEMES[scene.numerics.scheme].iteration_limit(scene.settings())
    for solve, (iterations, key) in limits.items():
        share = statistics.get(f"{solve}_limit_hit", 0.0)
        if share > 0.0:
            print(f"{scene.name}: warning: the {solve} solve ended at its limit of {iterations} iterations ({key}) in "
                  f"{100 * share:.0f} % of the steps before {until:.4g} s", flush=True)


def print_timings(solver) -> None:
    """One line per part of the solver: seconds and share."""
    total = sum(solver.seconds.values()) or 1.0
    from sim.backend.runtime import device

    print(f"{solver.step_count} steps so far, {solver.bytes() / 2**20:.0f} MiB of fields and rows, device {device()}; "
          "seconds by part:")
    for name, seconds in sorted(solver.seconds.items(), key=lambda item: -item[1]):
        print(f"  {name:22s} {seconds:8.2f} s {100 * seconds / total:5.1f} %")


def write_costs(path: Path, solver, steps: int, launches, warm: dict, clocks: list[dict[str, float]],
                restart: Path | None) -> None:
    """Write what every part of the solver has cost in `steps` steps, the time of all but the first of them (JSON).

    clocks : what every frame took (`simulate_segment`).
    restart : checkpoint that the segment started from.
    """
    from sim.backend.accounting import allocated
    from sim.backend.runtime import device
    from sim.profiling import costs

    parts = [dataclasses.asdict(cost) for cost in costs(solver, launches, warm)]
    numbers = {STARTED_FROM: checksum_at_end(restart) if restart else "", "steps": steps,
               "timed_steps": steps - WARM_UP if warm else steps, "allocated_bytes": allocated(),
               "launches": sum(launches.values()), "dimension": solver.dimension, "particles": solver.count[None],
               "scheme": solver.scheme.name, "device": device(), "notes": solver.notes}
    write_text(path, json.dumps(numbers | {"parts": parts, "frames": clocks}, indent=1) + "\n")


def parser() -> CommandLine:
    """Command line of the stage."""
    p = stage_parser("simulate", __doc__)
    p.add_argument("scene", type=Path, help="resolved scene (scene.json)")
    p.add_argument("initial", type=Path, help="particles and signed distance of the voxelize stage (initial.npz)")
    p.add_argument("--segment", type=int, default=0, help="which segment (default 0)")
    p.add_argument("--restart", type=Path, help="checkpoint to start from: that of the segment before")
    p.add_argument("--frames", type=Path, required=True, help="folder of frames to write")
    p.add_argument("--checkpoint", type=Path, required=True, help="checkpoint to write at the end")
    p.add_argument("--costs", type=Path, metavar="FILE.json", help="what every effect has cost (default: not written)")
    p.add_argument("--threads", type=int, metavar="N",
                   help="threads of the solver, 0 for as many as are useful (default: numerics.threads of the scene)")
    p.add_argument("--device", help=f"{HELP} (default: numerics.device of the scene)")
    return p


def main() -> None:
    """Run one segment."""
    arguments = parser().parse_args()
    scene = load_resolved(arguments.scene)
    threads = chosen_threads(arguments.threads, scene, arguments.scene)
    device = chosen_device(arguments.device, scene, arguments.scene)
    if not 0 <= arguments.segment < scene.segment_count:
        last = scene.segment_count - 1
        raise UserError(f"--segment is {arguments.segment}, but {scene.name} has segments 0 to {last}")
    if arguments.restart is None and (arguments.segment > 0 or scene.start_from):
        raise UserError(f"--restart is missing: segment {arguments.segment} of {scene.name} starts from a checkpoint")
    initial = load_initial(arguments.initial)
    box = initial["sdf_values"].size * float(initial["sdf_cell"]) ** scene.dimension
    fits = functools.partial(too_large, scene.settings(), 0.0, box, len(initial["fluid_position"]))
    if too_many := fits():
        raise UserError(f"{arguments.scene}: numerics.particle_spacing: {too_many}")
    if arguments.segment == 0:
        print(text_of(report_of(scene, float(initial["cavity_volume"]))), flush=True)
    state = load_checkpoint(arguments.restart) if arguments.restart else None
    from sim.backend.launching import counted_launches
    from sim.backend.runtime import initialize

    initialize(scene.numerics.precision, threads, device, keep_to_core=True)
    try:
        runner = Runner(None, functools.partial(build_solver, scene, initial), fits)
    except OverflowError as error:
        raise UserError(f"{arguments.initial}: cannot start a run ({error}); run the voxelize stage again, or take a "
                        "larger numerics.particle_spacing") from error
    for note in runner.solver.notes:
        print(f"{scene.name}: {note}", flush=True)
    if state:
        restore(runner, state, arguments.restart, begins=arguments.segment == 0)
    steps = runner.solver.step_count
    with replacing_folder(arguments.frames) as folder:
        with counted_launches() as launches:
            warm, clocks = simulate_segment(scene, runner, arguments.segment, folder, arguments.restart)
        solver = runner.solver
        save_checkpoint(arguments.checkpoint, solver.state())
    if arguments.costs:
        write_costs(arguments.costs, solver, solver.step_count - steps, launches, warm, clocks, arguments.restart)
    print_timings(solver)


if __name__ == "__main__":
    run(main)
