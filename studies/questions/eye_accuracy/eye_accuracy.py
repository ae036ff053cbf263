"""The eye of a scene with particles of several sizes and from several starts: how near to rest, for how long a wait.

What the oil covers at the end is set beside the shape of least energy (`pipeline.equilibrium`) of the same fill in the
posture at the end; what it covers on the way beside the finest run, by the page of the study. A start is another place
of the lattice that the particles begin on. A run of the scene itself is read, not made twice.
"""
import collections
import dataclasses
import functools
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from pipeline.base.errors import UserError
from pipeline.base.progress import progress
from pipeline.base.tables import TIME
from pipeline.cavity.signed_distance_grid import distance_to_triangles
from pipeline.cavity.surface import cavity_mesh
from pipeline.cavity.voxels import voxelize
from pipeline.equilibrium.contact import Contact, shares
from pipeline.equilibrium.of_scene import rest_of
from pipeline.measures.events import events_of
from pipeline.measures.frame_view import Measured
from pipeline.measures.rest import at_rest, rest_begins, row_of_coverage
from pipeline.runs.run_folder import RunFolder
from pipeline.scenes.model import Scene
from pipeline.simulation.runner import Runner
from pipeline.simulation.solver_setup import build_solver, frame_of
from pipeline.studies.family import Family
from pipeline.studies.model import WALL_TIME, Curve, Figure, Outcome, Row
from sim.parameters import parameter
from studies.questions.eye_accuracy._words import EYE_RUNS, covered_at

if TYPE_CHECKING:
    import trimesh

PARTS = {"whole": "retina", "superior": "superior", "inferior": "inferior", "macula": "macula"}
NEIGHBORS = 100     # within a support of 2.5 spacings there are 65
LONGEST_EDGE = 1e-3  # m
BETWEEN = 8         # places in a particle spacing
LAST = 1.0          # s at the end, whose mean is told: single particles at the wall come and go
FIGURES = (Figure("eye_accuracy_course", "Retina under oil over time", "time / s", "covered retina / %"),)


@dataclasses.dataclass(frozen=True)
class Parameters:
    """One run of the eye."""

    scene: str = parameter("tamponade", meaning="scene of an eye with oil")
    accuracy: str = parameter("draft", meaning="level of accuracy.yaml whose numerics it has")
    particle_spacing: float | None = parameter(None, unit="m", exclusive_minimum=0.0,
                                               meaning="particle spacing, else that of the level")
    seed: int = parameter(0, minimum=0, meaning="of the place of the lattice at the start; 0 is that of a run")
    own_run: bool = parameter(False, meaning="read the scene's own run at the level in place of solving it again")
    times: tuple[float, ...] = parameter((1.0, 2.0, 3.0, 4.0, 6.0, 8.0), unit="s", exclusive_minimum=0.0,
                                         meaning="times at which the covered retina is told")
    precision: str = parameter("f32", choices=("f32", "f64"), meaning="floating point format of the fields")


def scenes(case: Parameters) -> tuple[str, ...]:
    """The scene whose own run is read."""
    return (case.scene,) if case.own_run else ()


def solves(case: Parameters) -> str:
    """The scene."""
    return case.scene


@dataclasses.dataclass(frozen=True)
class Course:
    """A run that is over.

    Attributes
    ----------
    table : columns of metrics, (frames,).
    late : frames of the last second.
    seconds : of the steps by the clock, without those in which kernels are compiled.
    """

    scene: Scene
    initial: dict[str, np.ndarray]
    table: dict[str, np.ndarray]
    late: list[Measured]
    seconds: float


def run(case: Parameters, runs: Mapping[str, RunFolder], scene: Scene) -> Outcome:
    """Solve the scene, or read its own run, and set it beside the shape of least energy.

    Raises
    ------
    UserError : the scene's own run is asked for with another spacing or start than it has.
    """
    if case.own_run and (case.particle_spacing is not None or case.seed):
        raise UserError("own_run: the run of the scene itself has the particle spacing of its level and the seed 0; "
                        "leave particle_spacing and seed out")
    return compared(case, read(runs[case.scene]) if runs else solved(changed(case, scene), case.seed))


