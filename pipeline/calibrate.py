"""Time the solver and the stages on this computer, for `pipeline.estimate`: about a minute.

The scenes of config/calibration are run for a few steps, each with few and with more particles, and the stages after
the simulation on a few frames of them. Compilation is timed as in a scene that is run for the first time, and once
more as in its second segment, which finds most of it in Taichi's cache.
"""
import argparse
import dataclasses
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pipeline.calibration import identity
from pipeline.cli import run
from pipeline.cost_model import KINDS, Sample, StageRun, Work, fit, fit_stage, seconds, typical
from pipeline.errors import UserError
from pipeline.files import write_text
from pipeline.scene import load_scene
from pipeline.scene_model import Scene
from pipeline.scene_work import part_of, rounds_of

SCENES = Path(__file__).parents[1] / "config" / "calibration"
EYE_SPACINGS = (2.0e-3, 1.25e-3)  # m: 630 and 2600 particles
FREE = ("volume_incompressible", "wcsph", "dfsph", "position_based")
FEWER = 0.25  # share of the particles of a scene with a free surface in its second, smaller run
COMPILING, STEPS = 3, 8  # steps in which kernels are still compiled, and those that are timed, twice
LOOSE = 100.0  # the second time with tolerances that many times as large: so that iterations differ
FRAMES = 5  # written of every eye
MANY_FRAMES = 40  # that the metrics get: they take less per frame than their start varies
STAGES = ("reconstruct", "render", "metrics")  # those that take a start and a part per frame


class Stopwatch:
    """Takes the place of ``Solver.timed``: seconds on the clock and of all cores, part by part.

    Parameters
    ----------
    solver : whose parts are timed from now on.
    """

    def __init__(self, solver):
        self.parts: dict[str, np.ndarray] = {}
        solver.timed = self.timed

    def timed(self, name, function, *arguments):
        """Call a function on the account of a part."""
        begin = clocks()
        result = function(*arguments)
        self.parts[name] = self.parts.get(name, 0.0) + clocks() - begin
        return result or {}

    def take(self) -> dict[str, np.ndarray]:
        """Return what was taken since the last call."""
        taken, self.parts = self.parts, {}
        return taken


def clocks() -> np.ndarray:
    """Seconds on the clock and of all cores of this process, (2,)."""
    return np.array([time.perf_counter(), time.process_time()])


def with_numerics(scene: Scene, **numerics) -> Scene:
    """The scene with other numerics."""
    return dataclasses.replace(scene, numerics=dataclasses.replace(scene.numerics, **numerics))


