"""A drop at rest: the pressure jump of Laplace, and currents that must die away.

A drop of radius R in the middle of a round cavity of twice the radius, without gravity. The pressure inside is higher
by sigma (d - 1) / R; it is read as the mean within 0.6 R less that beyond 1.4 R. Most of that jump is the potential of
the tension itself, which is kept out of the solve and added on output: the jump tells how well the curvature is
measured, and the currents whether forces balance. Labels are rough by a fraction of a
spacing at the start, which sets the liquid in motion: the currents are read at the end as mu U / sigma with the largest
speed, and must have decayed, where forms without balance keep them up for ever.

A drop that starts as a square (3D: a cube) of the same volume must become round: the radii of the points of the
interface may scatter by a fiftieth, which in 2D is a circularity well above 0.98.
"""
import dataclasses
from typing import Any

import numpy as np

from pipeline.studies.family import Family, Headline
from pipeline.studies.model import Curve, Figure, Outcome, Row, bounded, compared
from sim.parameters import parameter
from sim.settings import Liquid
from studies.validation.kit.tank import PackedParameters, Run, advance, build, cavity, field

DENSITY = 1000.0  # kg/m^3
GRAVITY = 9.81  # m/s^2, of the largest time step only
CAVITY = 2.0  # radius of the cavity over that of the drop
INSIDE, OUTSIDE = 0.6, 1.4  # where the pressure is read, over the radius of the drop
JUMP_TOLERANCE = {2: 0.01, 3: 0.02}
CURRENT_TOLERANCE = 5e-4
ROUND = 0.02  # allowed scatter of the radii of a drop that was square
FIGURES = (
    Figure("laplace_jump", "Pressure jump of a drop", "sigma (d - 1) / R, Pa", "pressure jump, Pa"),
    Figure("laplace_currents", "Currents around a drop at rest", "time / sqrt(rho R^3 / sigma)",
           "log10 of viscosity x largest speed / tension"),
)


@dataclasses.dataclass(frozen=True)
class Parameters(PackedParameters):
    """A drop at rest in another liquid."""

    dimension: int = parameter(2, choices=(2, 3), meaning="a circle or a sphere")
    radius: float = parameter(0.005, unit="m", exclusive_minimum=0.0, meaning="radius of the drop")
    tension: float = parameter(0.04, unit="N/m", exclusive_minimum=0.0, meaning="interface tension")
    viscosity: float = parameter(0.1, unit="Pa*s", exclusive_minimum=0.0, meaning="viscosity of both liquids")
    density_ratio: float = parameter(1.0, exclusive_minimum=0.0, maximum=1.0, meaning="density of the drop over that "
                                                                                      "of the liquid around it")
    start: str = parameter("round", choices=("round", "square"), meaning="shape of the drop at the start")
    rest_times: float = parameter(12.0, exclusive_minimum=0.0, meaning="length of the run in sqrt(rho R^3 / sigma)")
    resolutions: tuple[int, ...] = parameter((8, 12), minimum=4, meaning="particles along the radius of the drop")


def run(case: Parameters) -> Outcome:
    """Measure the pressure jump and the currents at every resolution."""
    outcome = Outcome()
    name = f"{case.dimension}D R={1e3 * case.radius:g} mm sigma={1e3 * case.tension:g} mN/m"
    name += " from a square" if case.start == "square" else ""
    for resolution in case.resolutions:
        result = rest(case, resolution)
        outcome.rows += _rows(case, result)
        outcome.remarks += result.remarks(name)
        if not result.failure:
            outcome.curves += _curves(case, result, f"{name} {result.label}")
    return outcome


def rest(case: Parameters, resolution: int) -> Run:
    """Run a drop to rest."""
    arrays = cavity("circle", CAVITY * case.radius, case.radius / resolution, start="packed",
                    support_ratio=case.support_ratio, dimension=case.dimension, seed=case.seed)
    liquids = (Liquid("around", DENSITY, case.viscosity), Liquid("drop", DENSITY * case.density_ratio, case.viscosity))
    effects = {"viscosity_implicit": {}, "interface_tension": {"coefficient": case.tension}}
    solver = build(case, arrays, liquids=liquids, effects=effects,
                   phase=lambda x: _inside(case, x),
                   maximum_time_step=case.largest_step * np.sqrt(case.radius / resolution / GRAVITY))
    return advance(solver, case.rest_times * _time(case), f"R/dx={resolution}", currents)


