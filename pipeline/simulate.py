"""Stage: run the solver over one segment of a scene, from checkpoint to checkpoint."""
import argparse
import dataclasses
import functools
import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from pipeline.advise import report_of, text_of
from pipeline.blocks import contains
from pipeline.cli import run
from pipeline.devices import HELP, chosen_device
from pipeline.errors import UserError
from pipeline.files import replacing_folder, write_text
from pipeline.frames import FrameData, frame_path, load_checkpoint, save_checkpoint, write_frame
from pipeline.initial import load_initial
from pipeline.memory_check import too_large
from pipeline.progress import progress
from pipeline.scene import Scene, load_resolved
from pipeline.scene_model import Block
from pipeline.threads import chosen_threads

MORE_ROOM, MOST_ROOM = 1.5, 12.0  # growth of the room for neighbors where it is full; over that at rest, at most
WARM_UP = 2  # steps at the start of a process, in which kernels are compiled: their time is no cost of an effect


def initial_phases(scene: Scene, position: np.ndarray, down: np.ndarray) -> np.ndarray:
    """Liquid of every particle at t = 0: that of its block, or one liquid, or several stacked level, heavy ones below.

    Parameters
    ----------
    position : (n, d), m; down : (d,) direction of gravity.

    Returns
    -------
    (n,) phase indices; volumes are met to one particle.
    """
    names = [liquid.name for liquid in scene.liquids]
    if scene.blocks:
        return of_blocks(position, scene.blocks, [names.index(block.liquid) for block in scene.blocks])
    if scene.initial.fill is None:
        return np.full(len(position), names.index(scene.initial.liquid or names[0]))
    fill = {names.index(name): value for name, value in scene.initial.fill.items()}
    heavy_first = sorted(fill, key=lambda phase: -scene.liquids[phase].density)
    bounds = np.round(np.cumsum([fill[phase] for phase in heavy_first]) * len(position)).astype(int)
    phases = np.empty(len(position), int)
    start = 0
    bottom_first = np.argsort(-(position @ down), kind="stable")
    for phase, end in zip(heavy_first, bounds, strict=True):
        phases[bottom_first[start:end]] = phase
        start = end
    return phases


def of_blocks(position: np.ndarray, blocks: Sequence[Block], values: Sequence) -> np.ndarray:
    """Value (n, ...) of the block in which every particle lies; particles are (n, d), m."""
    chosen = np.full(len(position), -1)
    for index, block in enumerate(blocks):
        chosen[contains(block, position)] = index
    return np.asarray(values)[chosen]


def initial_velocity(scene: Scene, position: np.ndarray) -> np.ndarray:
    """Velocity (n, d) of every particle at t = 0: that of its block, else rest; m/s."""
    if not scene.blocks:
        return np.zeros_like(position)
    return of_blocks(position, scene.blocks, [block.velocity or (0.0,) * scene.dimension for block in scene.blocks])


def build_solver(scene: Scene, initial: dict[str, np.ndarray], head_room: float | None = None):
    """Solver of a scene at t = 0, with every effect in its cheapest form; Taichi must run already.

    Parameters
    ----------
    head_room : room for neighbors and particles (``sim.solver.Solver``); by default what a liquid near rest needs.
    """
    from sim.effects.gravity import POSTURES
    from sim.lazy import cheapest
    from sim.solver import Solver

    gravity = scene.effects.get("gravity")
    posture = POSTURES[gravity.posture] if gravity else POSTURES["upright"]
    position = initial["fluid_position"]
    phases = initial_phases(scene, position, np.array(posture[: position.shape[1]]))
    settings, notes = cheapest(scene.settings())
    solver = Solver(
        settings, fluid_position=position, fluid_volume=initial["fluid_volume"], fluid_phase=phases,
        fluid_velocity=initial_velocity(scene, position),
        wall_position=initial["wall_position"], wall_volume=initial["wall_volume"],
        wall_depth=initial["wall_distance"], sdf_values=initial["sdf_values"], sdf_origin=initial["sdf_origin"],
        sdf_cell=initial["sdf_cell"], cavity_volume=initial["cavity_volume"],
        **({} if head_room is None else {"head_room": head_room}))
    solver.notes = [*notes, *solver.notes]
    return solver


