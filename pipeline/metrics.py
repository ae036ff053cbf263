"""Stage: numbers of every frame, as a table, plots and a summary.

To add a metric, write one function of a :class:`~pipeline.measures.frame_view.Measured` state and register it with
``@metric``: it becomes a column of ``metrics.csv`` (one per entry, if it returns several numbers), a plot, and a row of
the report, in the order of its ``place``. Those of mixtures are in
:mod:`pipeline.measures.mixing_metrics`, those of eyes that turn in :mod:`pipeline.measures.rotation_metrics`, those of
breaks and regions in :mod:`pipeline.measures.place_metrics`, those that an effect knows by itself in its file
(`Effect.measures`); ``--list`` prints what every column means.
"""
import argparse
import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from pipeline.base import energies
from pipeline.base.cli import run, stage_parser
from pipeline.base.frame_files import frames_of, read_course, read_frame
from pipeline.base.progress import progress
from pipeline.base.sequences import FRAMES_AGAIN
from pipeline.base.tables import write_table
from pipeline.base.usage import frame_done
from pipeline.cavity.initial_state import load_initial
from pipeline.measures import mixing_metrics, place_metrics, rotation_metrics
from pipeline.measures.contact_arc import contact_arc as contact_arc_of
from pipeline.measures.events import events_of
from pipeline.measures.film_course import FilmCourse
from pipeline.measures.frame_view import MIXED, Measured
from pipeline.measures.isolation import isolated
from pipeline.measures.least_energy import least_energy_of
from pipeline.measures.metric import Metric, metrics_of_effect, registrar, write_meanings
from pipeline.measures.place_course import courses_of
from pipeline.measures.places import Places, places_of
from pipeline.measures.plots import write_plots
from pipeline.measures.rest import rest_in_words
from pipeline.measures.shown import shown_metrics
from pipeline.measures.summary import write_summary
from pipeline.runs.segments import check_segments
from pipeline.scenes.effects import SOLVES, illustration_in_words
from pipeline.scenes.load import load_resolved
from pipeline.scenes.model import Scene
from pipeline.surfaces.surface_files import read_surface
from sim.effects import REGISTRY

# A particle that an injection has filled to less than this share is still growing out of its neighbor.
FULL_PARTICLE = 0.5

METRICS: list[Metric] = []
metric = registrar(METRICS)


def metrics_of(scene: Scene) -> list[Metric]:
    """Return the metrics that have a meaning in a scene."""
    return [one for one in METRICS if one.applies_to(scene)]


@metric("s", "simulated time")
def time(state):
    return state.frame.time


@metric("mL", "volume of each liquid; like energies, in two dimensions that of a layer 1 m deep", place=11)
def volume(state):
    return dict(zip(state.frame.liquids, 1e6 * state.frame.fill, strict=True))


@metric("%", "share of the cavity that the oil fills", of_eye=True, place=6, limits=(0.0, 100.0))
def fill(state):
    return 100 * state.frame.fill[state.oil] / state.cavity_volume


@metric("mm", "center of mass of each liquid (in an eye x to the patient's left, y superior, z anterior)", place=10)
def center_of_mass(state):
    masses = state.frame.volume[:, None].astype(float) * state.frame.volume_fraction
    with np.errstate(invalid="ignore", divide="ignore"):
        centers = 1e3 * (masses.T @ state.frame.position) / masses.sum(axis=0)[:, None]
    return {f"{liquid}_{axis}": center for liquid, row in zip(state.frame.liquids, centers, strict=True)
            for axis, center in zip("xyz", row, strict=False)}


@metric("J", "kinetic energy of the liquids", place=17)
def kinetic_energy(state):
    return energies.kinetic_energy(state.mass, state.frame.velocity)


@metric("J", "potential energy of the liquids, 0 when their center of mass is in the center of the eye, or at the "
             "lower corner of the container", place=18)
def potential_energy(state):
    gravity = state.frame.gravity[:state.frame.dimension]
    return energies.potential_energy(state.mass, state.frame.position, gravity)


@metric("mm/s", "root mean square and largest speed of the particles", place=9)
def speed(state):
    square = np.sum(state.frame.velocity.astype(float)**2, axis=1)
    return {"rms": 1e3 * np.sqrt(square.sum() / max(len(square), 1)), "largest": 1e3 * np.sqrt(square.max(initial=0.0))}


@metric("1", "largest compression of a particle: the volume of its neighbors, weighted by the kernel; 1 at rest")
def compression_maximum(state):
    return state.statistic("compression_maximum")


@metric("1", "iterations of the pressure solve per step since the frame before")
def pressure_iterations(state):
    return state.statistic("pressure_iterations")


@metric("1", "iterations of the viscosity solve per step since the frame before")
def viscosity_iterations(state):
    return state.statistic("viscosity_iterations")


@metric("%", "share of the time steps since the frame before in which a solve ended at its limit of iterations")
def limit_hit(state):
    return {solve: 100 * state.statistic(f"{solve}_limit_hit") for solve in SOLVES}


