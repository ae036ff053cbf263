"""What oil leaves behind on the wall of a tube or between plates when it drives out aqueous [bretherton1961].

A meniscus that moves along a wall that aqueous wets leaves a film behind. Far behind it the film is thin against the
radius R of the tube (of half the distance of plates) by a power of the film's capillary number Ca = mu_film U/sigma,

    h = 1.34 c R Ca^(2/3),

with c = 1 behind gas. Behind oil that is far more viscous than the film c lies between 2^(2/3) and 4^(2/3)
[hodges2004]: the latter as long as lambda = mu_oil/mu_film is below Ca^(-2/3). In an eye this is a fraction of a
particle. So of a film as thick as a particle, which is all that particles can leave, hardly any may stay: less than
half a particle on the mean is what rounding would leave of it.

Oil enters a closed tube at one end and as much aqueous leaves at the other (``sim.effects.injection``), at a speed that
has no time to rise and fall. The tube stands upright, and the front goes down, which is the way of films, or up, or
gravity is left out, as in theory. With the ends of the tube round (flat in two dimensions) and the first oil a plug,
what is left on the wall is counted from one radius beyond the start of the front to two behind its end.
"""
import dataclasses
from typing import Any

import numpy as np

from pipeline.cavity.initial_state import initial_arrays
from pipeline.cavity.lattice import deepest_points
from pipeline.cavity.signed_distance_grid import distance_of_function
from pipeline.cavity.wall_layers import wall_layers
from pipeline.studies.family import Family
from pipeline.studies.model import Curve, Figure, Outcome, Row, bounded
from sim.effects.parts.contact_line import DEPOSIT, THICKEST, VISCOUS
from sim.parameters import parameter
from sim.settings import Liquid
from studies.validation.kit.tank import PackedParameters, Run, advance, build, cavity, field, film_exchanges, packed

GRAVITY, TENSION = 9.81, 0.04  # m/s^2, N/m
AQUEOUS, OIL = Liquid("aqueous", 1005.0, 7e-4), Liquid("oil", 970.0, 1.0)
CONTACT_ANGLE = np.radians(18.2)
LENGTH, START = 12.0, 2.5  # of the tube, and of the oil in it at the start, in radii
TRAVEL = 5.0  # way of the front, in radii
AFTER, BEFORE = 1.0, 2.0  # radii beyond the start and behind the end of the front between which the film is counted
WALL_LAYERS = 3
FIGURES = (Figure("deposited_film", "Film that oil leaves behind, with a particle's thickness for comparison",
                  "capillary number of the film", "thickness / radius", logarithmic=True),)


@dataclasses.dataclass(frozen=True)
class Parameters(PackedParameters):
    """Oil drives aqueous along a closed tube; resolutions count particles along its radius."""

    support_ratio: float = parameter(2.5, minimum=2.0, maximum=4.0,
                                     meaning="support radius of the kernel in particle spacings")
    dimension: int = parameter(2, choices=(2, 3), meaning="two plates or a round tube")
    radius: float = parameter(5e-3, unit="m", exclusive_minimum=0.0,
                              meaning="radius of the tube, half the distance of plates")
    capillary_number: float = parameter(1e-4, exclusive_minimum=0.0, maximum=1e-2,
                                        meaning="viscosity of the aqueous times speed of the front over tension")
    front: str = parameter("down", choices=("down", "up", "weightless"),
                           meaning="way of the front, with the oil behind it; weightless: up, without gravity")
    film: str = parameter("slides", choices=("slides", "stays"),
                          meaning="whether films slide as a whole, or only as their particles do")
    resolutions: tuple[int, ...] = parameter((8,), minimum=4, meaning="particles along the radius, coarse to fine")


def run(case: Parameters) -> Outcome:
    """Measure what is left on the wall at every resolution."""
    outcome = Outcome()
    name = f"{case.dimension}D front {case.front}" + ("" if case.film == "slides" else ", film left alone")
    for resolution in case.resolutions:
        result = drive(case, resolution)
        outcome.remarks += result.remarks(f"{name}, Ca {case.capillary_number:g}")
        outcome.rows += _rows(case, result)
        left = float(result.values("left")[-1])
        outcome.curves += [
            Curve("deposited_film", f"{name}, {result.label}", [case.capillary_number],
                  [left * result.solver.spacing / case.radius]),
            Curve("deposited_film", f"one particle, {result.label}", [case.capillary_number],
                  [result.solver.spacing / case.radius])]
    numbers = np.geomspace(1e-5, 1e-3, 20)
    theory = DEPOSIT * numbers ** (2.0 / 3.0)
    outcome.curves += [Curve("deposited_film", words, numbers, factor * theory, "reference")
                       for words, factor in (("Bretherton, times 2^(2/3)", VISCOUS), ("times 4^(2/3)", THICKEST))]
    return outcome


def film_behind(case: Parameters, factor: float) -> float:
    """Thickness of the film by theory, m, with c of the viscosities."""
    return DEPOSIT * factor * case.radius * case.capillary_number ** (2.0 / 3.0)


