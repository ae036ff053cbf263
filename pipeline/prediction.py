"""What a scene will cost: the work in it times what this computer takes for it."""
import dataclasses
import os
from collections.abc import Mapping

from pipeline.cost_model import KINDS, Work, seconds, stage_cost
from pipeline.dimensionless_numbers import Scales
from pipeline.expected_error import ExpectedError, expected_errors
from pipeline.iterations import pressure_iterations, viscosity_iterations
from pipeline.scene_model import Scene
from pipeline.scene_work import SHARED_PARTS, SceneWork, effect_parts, part_of, rounds_of, scene_work, variant
from pipeline.time_step_limits import deciding_limit, step_count, time_step_limits

ACCELERATING = ("cohesion", "curvature", "adhesion")  # effects with accelerations that no limit tells of beforehand
SMALL_STAGES = 4  # scene, advise, index_frames and movie: little more than their start


@dataclasses.dataclass(frozen=True)
class Prediction:
    """What one scene will cost at one accuracy level; SI units.

    Attributes
    ----------
    time_step, decided_by : s, and what decides it.
    seconds : stage -> "wall" (alone on this computer) and "cpu" (of all cores).
    compilation : of that, s of "simulate" in which Taichi compiles.
    start : of that, s before the first step: imports, and the solver's own compilation.
    total : wall time of all stages, on all cores of this computer.
    memory, disk : bytes, largest of any stage and of all files.
    unknown : effects of the scene that the calibration does not time; they are counted as nothing.
    uncertain : effects whose accelerations may limit the time step further; how far is not known before the run.
    errors : to expect; empty where they are not known.
    """

    accuracy: str
    particle_spacing: float
    particles: int
    wall_particles: int
    time_step: float
    decided_by: str
    steps: int
    pressure_iterations: float
    viscosity_iterations: float
    seconds: dict[str, dict[str, float]]
    compilation: dict[str, float]
    start: dict[str, float]
    total: float
    memory: float
    disk: float
    unknown: tuple[str, ...]
    uncertain: tuple[str, ...]
    errors: tuple[ExpectedError, ...]


def predict(scene: Scene, cavity_volume: float, cavity_area: float, calibration: Mapping) -> Prediction:
    """Return what a scene will cost.

    Parameters
    ----------
    cavity_volume, cavity_area : m^3 and m^2 (in two dimensions m^2 and m).
    calibration : of this computer (``pipeline.calibration.load_calibration``).
    """
    scales, work = Scales(scene, cavity_volume), scene_work(scene, cavity_volume, cavity_area)
    limit = deciding_limit(time_step_limits(scales))
    steps = step_count(scales, limit.value)
    time_step = scene.output.duration / steps
    pressure = pressure_iterations(scales, time_step, variant(scene))
    viscosity = viscosity_iterations(scales, time_step)
    parts = [part for part in _parts(scene, calibration["parts"]) if part in calibration["parts"]]
    stages = {name: {kind: _stage(name, scene, work, calibration, kind) for kind in KINDS}
              for name in _stages(scene)}
    compilation = {kind: _compilation(scene, parts, calibration, kind, "build", "frame") for kind in KINDS}
    stages["simulate"] = {kind: (
        steps * sum(seconds(calibration["parts"], part,
                            Work(work.particles, work.entries, work.dimension,
                                 rounds_of(part, scene, pressure, viscosity)), kind) for part in parts)
        + compilation[kind] + scene.segment_count * calibration["imports"][kind]
        + scene.frame_count * seconds(calibration["parts"], "frame", Work(work.particles, 0.0, work.dimension), kind))
        for kind in KINDS}
    start = {kind: scene.segment_count * calibration["imports"][kind]
             + _compilation(scene, [], calibration, kind, "build") for kind in KINDS}
    unknown = tuple(name for name in effect_parts(scene) if name not in calibration["parts"])
    return Prediction(
        scene.accuracy, scene.numerics.particle_spacing, work.particles, work.wall_particles, time_step, limit.source,
        steps, pressure, viscosity, stages, compilation, start, _total(scene, stages),
        max(calibration["memory"] + work.row_bytes, *(_stage(name, scene, work, calibration, "memory")
                                                      for name in stages if name in calibration["stages"])),
        _disk(scene, work, calibration), unknown,
        tuple(name for name in ACCELERATING if name in scene.effects), tuple(expected_errors(scene, work.width)))


def _parts(scene: Scene, known: Mapping) -> list[str]:
    """Parts of a step: those common to all, those of the scheme, and the effects with a part of their own."""
    own = f"{variant(scene)}/"
    return [*SHARED_PARTS, *(part for part in known if part.startswith(own)),
            *(part_of(name, scene) for name in effect_parts(scene))]


def _compilation(scene: Scene, parts: list[str], calibration: Mapping, kind: str, *common: str) -> float:
    """Seconds in which kernels are compiled: in the first segment anew, in the others mostly read from a cache."""
    known = calibration["compilation"]
    once = sum(known[part][kind] for part in (*common, *parts) if part in known)
    return once * (1.0 + (scene.segment_count - 1) * calibration["compilation_again"])


def _stages(scene: Scene) -> list[str]:
    cavity = ["eye"] if scene.container is None else []
    return [*cavity, "voxelize", "reconstruct", "render", "metrics", "other"]


def _stage(name: str, scene: Scene, work: SceneWork, calibration: Mapping, kind: str) -> float:
    if name == "other":
        return SMALL_STAGES * calibration["imports"][kind] if kind in KINDS else 0.0
    start, per_frame, per_particle = calibration["stages"][name][kind]
    if name in ("eye", "voxelize"):
        return start + per_particle * work.particles
    cost = stage_cost((start, per_frame, per_particle), scene.frame_count, work.particles)
    if kind == "memory":  # a frame at a time
        return stage_cost((start, per_frame, per_particle), 1, work.particles)
    return cost + (scene.segment_count - 1) * start * (name != "metrics")


def _total(scene: Scene, stages: Mapping[str, Mapping[str, float]]) -> float:
    """Wall time of all stages: the simulation is a chain, and what follows the last segment comes after it."""
    cores = os.cpu_count() or 1
    last = 1.0 / scene.segment_count
    chain = sum(stages[name]["wall"] * (last if name in ("reconstruct", "render") else 1.0) for name in stages)
    return max(chain, sum(one["cpu"] for one in stages.values()) / cores)


def _disk(scene: Scene, work: SceneWork, calibration: Mapping) -> float:
    disk, stages = calibration["disk"], calibration["stages"]
    kept = (scene.frame_count * disk["frame"] + scene.segment_count * disk["checkpoint"]) * work.particles
    return kept + sum(_stage(name, scene, work, calibration, "disk") for name in _stages(scene) if name in stages)