@metric("s", "time step")
def time_step(state):
    return state.statistic("time_step")


@metric("%", "share of the whole wall that is under oil, which touches it or a film too thin for the particles",
        of_eye=True, place=4, uncertainty="wall_coverage_band", limits=(0.0, 100.0))
def wall_coverage(state):
    return 100 * state.wall.covered_share()


@metric("%", "share of the wall within one particle spacing of the contact line: half of it is the uncertainty of the "
             "coverage", of_eye=True)
def wall_coverage_band(state):
    return 100 * state.wall.band_share()


@metric("deg", "arc of the wall that is under oil in the sagittal plane, seen from the center of the eye",
        of_eye=True, place=5, uncertainty="contact_arc_band", limits=(0.0, 360.0))
def contact_arc(state):
    return contact_arc_of(state.distance, state.frame.position, state.oil_fraction > 0.5, state.frame.particle_spacing,
                          state.contact_angle)


@metric("deg", "arc of the wall in that plane within one particle spacing of the contact line: half of it is the "
               "uncertainty of the arc", of_eye=True)
def contact_arc_band(state):
    return state.wall.contact_arc_band()


@metric("%", "share of the retina (within 115 degrees of the posterior pole), of its halves and of the macula (disc of "
             "5.5 mm at the pole) that is under oil: the sum of what the oil touches and of what lies under a film of "
             "aqueous that is too thin for the particles (`retina_contact` and `retina_film`, where they are told)",
        of_eye=True, place=1, uncertainty="retina_coverage_band", limits=(0.0, 100.0))
def retina_coverage(state):
    return {name: 100 * state.wall.covered_share(mask) for name, mask in state.wall.retina_masks().items()}


@metric("%", "share of the same parts of the retina that the oil touches: theory, by how fast the front passed and how "
             "long ago; where oil is at the start, it touches", of_eye=True, of_film=True, place=2, limits=(0.0, 100.0))
def retina_contact(state):
    return {name: 100 * (state.wall.covered_share(mask) - state.film.film_share(mask))
            for name, mask in state.wall.retina_masks().items()}


@metric("%", "share of them that is under oil, with a film of aqueous between that is too thin for the particles: "
             "theory; with `retina_contact` it adds up to `retina_coverage`", of_eye=True, of_film=True, place=2,
        limits=(0.0, 100.0))
def retina_film(state):
    return {name: 100 * state.film.film_share(mask) for name, mask in state.wall.retina_masks().items()}


@metric("%", "share of them that is bare: neither touched nor under such a film", of_eye=True, of_film=True, place=15,
        limits=(0.0, 100.0))
def retina_bare(state):
    return {name: 100 * (1.0 - state.wall.covered_share(mask)) for name, mask in state.wall.retina_masks().items()}


@metric("um", "thickness of nine tenths of the film on the retina, smallest and largest, by theory: as the front left "
              "it, and thinner by its weight", of_eye=True, of_film=True, place=8)
def retina_film_thickness(state):
    ends = state.film.thickness_range(state.wall.retina_masks()["whole"])
    return dict(zip(("smallest", "largest"), (1e6 * end for end in ends), strict=True))


@metric("%", "share of the same parts of the retina within one particle spacing of the contact line: half of it is the "
             "uncertainty of their coverage", of_eye=True)
def retina_coverage_band(state):
    return {name: 100 * state.wall.band_share(mask) for name, mask in state.wall.retina_masks().items()}


@metric("1", "smallest and largest volume fraction of the oil", of_eye=True, limits=(0.0, 1.0))
def volume_fraction(state):
    fraction = state.oil_fraction
    return {"smallest": fraction.min(initial=np.inf), "largest": fraction.max(initial=-np.inf)}


@metric("mL", "volume of the emulsion, where the volume fraction of the oil is between 0.05 and 0.95", of_eye=True,
        place=14)
def emulsified_volume(state):
    mixed = (state.oil_fraction > MIXED[0]) & (state.oil_fraction < MIXED[1])
    return 1e6 * np.sum(state.frame.volume[mixed])


@metric("1", "number of particles outside the wall")
def particles_outside(state):
    return np.count_nonzero(state.distance.sample(state.frame.position) > 0)


@metric("1", "particles that the wall itself stopped, 0.1 spacings short of it, per step since the frame before")
def wall_contacts(state):
    return state.statistic("wall_contacts")


@metric("1", "smallest distance of two full-grown particles, in particle spacings")
def smallest_spacing(state):
    full = state.frame.volume > FULL_PARTICLE * state.frame.particle_spacing**state.frame.dimension
    if np.count_nonzero(full) < 2:
        return np.nan
    position = state.frame.position[full]
    return cKDTree(position).query(position, k=2)[0][:, 1].min() / state.frame.particle_spacing


@metric("1", "particles of each liquid with more than 90 % of their neighbors in one other liquid: artifacts of the "
             "interface")