def speed_of_front(case: Parameters) -> float:
    """U, m/s."""
    return case.capillary_number * TENSION / AQUEOUS.dynamic_viscosity


def _rows(case: Parameters, result: Run) -> list[Row]:
    common: dict[str, Any] = {"at": result.label, "wall_s": result.wall_s}
    spacing, left = result.solver.spacing, result.values("left")
    rows = [bounded("mean thickness of the film left behind / spacing", float(left[-1]), 0.5, **common),
            Row("film behind by theory, times 2^(2/3) / spacing", film_behind(case, VISCOUS) / spacing, **common),
            Row("film behind by theory, times 4^(2/3) / spacing", film_behind(case, THICKEST) / spacing, **common),
            Row("way of the front / radius", float(result.values("front")[-1]) / case.radius, reference=TRAVEL,
                error=abs(float(result.values("front")[-1]) / case.radius - TRAVEL), **common)]
    if case.film == "slides":
        rows.append(Row("particles that changed places", float(result.values("exchanges").sum()), **common))
    return rows + result.rows()


def tube(case: Parameters, spacing: float) -> dict[str, np.ndarray]:
    """Arrays of a tube along y around the origin: a box in two dimensions, else round with round ends."""
    length = LENGTH * case.radius
    if case.dimension == 2:
        return cavity("box", (2.0 * case.radius, length), spacing, start="packed", support_ratio=case.support_ratio,
                      seed=case.seed)
    straight = 0.5 * length - case.radius
    corner = np.array([case.radius, 0.5 * length, case.radius])

    def to_wall(x):
        along = np.sign(x[..., 1]) * np.minimum(np.abs(x[..., 1]), straight)
        return np.linalg.norm(x - along[..., None] * np.array([0.0, 1.0, 0.0]), axis=-1) - case.radius

    distance = distance_of_function(to_wall, -corner, corner, 0.5 * spacing, margin=(WALL_LAYERS + 2) * spacing)
    volume = np.pi * case.radius**2 * (2.0 * straight + 4.0 / 3.0 * case.radius)
    points = deepest_points(distance, -corner, corner, round(volume / spacing**3), spacing)
    arrays = initial_arrays(points, wall_layers(distance, spacing, WALL_LAYERS), distance, volume, spacing)
    return packed(arrays, "packed", case.support_ratio, case.seed)


def drive(case: Parameters, resolution: int) -> Run:
    """Drive the front along the tube, with so many particles along its radius."""
    spacing, radius, speed = case.radius / resolution, case.radius, speed_of_front(case)
    arrays, half = tube(case, spacing), 0.5 * LENGTH * radius
    section = 2.0 * radius if case.dimension == 2 else np.pi * radius**2
    oil = section * START * radius if case.dimension == 2 else section * (START - 1.0 / 3.0) * radius
    heading = -1.0 if case.front == "down" else 1.0
    gravity = 0.0 if case.front == "weightless" else GRAVITY

    def way(x):
        """Way from the end at which oil enters, along the tube, m."""
        return half + heading * x[:, 1]

    def watch(solver) -> dict[str, float]:
        place, volume = field(solver, "position"), field(solver, "volume")
        aqueous, along = field(solver, "phase") == 0, way(place)
        front = (volume[~aqueous].sum() - oil) / section
        behind = START * radius + AFTER * radius, START * radius + front - BEFORE * radius
        counted = aqueous & (solver.distance.at(place) > -1.5 * spacing) & (along > behind[0]) & (along < behind[1])
        around = 2.0 if case.dimension == 2 else 2.0 * np.pi * radius
        thickness = volume[counted].sum() / (around * max(behind[1] - behind[0], spacing))
        return {"front": float(front), "left": float(thickness / spacing),
                "exchanges": film_exchanges(solver)}

    tip = heading * (radius - half)
    effects: dict[str, Any] = {
        "injection": {"liquid": "oil", "drained_liquid": "aqueous", "flow": section * speed, "ramp": 0.0,
                      "fill": min(0.95, (oil + 1.1 * section * TRAVEL * radius) / float(arrays["cavity_volume"])),
                      "cannula": (0.0, tip, 0.0), "drain": (0.0, -tip, 0.0), "radius": 0.5 * radius},
        "gravity": {"magnitude": gravity}, "viscosity_implicit": {},
        "interface_tension": {"coefficient": TENSION, "contact_angle": CONTACT_ANGLE}}
    if case.film == "slides":
        effects["wall_film"] = {}
    solver = build(case, arrays, liquids=(AQUEOUS, OIL), effects=effects, phase=lambda x: way(x) < START * radius,
                   maximum_time_step=case.largest_step * np.sqrt(spacing / GRAVITY))
    return advance(solver, TRAVEL * radius / speed, f"R/dx={resolution}", watch)


FAMILY = Family(__name__, Parameters, run,
                effects=("injection", "gravity", "viscosity_implicit", "interface_tension", "wall_film"),
                figures=FIGURES)