def _inside(case: Parameters, x: np.ndarray) -> np.ndarray:
    """Which points belong to the drop of the start; square or round, it has the same volume."""
    if case.start == "round":
        return np.linalg.norm(x, axis=1) < case.radius
    side = case.radius * {2: np.sqrt(np.pi), 3: np.cbrt(4.0 / 3.0 * np.pi)}[case.dimension]
    return np.abs(x).max(axis=1) < 0.5 * side


def radii(solver) -> np.ndarray:
    """Distances of the points of the interface from their center, m."""
    tension = next(effect for effect in solver.effects if effect.name == "interface_tension")
    count = tension.point_count[None]
    point, area = tension.point.to_numpy()[:count].astype(float), tension.point_area.to_numpy()[:count]
    return np.linalg.norm(point - np.average(point, axis=0, weights=area), axis=1)


def _time(case: Parameters) -> float:
    """Time in which tension swings the drop, s."""
    return np.sqrt(DENSITY * case.radius**3 / case.tension)


def currents(solver) -> dict[str, float]:
    """Largest speed, m/s."""
    return {"speed": float(np.linalg.norm(field(solver, "velocity"), axis=1).max())}


def pressure_jump(case: Parameters, solver) -> tuple[float, float]:
    """Return the pressure inside less that outside, Pa, and the radius of a drop of the volume that the labels have."""
    state = solver.snapshot()
    inside = state["phase"] == 1
    volume = float(state["volume"][inside].sum())
    radius = np.sqrt(volume / np.pi) if case.dimension == 2 else np.cbrt(volume / (4.0 / 3.0 * np.pi))
    distance = np.linalg.norm(state["position"] - state["position"][inside].mean(axis=0), axis=1)
    pressure = state["pressure"]
    return float(pressure[distance < INSIDE * radius].mean() - pressure[distance > OUTSIDE * radius].mean()), radius


def _rows(case: Parameters, result: Run) -> list[Row]:
    common: dict[str, Any] = {"at": result.label, "wall_s": result.wall_s}
    jump, radius = pressure_jump(case, result.solver) if not result.failure else (np.nan, case.radius)
    current = case.viscosity * result.values("speed") / case.tension
    late = current[-max(1, len(current) // 20):].mean()
    middle = current[len(current) // 2: len(current) // 2 + max(1, len(current) // 20)].mean()
    rows = []
    if case.start == "square":
        found = radii(result.solver) if not result.failure else np.array([np.nan])
        rows = [bounded("scatter of the radii of the interface / mean", found.std() / found.mean(), ROUND, **common),
                compared("mean radius of the interface", found.mean(), radius, ROUND, "m", **common)]
    return [*rows,
            compared("pressure jump", jump, case.tension * (case.dimension - 1) / radius,
                     JUMP_TOLERANCE[case.dimension], "Pa", **common),
            bounded("viscosity x largest speed / tension at the end", float(late), CURRENT_TOLERANCE, **common),
            Row("largest speed at the end over that at half time", float(late / middle), reference=0.0,
                error=float(late / middle), tolerance=1.0, **common), *result.rows()]


def _curves(case: Parameters, result: Run, name: str) -> list[Curve]:
    jump, radius = pressure_jump(case, result.solver)
    expected = case.tension * (case.dimension - 1) / radius
    shown = slice(1, None, max(1, len(result.history["time"]) // 300))
    current = case.viscosity * result.history["speed"][shown] / case.tension
    return [Curve("laplace_jump", f"{case.dimension}D {result.label}", [expected], [jump]),
            Curve("laplace_jump", "Laplace", [0.0, 20.0], [0.0, 20.0], "reference"),
            Curve("laplace_currents", name, result.history["time"][shown] / _time(case),
                  np.log10(np.maximum(current, 1e-12)), "line")]


FAMILY = Family(__name__, Parameters, run, effects=("viscosity_implicit", "interface_tension"), figures=FIGURES,
                headline=Headline("pressure jump", 0.25, shown_by=("interface_tension",)))