class Timings:
    """Everything that the runs of the solver took: samples for the fit, compilation, frames, memory."""

    def __init__(self):
        self.samples: list[Sample] = []
        self.compilation: dict[str, list[np.ndarray]] = {}
        self.compiled_last = 0.0  # seconds of all cores that the last scene was compiled in

    def run(self, scene: Scene, arrays: Mapping[str, np.ndarray], frames: Path | None = None, fewer: bool = False):
        """Time some steps of a scene; with ``fewer`` then those of its lower part alone; return the solver."""
        from pipeline.simulate import build_solver

        self.compiled_last, begin = 0.0, clocks()
        solver = build_solver(scene, dict(arrays))
        self._compiled("build", clocks() - begin)
        watch = Stopwatch(solver)
        first = [self._step(solver, watch) for _ in range(COMPILING)]
        later = self._steps(scene, solver, watch)
        for part in first[0][0]:
            usual = np.median([step[0][part] for step in later], axis=0)
            self._compiled(part_of(part, scene), sum(step[0].get(part, 0.0) for step in first) - COMPILING * usual)
        if frames is not None:
            self._frames(scene, solver, frames)
        if fewer:
            solver.count[None] = int(FEWER * solver.count[None])  # sorted from below: what is above is gone
            solver.step()
            watch.take()
            self._steps(scene, solver, watch)
        return solver

    def _compiled(self, part: str, taken: np.ndarray) -> None:
        self.compilation.setdefault(part, []).append(np.maximum(taken, 0.0))
        self.compiled_last += float(max(taken[1], 0.0))

    @staticmethod
    def _step(solver, watch: Stopwatch) -> tuple[dict[str, np.ndarray], dict[str, float]]:
        begin = clocks()
        solver.step()
        whole, parts = clocks() - begin, watch.take()
        parts["rest"] = np.maximum(whole - sum(parts.values()), 0.0)
        return parts, solver.statistics

    def _steps(self, scene: Scene, solver, watch: Stopwatch) -> list[tuple[dict, dict]]:
        steps = [self._step(solver, watch) for _ in range(STEPS)]
        self._set_tolerances(solver, LOOSE)
        steps += [self._step(solver, watch) for _ in range(STEPS)]
        self._set_tolerances(solver, 1.0 / LOOSE)
        count = solver.count[None]
        entries = int(solver.pairs.count.to_numpy()[:count].sum() + solver.wall_pairs.count.to_numpy()[:count].sum()
                      + solver.search.wall_rows.count.to_numpy().sum())
        for name in steps[0][0]:
            part, taken = part_of(name, scene), []
            for parts, statistics in steps:
                rounds = rounds_of(part, scene, statistics["pressure_iterations"],
                                   statistics.get("viscosity_iterations", 0.0))
                if name in parts:
                    taken.append(Sample(part, Work(count, entries, scene.dimension, rounds), *map(float, parts[name])))
            self.samples += typical(taken)
        return steps

    @staticmethod
    def _set_tolerances(solver, factor: float) -> None:
        numerics = solver.settings.numerics
        numerics = dataclasses.replace(numerics, pressure_tolerance=factor * numerics.pressure_tolerance,
                                       viscosity_tolerance=factor * numerics.viscosity_tolerance)
        solver.settings = dataclasses.replace(solver.settings, numerics=numerics)
        solver.scheme.numerics = numerics

    def _frames(self, scene: Scene, solver, folder: Path) -> None:
        from pipeline.frames import frame_path, save_checkpoint, write_frame
        from pipeline.simulate import frame_of

        folder.mkdir(parents=True)
        work = Work(solver.count[None], 0.0, scene.dimension)
        for index in range(FRAMES):
            begin = clocks()
            write_frame(frame_path(folder, index), frame_of(scene, solver, {}))
            taken = clocks() - begin
            if index == 0:
                first = taken
            else:
                self._compiled("frame", first - taken) if index == 1 else None
                self.samples.append(Sample("frame", work, *map(float, taken)))
        save_checkpoint(folder.parent / "checkpoint.npz", solver.state())

    def result(self) -> dict:
        """Coefficients and compilation, for the file."""
        compilation = {part: dict(zip(KINDS, np.mean(taken, axis=0).tolist(), strict=True))
                       for part, taken in self.compilation.items()}
        return {"parts": fit(self.samples), "compilation": compilation,
                "misfit": _misfits(self.samples)}


def _misfits(samples: list[Sample]) -> dict[str, float]:
    """Root mean square of the relative error (seconds of all cores) with which the fit meets each part."""
    coefficients, found = fit(samples), {}
    for sample in samples:
        error = seconds(coefficients, sample.part, sample.work, "cpu") / max(sample.cpu, 1e-7) - 1.0
        found.setdefault(sample.part, []).append(error)
    return {part: float(np.sqrt(np.mean(np.square(errors)))) for part, errors in found.items()}


def free_surface(scheme: str) -> tuple[Scene, dict[str, np.ndarray]]:
    """The dam of the calibration, with a scheme, and its particles."""
    from pipeline.container import container_arrays

    scene = with_numerics(load_scene(SCENES / "dam.yaml", "draft"), scheme=scheme)
    return scene, container_arrays(scene)