def frame_of(scene: Scene, solver, statistics: dict[str, float]) -> FrameData:
    """The present state as a frame."""
    arrays = solver.snapshot()
    gravity = np.zeros(3)
    for effect in solver.effects:
        if effect.name == "gravity":
            gravity = effect.parameters.magnitude * effect.direction(solver.time)
    dimension = solver.dimension
    mass = arrays["mass"].astype(float)
    velocity = np.zeros((len(mass), 3), dtype=arrays["velocity"].dtype)
    velocity[:, :dimension] = arrays["velocity"]
    energies = {
        "kinetic_energy": 0.5 * float(mass @ (arrays["velocity"].astype(float) ** 2).sum(1)),
        "potential_energy": -float(mass @ (arrays["position"].astype(float) @ gravity[:dimension])),
        "compression_maximum": float(arrays["compression_rate"].max()),
    }
    return FrameData(
        position=arrays["position"], id=arrays["id"], phase=arrays["volume_fraction"].argmax(1), velocity=velocity,
        pressure=arrays["pressure"], volume=arrays["volume"], volume_fraction=arrays["volume_fraction"],
        compression_rate=arrays["compression_rate"], time=solver.time, step=solver.step_count, gravity=gravity,
        particle_spacing=scene.numerics.particle_spacing, scene=scene.name,
        liquids=tuple(liquid.name for liquid in scene.liquids), statistics=statistics | energies)


class Average:
    """Statistics of the steps between two frames: means, and largest values of what ends in `_maximum`."""

    def __init__(self):
        self.values: dict[str, list[float]] = {}

    def add(self, statistics: dict[str, float]) -> None:
        """Take in the statistics of one step."""
        for name, value in statistics.items():
            self.values.setdefault(name, []).append(value)

    def summary(self) -> dict[str, float]:
        """Return one number for every statistic."""
        return {name: float(max(v) if name.endswith("_maximum") else np.mean(v)) for name, v in self.values.items()}


class Runner:
    """A solver that is built anew with more room where it is full. What it computes does not depend on the room.

    Parameters
    ----------
    solver : the present one; None builds it.
    rebuild : ``rebuild(head_room)`` returns the solver at t = 0; without it a full solver ends the run.
    too_large : ``too_large(head_room)`` returns why that does not fit into memory, empty where it does.

    Raises
    ------
    OutOfRoom
        The start does not fit into the largest room.
    """

    def __init__(self, solver=None, rebuild: Callable | None = None, too_large: Callable[[float], str] = lambda _: ""):
        from sim.errors import OutOfRoom
        from sim.neighbor_rows import HEAD_ROOM

        self.solver, self.rebuild, self.too_large = solver, rebuild, too_large
        self.head_room = getattr(solver, "head_room", HEAD_ROOM)
        if solver is None:
            try:
                self.solver = rebuild(self.head_room)
            except OutOfRoom as error:
                self.widen(None, error)

    def widen(self, state: dict | None, error: Exception) -> None:
        """Build the solver with more room, in a given state or at t = 0; what Taichi held before is void.

        Raises
        ------
        OutOfRoom
            `error` again, where nothing rebuilds, more room does not fit into memory, or liquid is compressed so far
            that it is no remedy.
        """
        from sim.errors import OutOfRoom
        from sim.runtime import restart as restart_taichi

        kept = {name: getattr(self.solver, name) for name in ("seconds", "cpu_seconds") if self.solver}
        while True:
            self.head_room *= MORE_ROOM
            if self.rebuild is None or self.head_room > MOST_ROOM:
                raise error
            if reason := self.too_large(self.head_room):
                raise OutOfRoom(f"{error}, and there is no memory for more: numerics.particle_spacing {reason}")
            print(f"{error}; going on from {float(state['time']) if state else 0.0:.4g} s with more room", flush=True)
            self.solver = None
            restart_taichi()
            try:
                self.solver = self.rebuild(self.head_room)
                vars(self.solver).update(kept)
                if state:
                    self.solver.restore(state)
            except OutOfRoom as again:
                error = again
            else:
                return

    def restore(self, state: dict) -> None:
        """Take up a state, with more room where it needs that."""
        from sim.errors import OutOfRoom

        try:
            self.solver.restore(state)
        except OutOfRoom as error:
            self.widen(state, error)

    def advance(self, good: dict, until: float, after_step: Callable) -> dict[str, float]:
        """Advance to the time `until`, s, and return the statistics of the steps (`Average`).

        Parameters
        ----------
        good : state at the start, which the steps are repeated from with more room where the solver runs out of it.
        after_step : called with the solver and the step taken, s, after every step.
        """
        from sim.errors import OutOfRoom

        while True:
            average = Average()
            try:
                for dt in self.solver.advance(until):
                    average.add(self.solver.statistics)
                    after_step(self.solver, dt)
                self.solver.check_finite()
            except OutOfRoom as error:
                self.widen(good, error)
            else:
                return average.summary()


