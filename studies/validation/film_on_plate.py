"""A film of aqueous on a plate under oil, one particle thick: it slides down, and on a level plate it stays.

Gravity along the plate pulls at a film of thickness h, and the wall and the oil hold it. Oil is a thousand times as
viscous and hardly moves, so the film flows as between two walls, with the mean speed of lubrication
[batchelor1967, section 4.8]

    u = (rho_film - rho_oil) g sin(inclination) h^2 / (12 mu_film) .

A film as thick as a particle cannot become thinner, as a real one does: it has to slide as a whole, and its upper end
with the speed u for h = dx. Below it is a pool of aqueous in a box that is full, which starts with the surface that it
has at rest between two plates: with y along the plates and x from one to the other, from 0 to w,

    sigma d(sin phi)/dx = (rho_film - rho_oil) g (x cos(inclination) + y sin(inclination)), tan phi = dy/dx,

and sin phi = -cos theta and cos theta at the plates (Young and Laplace), whatever y is counted from. The film begins
where it meets the plate, and is counted from where it does so with all of the film in the pool. The surface of the pool
is curved there and sucks at the film, by the weight of some capillary lengths of it: a shorter film leaves faster than
by its own weight. So at smaller spacings the tension is smaller too, by the square, and all lengths are the same in
particles.

A level plate has no down. What is on it stays. Where the film has a hole, its edges are contact lines, which leave the
wall no faster than viscosity lets them [cox1986] (``sim.effects.parts.contact_line``).
"""
import dataclasses
from typing import Any

import numpy as np
from scipy.integrate import solve_bvp

from pipeline.studies.family import Family
from pipeline.studies.model import Curve, Figure, Outcome, Row, bounded, compared
from sim.effects.parts.contact_line import fastest_retreat
from sim.parameters import parameter
from sim.settings import Liquid
from studies.validation.kit.tank import Run, TankParameters, advance, build, cavity, field, film_exchanges

GRAVITY = 9.81  # m/s^2
CONTACT_ANGLE = np.radians(18.2)
OIL, OIL_VISCOSITY = 970.0, 1.0  # kg/m^3, Pa s
WIDTH, POOL, ABOVE = 20, 8, 6  # particles from plate to plate, least depth of the pool, and of oil above the film
SIDES = 12  # particles along the plate across the slope, in three dimensions; the film takes half of them
MARGIN = 2  # particles above the pool at rest from which on the film is counted
LEAST = 0.25  # of the film, until which its speed is measured
START = 0.1  # of the time, in which the edges of a hole leap by up to a particle
FIGURES = (Figure("film_on_plate", "A film on a plate empties", "time over that of lubrication",
                  "film left above the pool"),)


@dataclasses.dataclass(frozen=True)
class Parameters(TankParameters):
    """A film on one wall of a box; resolutions count the particles of the film along the slope."""

    support_ratio: float = parameter(2.5, minimum=2.0, maximum=4.0,
                                     meaning="support radius of the kernel in particle spacings")
    dimension: int = parameter(2, choices=(2, 3), meaning="a film without sides, or one half as wide as the plate")
    spacing: float = parameter(1e-3, unit="m", exclusive_minimum=0.0,
                               meaning="particle spacing, which is the thickness of the film")
    inclination: float = parameter(90.0, unit="deg", minimum=0.0, maximum=90.0,
                                   meaning="angle between the plate and level; the film lies on its upper side")
    hole: int = parameter(0, minimum=0, meaning="particles that are missing in the middle of the film")
    film_viscosity: float = parameter(7e-4, unit="Pa*s", exclusive_minimum=0.0, meaning="viscosity of the aqueous")
    density_difference: float = parameter(35.0, unit="kg/m**3", exclusive_minimum=0.0,
                                          meaning="density of the aqueous less that of the oil")
    tension: float = parameter(0.04, unit="N/m", exclusive_minimum=0.0, meaning="interface tension")
    film: str = parameter("slides", choices=("slides", "stays"),
                          meaning="whether films slide as a whole, or only as their particles do")
    times: float = parameter(2.5, exclusive_minimum=0.0,
                             meaning="length of the run over the time in which an upright film slides by its length")
    resolutions: tuple[int, ...] = parameter((40,), minimum=12, meaning="particles of the film along the slope")
    # Gravity in full never acts: the limit of the tension is what counts.
    largest_step: float = parameter(0.2, exclusive_minimum=0.0, meaning="largest time step in sqrt(spacing / g)")
    tolerance: float = parameter(0.3, exclusive_minimum=0.0, meaning="allowed relative error of the speed")


