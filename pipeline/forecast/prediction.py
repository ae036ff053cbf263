"""What a scene will cost: what was measured on a few of its steps and frames, extended to all of them.

A full cavity is measured in every phase. Under a free surface the course of the motion decides how long the steps can
be: a coarse rehearsal shows it. Limits by speed and acceleration follow the particle spacing, splashes are faster the
finer they are resolved, as a second, coarser rehearsal shows, and the iterations of the solves are taken to change over
the scene as they do in the rehearsal.
"""
import dataclasses
import math
from collections.abc import Iterator, Mapping

from pipeline.base.usage import KINDS
from pipeline.base.words import duration
from pipeline.forecast.expected_error import ExpectedError
from pipeline.forecast.probe import ROUNDS, SETTLING
from pipeline.forecast.scene_errors import errors_of
from pipeline.scenes.model import Scene
from sim.cores import available_cores

SMALL_STAGES = 4  # scene, advise, index_run and movie: little more than their start
SOLVES = ("pressure", "divergence solve", "density solve", "position correction")  # parts of a scheme that go round


@dataclasses.dataclass(frozen=True)
class Span:
    """A part of a scene in which steps are alike: their number, and what each takes (s, iterations)."""

    steps: int
    wall: float
    cpu: float
    pressure_iterations: float
    viscosity_iterations: float


@dataclasses.dataclass(frozen=True)
class Prediction:
    """What one scene will cost at one accuracy level; SI units.

    Attributes
    ----------
    time_step : mean, s.
    seconds : stage -> "wall" (alone on this computer) and "cpu" (of all cores).
    start : of "simulate", s before the steps that count, in all processes.
    compilation : s that the first build of the solver took beyond later ones; it is over, Taichi keeps the kernels.
    total : wall time of all stages, on all cores of this computer.
    memory, disk : bytes, largest of any stage and of all files.
    probed_steps : how many steps were measured. notes : what could not be.
    errors : to expect; empty where they are not known.
    """

    accuracy: str
    particle_spacing: float
    particles: int
    wall_particles: int
    time_step: float
    steps: int
    pressure_iterations: float
    viscosity_iterations: float
    seconds: dict[str, dict[str, float]]
    start: dict[str, float]
    compilation: dict[str, float]
    total: float
    memory: float
    disk: float
    probed_steps: int
    notes: tuple[str, ...]
    errors: tuple[ExpectedError, ...]


def predict(scene: Scene, measured: Mapping, cores: int | None = None) -> Prediction:
    """Return what a scene will cost, from what was measured (``pipeline.forecast.measurement.measured``).

    Parameters
    ----------
    cores : that stages may take side by side, all if nothing is said.
    """
    probe, found = measured["probe"], list(spans(scene, measured))
    steps = sum(span.steps for span in found)

    def mean(name: str) -> float:
        return sum(span.steps * getattr(span, name) for span in found) / steps

    start = {kind: scene.segment_count * probe["start"][kind] for kind in KINDS}
    seconds = {"simulate": {kind: steps * mean(kind) + start[kind] + scene.frame_count * probe["frame"][kind]
                            for kind in KINDS}}
    disk = scene.frame_count * probe["disk"]["frame"] + scene.segment_count * probe["disk"]["checkpoint"]
    for name, stage in measured["stages"].items():
        if "frame" in stage:
            processes = 1 if name == "metrics" else scene.segment_count
            seconds[name] = {kind: processes * stage["start"][kind] + scene.frame_count * stage["frame"][kind]
                             for kind in KINDS}
        else:
            seconds[name] = {kind: stage[kind] for kind in KINDS}
        disk += stage["disk"] * (scene.frame_count if "frame" in stage else 1)
    seconds["other"] = {kind: SMALL_STAGES * probe["imports"][kind] for kind in KINDS}
    return Prediction(
        scene.accuracy, scene.numerics.particle_spacing, probe["particles"], probe["wall_particles"],
        scene.output.duration / steps, steps, mean("pressure_iterations"), mean("viscosity_iterations"), seconds, start,
        measured["compilation"], total(scene, seconds, min(cores or available_cores(), available_cores())),
        max(measured["memory"], *(stage["memory"] for stage in measured["stages"].values())), disk,
        sum(phase["steps"] for phase in probe["phases"]), (*notes(scene, measured), *asked_back(scene, seconds)),
        errors_of(scene, measured["cavity_volume"]))