def changed(case: Parameters, scene: Scene) -> Scene:
    """Return the scene with the particle spacing and precision of a case."""
    spacing = scene.numerics.particle_spacing if case.particle_spacing is None else case.particle_spacing
    return dataclasses.replace(scene, numerics=dataclasses.replace(
        scene.numerics, particle_spacing=spacing, precision=case.precision, threads=0))


def frames_at_the_end(scene: Scene) -> int:
    """Return how many frames the last second has."""
    return round(LAST / scene.output.frame_interval) + 1


def solved(scene: Scene, seed: int) -> Course:
    """Solve a scene from one start, frame by frame, as a run does.

    Raises
    ------
    UserError : the scene starts from another one.
    """
    if scene.start_from:
        raise UserError(f"{scene.name}: starts from {scene.start_from}, and cannot be solved alone; take own_run: true")
    shift = np.random.default_rng(seed).uniform(-0.5, 0.5, 3) if seed else np.zeros(3)
    initial = voxelize(scene, cavity_mesh(scene.eye)[0], shift=shift)[0]
    runner = Runner(None, functools.partial(build_solver, scene, initial))
    good, rows, clocks = runner.solver.state(), [], []
    late: collections.deque[Measured] = collections.deque(maxlen=frames_at_the_end(scene))
    ends = {scene.frames_of_segment(segment)[-1] for segment in range(scene.segment_count)}
    label = f"{scene.name}, {1e3 * scene.numerics.particle_spacing:g} mm, start {seed}"
    with progress(scene.frame_count, label) as bar:
        for index in range(scene.frame_count):
            begin = time.perf_counter()
            statistics = runner.advance(good, index * scene.output.frame_interval, lambda *_: None)
            good = runner.solver.state()
            clocks.append(time.perf_counter() - begin)
            late.append(Measured(scene, initial, frame_of(scene, runner.solver, statistics)))
            rows.append(row_of(late[-1]))
            bar.update(1)
            if scene.output.until_rest and index in ends and at_rest(table := columns(rows), events(
                    scene, initial, table)):
                break
    return Course(scene, initial, columns(rows), list(late), without_compilation(clocks[1:]))


def row_of(state: Measured) -> dict[str, float]:
    """Return what is watched of a frame, under the names of the metrics."""
    macula = state.wall.retina_masks()["macula"]
    return row_of_coverage(state) | {column_of("macula"): 100.0 * state.wall.covered_share(macula)}


def column_of(part: str) -> str:
    """Return the name of the metric of a covered share."""
    return f"retina_coverage_{part} [%]"


def columns(rows: Sequence[dict[str, float]]) -> dict[str, np.ndarray]:
    """Return rows as a table."""
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def events(scene: Scene, initial: dict[str, np.ndarray], table: dict[str, np.ndarray]):
    """Return what happens in a scene."""
    return events_of(scene, table, float(initial["cavity_volume"]))


def read(run: RunFolder) -> Course:
    """Read what the run of a scene has left in its folder."""
    seconds = sum(without_compilation([frame["wall_seconds"] for frame in one["frames"] if frame["frame"] > 0])
                  for one in run.costs)
    late = [Measured(run.scene, run.initial, frame.read()) for frame in run.frames[-frames_at_the_end(run.scene):]]
    return Course(run.scene, run.initial, run.table, late, seconds)


def without_compilation(seconds: Sequence[float]) -> float:
    """Return what the frames after one start of the solver took: the first, which compiles, counts as the others do."""
    return len(seconds) * float(np.mean(seconds[1:] or seconds)) if seconds else 0.0


def deepest_aqueous(state: Measured, wall: "trimesh.Trimesh") -> float:
    """Return how far from the wall the aqueous reaches, m: the deepest point of the pool that the oil leaves.

    A place is in the aqueous where the liquid around it, weighted by a kernel, is mostly that; so a single particle in
    the oil is none. Such places are looked for between the particles too. The signed distance of a run is exact near
    the wall only.
    """
    tree, spacing = cKDTree(state.frame.position), state.frame.particle_spacing
    place = state.frame.position[state.oil_fraction < 0.5].astype(float)
    place = place[oil_around(state, tree, place) < 0.5]
    if not len(place):
        return 0.0
    depth, foot = cKDTree(wall.vertices).query(place)
    deep = depth > depth.max() - spacing
    inward = (place[deep] - wall.vertices[foot[deep]]) / depth[deep, None]
    place = (place[deep] + spacing * np.linspace(0.0, 1.0, BETWEEN + 1)[:, None, None] * inward).reshape(-1, 3)
    place = place[oil_around(state, tree, place) < 0.5]
    return float(distance_to_triangles(wall, place, LONGEST_EDGE).max())