def simulate_segment(scene: Scene, runner: Runner, segment: int, folder: Path, restart: Path | None = None) -> dict:
    """Advance the solver of `runner` over one segment and write its frames into `folder`.

    Parameters
    ----------
    restart : checkpoint that the segment started from.

    Returns
    -------
    The times of the solver's parts after the steps of the warm-up (`sim.costs.times`), empty if there were no more
    steps.

    Raises
    ------
    UserError
        When the run goes bad; the message names step, particle and part, and what is left to start from.
    """
    from sim.costs import times
    from sim.errors import RunError
    from sim.time_step import SMALL_STEP, step_at_rest

    frames = scene.frames_of_segment(segment)
    solver = runner.solver
    first, warm, shown = solver.step_count, {}, 0.0
    usual, told = step_at_rest(solver), False
    good = solver.state()
    label = f"{scene.name}: simulate segment {segment + 1} of {scene.segment_count}"
    with progress(len(frames), label) as bar:
        for number, index in enumerate(frames):
            begin, before = solver.time, dict(solver.seconds)
            clocks = time.perf_counter(), time.process_time()
            until = index * scene.output.frame_interval

            def after_step(solver, dt, number=number, begin=begin, until=until):
                nonlocal warm, told, shown
                if solver.step_count == first + WARM_UP:
                    warm = times(solver)
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
            spent = {"wall_seconds": time.perf_counter() - clocks[0], "cpu_seconds": time.process_time() - clocks[1]}
            spent |= {f"{effect.name}_seconds": solver.seconds[effect.name] - before.get(effect.name, 0.0)
                      for effect in solver.effects if effect.name in solver.seconds}
            warn_of_limits(scene, until, statistics)
            write_frame(frame_path(folder, index), frame_of(scene, solver, statistics | spent))
    return warm if solver.step_count > first + WARM_UP else {}


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
    for solve in ("pressure", "viscosity"):
        share = statistics.get(f"{solve}_limit_hit", 0.0)
        if share > 0.0:
            print(f"{scene.name}: warning: the {solve} solve ended at its limit of "
                  f"{scene.numerics.maximum_iterations} iterations (numerics.maximum_iterations) in "
                  f"{100 * share:.0f} % of the steps before {until:.4g} s", flush=True)


def restore(runner: Runner, state: dict, path: Path, begins: bool) -> None:
    """Take up the state of a checkpoint.

    Parameters
    ----------
    begins : the end of another scene is the start of this one: its time is zero, and what is planned has not begun.

    Raises
    ------
    UserError
        When the file holds no state of such a solver.
    """
    if begins:
        planned = tuple(f"{effect.name}." for effect in runner.solver.effects if effect.planned)
        state = {key: value for key, value in state.items() if not key.startswith(planned)}
        state |= {"time": 0.0, "step_count": 0}
    try:
        runner.restore(state)
    except (KeyError, ValueError, OverflowError) as error:
        raise UserError(f"{path}: is no checkpoint that this scene can start from ({error}); it must have the same "
                        "eye, particle spacing and liquids") from error


def print_timings(solver) -> None:
    """One line per part of the solver: seconds and share."""
    total = sum(solver.seconds.values()) or 1.0
    from sim.runtime import device

    print(f"{solver.step_count} steps so far, {solver.bytes() / 2**20:.0f} MiB of fields and rows, device {device()}; "
          "seconds by part:")
    for name, seconds in sorted(solver.seconds.items(), key=lambda item: -item[1]):
        print(f"  {name:22s} {seconds:8.2f} s {100 * seconds / total:5.1f} %")


def write_costs(path: Path, solver, steps: int, launches, warm: dict) -> None:
    """Write what every part of the solver has cost in `steps` steps, the time of all but the first of them (JSON)."""
    from sim.costs import allocated, costs
    from sim.runtime import device

    parts = [dataclasses.asdict(cost) for cost in costs(solver, launches, warm)]
    numbers = {"steps": steps, "timed_steps": steps - WARM_UP if warm else steps, "allocated_bytes": allocated(),
               "launches": sum(launches.values()), "dimension": solver.dimension, "particles": solver.count[None],
               "scheme": solver.scheme.name, "device": device(), "notes": solver.notes}
    write_text(path, json.dumps(numbers | {"parts": parts}, indent=1) + "\n")


def parser() -> argparse.ArgumentParser:
    """Command line of the stage."""
    p = argparse.ArgumentParser(prog="python -m pipeline.simulate", description=__doc__)
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
    from sim.costs import counted_launches
    from sim.runtime import initialize

    initialize(scene.numerics.precision, threads, device)
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
            warm = simulate_segment(scene, runner, arguments.segment, folder, arguments.restart)
        solver = runner.solver
        save_checkpoint(arguments.checkpoint, solver.state())
    if arguments.costs:
        write_costs(arguments.costs, solver, solver.step_count - steps, launches, warm)
    print_timings(solver)


if __name__ == "__main__":
    run(main)