def time_solver(folder: Path) -> dict:
    """Run every scene of the calibration; frames of the eyes go into ``folder``."""
    from pipeline.container import container_arrays
    from pipeline.initial import load_initial
    from sim.runtime import initialize

    initialize("f32", 0)
    imports = clocks_since_start()
    timings, eyes = Timings(), sorted(folder.glob("eye_*"))
    rows = 0
    for eye in eyes:
        scene = eye_scene(float(eye.name.partition("_")[2]))
        rows += timings.run(scene, load_initial(eye / "initial.npz"), frames=eye / "frames").bytes()
    memory = 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - rows
    for scheme in FREE:
        timings.run(*free_surface(scheme), fewer=True)
    balls = load_scene(SCENES / "balls.yaml", "draft")
    timings.run(balls, container_arrays(balls), fewer=True)
    return timings.result() | {"imports": imports, "memory": memory}


def time_compilation() -> dict:
    """Time the first dam alone; the second time most of its compilation is found in Taichi's cache."""
    from sim.runtime import initialize

    initialize("f32", 0)
    timings = Timings()
    timings.run(*free_surface(FREE[0]))
    return {"compiled": timings.compiled_last}


def clocks_since_start() -> dict[str, float]:
    """Seconds since this process began: on the clock and of all cores; imports and the start of Taichi."""
    ticks = float(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19])
    began = ticks / os.sysconf("SC_CLK_TCK")
    return {"wall": time.clock_gettime(time.CLOCK_BOOTTIME) - began, "cpu": time.process_time()}


def eye_scene(spacing: float) -> Scene:
    """The eye of the calibration with a particle spacing, m."""
    return with_numerics(load_scene(SCENES / "eye.yaml", "draft"), particle_spacing=spacing)


def stage(*arguments: object, cache: Path | None = None) -> dict[str, float]:
    """Run a stage as a process of its own; return its seconds, on the clock and of all cores, and its memory, bytes.

    Raises
    ------
    UserError : the stage has failed.
    """
    environment = os.environ | ({"TI_OFFLINE_CACHE_FILE_PATH": str(cache)} if cache else {})
    begin = time.perf_counter()
    with tempfile.TemporaryFile() as log:
        process = subprocess.Popen([sys.executable, "-m", *map(str, arguments)], stdout=log, stderr=log,
                                   env=environment)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        log.seek(0)
        if process.returncode:
            raise UserError(f"the calibration has failed in {arguments[0]}: "
                            f"{log.read().decode(errors='replace').strip().splitlines()[-1:]}")
    return {"wall": time.perf_counter() - begin, "cpu": usage.ru_utime + usage.ru_stime,
            "memory": 1024.0 * usage.ru_maxrss}


def size(path: Path) -> int:
    """Bytes of a file or of all files in a folder."""
    return sum(file.stat().st_size for file in ([path] if path.is_file() else path.rglob("*")) if file.is_file())


def time_stages(eyes: list[Path]) -> dict:
    """Run the stages after the simulation on the frames of the eyes: one frame of the first, several of each."""
    runs: dict[str, list[StageRun]] = {name: [] for name in STAGES}
    for eye, whole in ((eyes[0], False), (eyes[0], True), (eyes[1], True)):
        scene, initial, mesh = eye / "scene.json", eye / "initial.npz", eye / "eye.vtp"
        particles, made = len(np.load(initial)["fluid_position"]), eye / f"made_{'all' if whole else 'one'}"
        written = {"reconstruct": made / "surfaces", "render": made / "images", "metrics": made / "metrics.csv"}
        for name in STAGES:
            count = 1 if not whole else MANY_FRAMES if name == "metrics" else FRAMES
            frames = _linked(eye / "frames", eye / f"frames_{count}", count)
            arguments = {
                "reconstruct": (frames, "--output", written["reconstruct"]),
                "render": (mesh, frames, written["reconstruct"], "--output", written["render"]),
                "metrics": (frames, "--output", written["metrics"], "--summary", made / "metrics.html", "--plots",
                            made / "plots")}[name]
            taken = stage(f"pipeline.{name}", scene, initial, *arguments)
            runs[name].append(StageRun(count, particles, taken | {"disk": size(written[name])}))
    return {name: {kind: fit_stage(some, kind) for kind in (*KINDS, "memory", "disk")} for name, some in runs.items()}