def oil_around(state: Measured, tree: cKDTree, place: np.ndarray) -> np.ndarray:
    """Return the share of the oil in the liquid around places (n, 3), m, weighted by a kernel, (n,); 1 without any."""
    near, index = tree.query(place, k=min(NEIGHBORS, tree.n), distance_upper_bound=state.support_radius)
    ratio = np.minimum(near / state.support_radius, 1.0)
    index = np.minimum(index, tree.n - 1)  # those beyond the radius have no weight
    weight = (1.0 - ratio) ** 4 * (1.0 + 4.0 * ratio) * state.frame.volume[index]
    total = weight.sum(axis=1)
    return np.where(total > 0.0, (weight * state.oil_fraction[index]).sum(axis=1) / np.maximum(total, 1e-300), 1.0)


def compared(case: Parameters, course: Course) -> Outcome:
    """Return what a run tells beside the shape of least energy of its fill and posture at the end.

    Raises
    ------
    UserError : no shape was found.
    """
    scene, table, end = course.scene, course.table, course.late[-1]
    gravity = end.frame.gravity
    exact = rest_of(scene, gravity / np.linalg.norm(gravity), float(end.frame.fill[end.oil] / end.cavity_volume))
    spacing, particles = 1e3 * scene.numerics.particle_spacing, len(course.initial["fluid_position"])
    label = f"{spacing:g} mm, start {case.seed}"
    row = functools.partial(Row, at=label, wall_s=course.seconds)
    outcome, sharp = Outcome(), shares(Contact.of(exact))
    late = table[TIME] > table[TIME][-1] - LAST - 0.5 * scene.output.frame_interval
    covered = {part: float(table[column_of(part)][late].mean()) for part in PARTS}
    for part, name in PARTS.items():
        reference = 100.0 * sharp[name]
        outcome.rows.append(row(f"covered at the end, {part}", covered[part], "%", reference=reference,
                                error=abs(covered[part] - reference)))
    wall = cavity_mesh(scene.eye)[0]
    deepest = float(np.mean([deepest_aqueous(state, wall) for state in course.late]))
    deepest_at_rest = float(distance_to_triangles(wall, exact.surface, LONGEST_EDGE).max())
    outcome.rows.append(row("deepest aqueous at the end", deepest, "m", reference=deepest_at_rest,
                            error=abs(deepest - deepest_at_rest)))
    begins = rest_begins(table, events(scene, course.initial, table))
    if np.isfinite(begins):
        outcome.rows.append(row("time to rest", begins, "s"))
    else:
        outcome.remarks.append(f"{label}: not at rest within {table[TIME][-1]:g} s.")
    way = {covered_at(moment): float(np.interp(moment, table[TIME], table[column_of("whole")]))
           for moment in case.times if moment <= table[TIME][-1] + 1e-9}
    outcome.rows += [row(name.removesuffix(" [%]"), value, "%") for name, value in way.items()]
    outcome.rows += [row("particles", float(particles)), row(WALL_TIME, course.seconds, "s")]
    outcome.curves.append(Curve("eye_accuracy_course", label, table[TIME], table[column_of("whole")], "line"))
    values = (spacing, case.seed, particles, course.seconds / 60.0, covered["whole"],
              100.0 * sharp["retina"], 1e3 * deepest, 1e3 * deepest_at_rest, begins)
    outcome.tables["eye_runs"] = [[*EYE_RUNS, *way], [scene.name, case.accuracy, *(f"{one:.6g}" for one in values),
                                                     *(f"{one:.6g}" for one in way.values())]]
    return outcome


# With the metrics of a run, its frames and costs are there; the wait that the figure tells is that on two cores.
FAMILY = Family(__name__, Parameters, run, scenes=scenes, reads=(), solves=solves, unnamed=("times",),
                figures=FIGURES, threads=2)