def spans(scene: Scene, measured: Mapping) -> Iterator[Span]:
    """Yield the parts of a scene."""
    interval, probe, rehearsals = scene.output.frame_interval, measured["probe"], measured["rehearsals"]
    phases = probe["phases"]
    if not (rehearsals and rehearsals[0]["frames"]):
        lost = scene.output.duration / sum(phase["end"] - phase["begin"] for phase in phases)
        for phase in phases:  # every frame ends with a whole step; what could not be probed is as all the rest
            frames = lost * (phase["end"] - phase["begin"]) / interval
            yield Span(max(1, round(frames * math.ceil(interval / phase["time_step"] - 1e-9))), phase["wall"],
                       phase["cpu"], phase["pressure_iterations"], phase["viscosity_iterations"])
        return
    (phase,), frames = phases, rehearsals[0]["frames"]
    probed = phase["steps"] * phase["time_step"] / interval  # its last steps were looked at
    early = frames[int(SETTLING * probed):math.ceil(probed)] or frames
    first = {name: sum(frame[name] for frame in early) / len(early) for name in ROUNDS}
    more_steps = growth(scene, measured)
    solves = sum(phase.get(f"part {name}", 0.0) for name in SOLVES) / phase["wall"]
    lost = (scene.frame_count - 1) / len(frames)
    for frame, number in zip(frames, steps_in(scene, measured, rehearsals[0]), strict=True):
        rounds = {name: frame[name] / first[name] if first[name] else 1.0 for name in ROUNDS}
        more = 1.0 + solves * (rounds["pressure_iterations"] - 1.0)
        yield Span(round(lost * more_steps * number), more * phase["wall"], more * phase["cpu"],
                   *(phase[name] * ratio for name, ratio in rounds.items()))


def steps_in(scene: Scene, measured: Mapping, rehearsal: Mapping) -> list[int]:
    """Return the time steps of every frame of a scene, if its motion is that of a rehearsal."""
    interval, finer = scene.output.frame_interval, scene.numerics.particle_spacing / rehearsal["spacing"]
    return [math.ceil(interval / min(measured["probe"]["limit"], finer * frame["time_step"]) - 1e-9)
            for frame in rehearsal["frames"]]


def growth(scene: Scene, measured: Mapping) -> float:
    """Return by what the steps of a scene are more than those of its rehearsal; a coarser one tells the power law."""
    if len(measured["rehearsals"]) < 2:
        return 1.0
    fine, coarse = measured["rehearsals"]
    pairs = list(zip(steps_in(scene, measured, fine), steps_in(scene, measured, coarse), strict=False))
    if not pairs:
        return 1.0
    more, fewer = map(sum, zip(*pairs, strict=True))
    power = math.log(more / fewer) / math.log(coarse["spacing"] / fine["spacing"])
    return (fine["spacing"] / scene.numerics.particle_spacing) ** power


def asked_back(scene: Scene, seconds: Mapping[str, Mapping[str, float]]) -> Iterator[str]:
    """Yield a sentence where the simulation takes longer than its scene allows."""
    if seconds["simulate"]["wall"] > scene.allowed_time:
        yield (f"the simulation takes longer than allowed_time, {duration(scene.allowed_time)}, and will be refused "
               "until the scene allows more")


def notes(scene: Scene, measured: Mapping) -> Iterator[str]:
    """Yield sentences on what could not be measured."""
    if scene.output.until_rest:
        yield f"counted up to {scene.output.duration:g} s, but the scene ends when it rests, which is not foretold"
    for failure in measured["probe"]["failed"]:
        yield f"counted as the other phases are, because it could not be probed: {failure}"
    rehearsal = measured["rehearsals"][0] if measured["rehearsals"] else None
    if rehearsal and not rehearsal["frames"]:
        yield ("the motion could not be rehearsed, so that all steps are counted as the first ones, and there may be "
               f"more: {'; '.join(rehearsal['failed'])}")
    elif rehearsal and len(rehearsal["frames"]) < scene.frame_count - 1:
        reason = f" ({rehearsal['failed'][0]})" if rehearsal["failed"] else ""
        until = len(rehearsal["frames"]) * scene.output.frame_interval
        yield f"the motion was rehearsed up to {until:.3g} s{reason}: what follows is counted as its mean"


def total(scene: Scene, seconds: Mapping[str, Mapping[str, float]], cores: int) -> float:
    """Return the wall time of all stages, s: segments are a chain, and the last one is then drawn."""
    last = 1.0 / scene.segment_count
    chain = sum(stage["wall"] * (last if name in ("reconstruct", "render") else 1.0) for name, stage in seconds.items())
    return max(chain, sum(stage["cpu"] for stage in seconds.values()) / cores)