def _linked(frames: Path, folder: Path, count: int) -> Path:
    """A folder with that many frames, which are links to the first ones there are, again and again."""
    from pipeline.frames import find_frames, frame_path

    if not folder.exists():
        folder.mkdir()
        found = find_frames(frames)
        for index in range(count):
            frame_path(folder, index).symlink_to(found[index % len(found)])
    return folder


def prepare_eye(folder: Path, spacing: float) -> tuple[Path, StageRun, dict[str, float]]:
    """Make the eye of one spacing; return its folder, and what filling it and making its surface took."""
    eye = folder / f"eye_{spacing:g}"
    scene = eye / "scene.json"
    write_text(scene, eye_scene(spacing).to_json())
    made = stage("pipeline.eye", scene, "--output", eye / "eye.vtp", "--report", eye / "eye.json")
    filled = stage("pipeline.voxelize", scene, eye / "eye.vtp", "--output", eye / "initial.npz", "--report",
                   eye / "voxelize.json")
    return eye, StageRun(1, len(np.load(eye / "initial.npz")["fluid_position"]), filled), made


def calibrate() -> dict:
    """Time everything and return what the file of the calibration holds."""
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="calibration_") as name:
        folder = Path(name)
        prepared = [prepare_eye(folder, spacing) for spacing in sorted(EYE_SPACINGS)[::-1]]
        eyes = [one[0] for one in prepared]
        output, once, again = (folder / f"{name}.json" for name in ("solver", "once", "again"))
        stage("pipeline.calibrate", "--solver", folder, "--output", output, cache=folder / "cache")
        for path in (once, again):  # the second time from the cache that the first one has left
            stage("pipeline.calibrate", "--again", "--output", path, cache=folder / "cache_of_one")
        solver, first, second = (json.loads(path.read_text()) for path in (output, once, again))
        stages = time_stages(eyes)
        filled = [one[1] for one in prepared]
        stages["voxelize"] = {kind: _line([run.particles for run in filled], [run.values[kind] for run in filled])
                              for kind in (*KINDS, "memory")} | {"disk": [0.0, size(eyes[1] / "initial.npz"), 0.0]}
        stages["eye"] = {kind: [prepared[0][2][kind], 0.0, 0.0] for kind in (*KINDS, "memory")} | {"disk": [
            float(size(eyes[0] / "eye.vtp")), 0.0, 0.0]}
        particles = filled[1].particles
        disk = {"frame": size(eyes[1] / "frames") / FRAMES / particles,
                "checkpoint": size(eyes[1] / "checkpoint.npz") / particles}
    return identity() | {
        "parts": solver["parts"], "misfit": solver["misfit"], "compilation": solver["compilation"],
        "compilation_again": min(1.0, second["compiled"] / max(first["compiled"], 1e-9)), "imports": solver["imports"],
        "memory": solver["memory"], "disk": disk, "stages": stages,
        "seconds": time.perf_counter() - begin}


def _line(x: list[float], y: list[float]) -> list[float]:
    """A start and a part per particle, (start, 0, slope), that pass through two points, none below zero."""
    slope = max(0.0, (y[1] - y[0]) / (x[1] - x[0]))
    return [max(0.0, y[0] - slope * x[0]), 0.0, slope]


def main() -> None:
    """Command line of the calibration; ``--solver`` and ``--again`` are its own parts."""
    p = argparse.ArgumentParser(prog="python -m pipeline.calibrate", description=__doc__)
    p.add_argument("--output", type=Path, required=True, help="file to write (JSON)")
    p.add_argument("--solver", type=Path, metavar="DIR", help="time the solver only, with the eyes prepared in DIR")
    p.add_argument("--again", action="store_true", help="time the compilation of the first dam only")
    arguments = p.parse_args()
    if arguments.solver:
        found = time_solver(arguments.solver)
    else:
        found = time_compilation() if arguments.again else calibrate()
    write_text(arguments.output, json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    run(main)