def isolated_particles(state):
    alone = isolated(state.frame.position, state.frame.phase, len(state.frame.liquids), state.support_radius)
    return {liquid: np.count_nonzero(alone & (state.frame.phase == k)) for k, liquid in enumerate(state.frame.liquids)}


METRICS += mixing_metrics.METRICS
METRICS += [one for effect in REGISTRY.values() for one in metrics_of_effect(effect)]
METRICS += rotation_metrics.METRICS
METRICS += place_metrics.METRICS


def measure(scene: Scene, initial: dict[str, np.ndarray], paths: Sequence[Path], places: Places | None = None
            ) -> dict[str, np.ndarray]:
    """Return the metrics of frames: column -> one number per frame, beginning with ``frame``.

    Parameters
    ----------
    initial : arrays of ``initial.npz``.
    paths : files of frames, in the order of time.
    places : breaks and regions of the scene, where it has any.
    """
    table: dict[str, list[float]] = {}
    films = FilmCourse.of(scene, float(initial["cavity_volume"]))
    with progress(len(paths), f"{scene.name}: metrics") as bar:
        for path, frame in read_course(paths):
            state = Measured(scene, initial, frame, places).after(films)
            row: dict[str, float] = {"frame": int(path.stem.rpartition("_")[2])}
            for one in metrics_of(scene):
                row |= one.columns(state)
            for column, number in row.items():
                table.setdefault(column, []).append(number)
            frame_done()
            bar.update(1)
    return {column: np.array(numbers, float) for column, numbers in table.items()}


class ListMetrics(argparse.Action):
    """Option that prints every metric with its unit and meaning, and ends."""

    def __init__(self, *arguments, **options):
        super().__init__(*arguments, nargs=0, **options)

    def __call__(self, parser, *_) -> None:
        for one in METRICS:
            where = " and ".join(name for name, of in (("eyes", one.of_eye), ("mixtures", one.of_mixture),
                                                         ("eyes that turn", one.of_rotation),
                                                       ("scenes whose films are known", one.of_film),
                                                       (f"scenes with {one.of_places}", one.of_places)) if of)
            print(f"{one.name} [{one.unit}]: {one.meaning}{where and f'; only of {where}'}")
        parser.exit()


def main(arguments: list[str] | None = None) -> None:
    """Command line: ``python -m pipeline.metrics scene.json initial.npz FRAMES_DIR... --output metrics.csv``."""
    parser = stage_parser("metrics", "Measure every frame of a scene.")
    parser.add_argument("--list", action=ListMetrics, help="print the meaning of every metric, and end")
    parser.add_argument("scene", type=Path, metavar="scene.json", help="resolved scene")
    parser.add_argument("initial", type=Path, metavar="initial.npz", help="wall and signed distance")
    parser.add_argument("folders", type=Path, nargs="+", metavar="FRAMES_DIR", help="folders of frames")
    parser.add_argument("--output", required=True, type=Path, metavar="FILE.csv", help="table to write")
    parser.add_argument("--summary", type=Path, metavar="FILE.html", help="page with one row per metric")
    parser.add_argument("--plots", type=Path, metavar="DIR",
                        help="folder for overview.png and one plot per metric that changes")
    parser.add_argument("--meanings", type=Path, metavar="FILE.json",
                        help="what the columns mean, when breaks were covered, and what the oil would touch at rest "
                             "(least energy), for the page of a run")
    parser.add_argument("--eye", type=Path, metavar="eye.vtp",
                        help="surface of the cavity, for a scene with breaks or regions")
    options = parser.parse_args(arguments)
    scene = load_resolved(options.scene)
    paths = frames_of(options.folders)
    check_segments(scene, paths, FRAMES_AGAIN)
    initial = load_initial(options.initial)
    wanted = options.eye is not None and (scene.breaks or scene.regions)
    places = places_of(scene, read_surface(options.eye) if wanted else None)
    table = measure(scene, initial, paths, places)
    write_table(options.output, table)
    courses = courses_of(table, scene)
    for course in courses:
        print(f"{scene.name}: {course.sentence()}", flush=True)
    shown = shown_metrics(table, metrics_of(scene))
    events = events_of(scene, table, float(initial["cavity_volume"]))
    if rest := "" if illustration_in_words(scene) else rest_in_words(table, events):
        print(f"{scene.name}: {rest}", flush=True)
    title = f"{scene.title or scene.name} ({scene.accuracy})"
    if options.meanings:
        resting, unknown = least_energy_of(scene, read_frame(paths[-1]), float(initial["cavity_volume"]))
        if resting is not None or unknown:
            print(f"{scene.name}: {unknown or resting.sentence()}", flush=True)
        write_meanings(options.meanings, metrics_of(scene), [course.record() for course in courses],
                       None if resting is None else dataclasses.asdict(resting))
    if options.summary:
        write_summary(options.summary, shown, table, scene, events, courses, rest)
    if options.plots:
        write_plots(options.plots, shown, table, events, title)


if __name__ == "__main__":
    run(main)