def run(case: Parameters) -> Outcome:
    """Compare speed and what is left of the film at every length."""
    outcome = Outcome()
    name = (f"{case.dimension}D {case.inclination:g} deg dx {1e3 * case.spacing:g} mm, {1e3 * case.film_viscosity:g} "
            f"mPa s, {case.density_difference:g} kg/m3" + ("" if case.film == "slides" else ", film left alone"))
    for rows in case.resolutions:
        result, before = _slide(case, rows)
        outcome.remarks += result.remarks(name)
        common: dict[str, Any] = {"at": result.label, "wall_s": result.wall_s}
        outcome.rows += [*(_sliding if case.inclination else _level)(case, rows, result, common),
                         bounded("particles with another volume than at the start, liquid by liquid",
                                 np.nan if result.failure else _changed(before, volumes(result.solver)), 0.0,
                                 **common), *result.rows()]
        if case.inclination and not result.failure:
            shown = slice(None, None, max(1, result.history["time"].size // 300))
            time = result.history["time"] / (rows * case.spacing / lubrication(case))
            outcome.curves.append(Curve("film_on_plate", f"{name}, {result.label}", time[shown],
                                        (result.history["film"] / result.history["film"][0])[shown], "line"))
    return outcome


def lubrication(case: Parameters, inclination: float | None = None) -> float:
    """Speed of lubrication, m/s, at the inclination of the case or another one, deg."""
    slope = np.sin(np.radians(case.inclination if inclination is None else inclination))
    return float(case.density_difference * GRAVITY * slope * case.spacing**2 / (12.0 * case.film_viscosity))


def surface_of_pool(case: Parameters) -> tuple[np.ndarray, np.ndarray]:
    """Distance x from the plate and height y along it of the surface of the pool at rest, (n,) each, m.

    Heights are those over the mean one.
    """
    width, tilt = WIDTH * case.spacing, np.radians(case.inclination)
    constant = case.density_difference * GRAVITY / case.tension
    steep = float(np.cos(CONTACT_ANGLE))

    def slope(x, unknown):
        height, sine = unknown
        return np.stack([sine / np.sqrt(np.maximum(1.0 - sine**2, 1e-6)),
                         constant * (x * np.cos(tilt) + height * np.sin(tilt))])

    x = np.linspace(0.0, width, 101)
    guess = np.stack([2.0 * steep / (constant * width * np.sin(tilt)) - x / np.tan(tilt),
                      steep * (2.0 * x / width - 1.0)])
    found = solve_bvp(slope, lambda low, high: np.array([low[1] + steep, high[1] - steep]), x, guess, max_nodes=10**5)
    if not found.success:
        raise ValueError(f"the surface of the pool was not found: {found.message}")
    height = found.sol(x)[0]
    return x, height - np.trapezoid(height, x) / width


def depth_of_pool(case: Parameters) -> float:
    """Mean depth of the pool at the start, m: nowhere is it less than that of so many particles."""
    return float(POOL * case.spacing - surface_of_pool(case)[1].min())


def volumes(solver) -> list[np.ndarray]:
    """Volumes of the particles of both liquids, from small to large, m^3."""
    volume, phase = field(solver, "volume"), field(solver, "phase")
    return [np.sort(volume[phase == liquid]) for liquid in (0, 1)]


def _changed(before: list[np.ndarray], after: list[np.ndarray]) -> float:
    return float(sum(abs(a.size - b.size) + np.count_nonzero(a[:b.size] != b[:a.size])
                     for a, b in zip(before, after, strict=True)))


def _sliding(case: Parameters, rows: int, result: Run, common: dict[str, Any]) -> list[Row]:
    """Rows of a film on a slope: how fast it leaves, and what is left in the end.

    Nothing is asked of one that does not slide as a whole: it shows what slides without.
    """
    time, film, top = (result.values(name) for name in ("time", "film", "top"))
    late = int(np.argmax(film <= LEAST * film[0])) if (film <= LEAST * film[0]).any() else film.size - 1
    empties = (film[0] - film[late]) * case.spacing / time[late]
    speed = lubrication(case)
    return [compared("speed of the film's upper end / lubrication", (top[0] - top[late]) / time[late] / speed, 1.0,
                     case.tolerance if case.film == "slides" else None, **common),
            compared("speed at which the film empties / lubrication", empties / speed, 1.0, None, **common),
            Row("rows of the film above the pool at the start", film[0], **common),
            bounded("rows of the film left above the pool", film[-1], 1.0 if case.film == "slides" else None, **common),
            Row("time in which three quarters leave", time[late], "s", **common),
            *_exchanged(case, result, None, common)]


def _level(case: Parameters, rows: int, result: Run, common: dict[str, Any]) -> list[Row]:
    """Rows of a level film: nothing slides, and a hole does not grow faster than a contact line moves."""
    found = _exchanged(case, result, 0.0, common)
    if case.hole:
        time, hole = result.values("time"), result.values("hole")
        early = np.interp(START * time[-1], time, hole)
        fastest = fastest_retreat(float(CONTACT_ANGLE), case.tension, case.film_viscosity, OIL_VISCOSITY,
                                  rows * case.spacing)
        speed = 0.5 * (hole[-1] - early) / ((1.0 - START) * time[-1])
        found += [Row("speed of the edges of the hole / fastest retreat", speed / fastest, reference=1.0,
                      error=max(0.0, speed / fastest - 1.0), tolerance=0.0, **common),
                  Row("width of the hole", 1e3 * hole[-1], "mm", **common)]
    return found


def _exchanged(case: Parameters, result: Run, limit: float | None, common: dict[str, Any]) -> list[Row]:
    if case.film != "slides":
        return []
    total = float(result.values("exchanges").sum())
    return [bounded("particles that changed places", total, limit, **common) if limit is not None else
            Row("particles that changed places", total, **common)]


def _slide(case: Parameters, rows: int) -> tuple[Run, list[np.ndarray]]:
    """Run a film; also return the volumes at the start."""
    solver, watch = (_sloping if case.inclination else _flat)(case, rows)
    before = volumes(solver)
    until = case.times * rows * case.spacing / lubrication(case, None if case.inclination else 90.0)
    return advance(solver, until, f"{rows} rows", watch), before


def _sloping(case: Parameters, rows: int):
    """Solver of a film above a pool, and what is watched: how many rows of film are left and where its end is, m."""
    spacing, (across, surface), depth = case.spacing, surface_of_pool(case), depth_of_pool(case)
    begin = depth + surface[0]  # where the film begins, from the bottom
    floor = begin + (rows / WIDTH + MARGIN) * spacing
    size = _size(case, int(np.ceil(begin / spacing)) + rows + ABOVE)

    def is_oil(place):
        film = _in_film(case, place) & (place[:, 1] < begin + rows * spacing)
        return ~film & (place[:, 1] > depth + np.interp(place[:, 0], across, surface))

    def watch(solver) -> dict[str, float]:
        place = field(solver, "position") + 0.5 * size
        film = place[(field(solver, "phase") == 0) & (place[:, 0] < spacing) & (place[:, 1] > floor)]
        strip = np.zeros(len(film), int)  # one beside the other, as wide as a particle
        if case.dimension == 3:
            strip = np.clip(film[:, 2] / spacing - 0.25 * SIDES, 0, SIDES // 2 - 1).astype(int)
        tops = [film[strip == k, 1].max(initial=floor) for k in range(1 if case.dimension == 2 else SIDES // 2)]
        return {"film": len(film) / len(tops), "top": float(np.mean(tops)), "exchanges": film_exchanges(solver)}

    return _solver(case, size, is_oil), watch


def _flat(case: Parameters, rows: int):
    """Solver of a film on a level plate, and what is watched: the width of its hole, m."""
    size = _size(case, rows)
    middle = 0.5 * size[1]

    def is_oil(place):
        return ~(_in_film(case, place) & (np.abs(place[:, 1] - middle) > 0.5 * case.hole * case.spacing))

    def watch(solver) -> dict[str, float]:
        place = field(solver, "position") + 0.5 * size
        film = place[(field(solver, "phase") == 0) & (place[:, 0] < case.spacing), 1] - middle
        return {"hole": float(film[film > 0.0].min(initial=middle) - film[film < 0.0].max(initial=-middle)),
                "exchanges": film_exchanges(solver)}

    return _solver(case, size, is_oil), watch


def _size(case: Parameters, rows: int) -> np.ndarray:
    """Sides of the box, m."""
    return case.spacing * np.array([WIDTH, rows, SIDES][:case.dimension], float)


def _in_film(case: Parameters, place: np.ndarray) -> np.ndarray:
    """Whether places (n, dimension) are in the layer on the plate that is film, and between the sides of it."""
    inside = place[:, 0] < case.spacing
    if case.dimension == 3:
        inside &= np.abs(place[:, 2] / case.spacing - 0.5 * SIDES) < 0.25 * SIDES
    return inside


def _solver(case: Parameters, size: np.ndarray, is_oil):
    """Solver of a full box whose plate is at the low end of x; `is_oil` takes places from its corner."""
    spacing, tilt = case.spacing, np.radians(case.inclination)
    effects: dict[str, Any] = {
        "gravity": {"magnitude": GRAVITY, "orientation": ((0.0, -np.cos(tilt), -np.sin(tilt), 0.0),)},
        "viscosity_implicit": {}, "interface_tension": {"coefficient": case.tension, "contact_angle": CONTACT_ANGLE}}
    if case.film == "slides":
        effects["wall_film"] = {}
    return build(case, cavity("box", size, spacing, support_ratio=case.support_ratio, dimension=case.dimension),
                 liquids=(Liquid("aqueous", OIL + case.density_difference, case.film_viscosity),
                          Liquid("oil", OIL, OIL_VISCOSITY)),
                 effects=effects, phase=lambda x: is_oil(x + 0.5 * size),
                 maximum_time_step=case.largest_step * np.sqrt(spacing / GRAVITY))


FAMILY = Family(__name__, Parameters, run,
                effects=("gravity", "viscosity_implicit", "interface_tension", "wall_film"), figures=FIGURES)
