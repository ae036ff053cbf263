"""A tank that starts at rest stays at rest, for a long time and without any viscosity too.

Noise of the particles may neither heat the liquid nor carry its center of mass away. Under a free surface the column
also has to keep its volume (position-based fluids as published settle to 80 %): its height is twice the mean
height of its particles.

Two layers whose weights the level set of `interface_tension` tells apart are in balance to round-off, with a tension
or without, because it leaves nothing to the pressure that depends on the places of the particles. Where the labels of
the particles tell them apart the kink of the pressure at the interface does.
"""
import dataclasses
from typing import Any

import numpy as np

from pipeline.studies.family import Family
from pipeline.studies.model import Curve, Figure, Outcome, Row, bounded, compared, observed_order
from sim.parameters import parameter
from sim.settings import Liquid
from studies.validation.kit.tank import Run, TankParameters, advance, build, cavity, field, motion

GRAVITY = 9.81
HEIGHT = 0.02  # m
HEAVY = 1000.0  # kg/m^3
FIGURES = (
    Figure("still_tank_speed", "Motion of a still tank", "time / sqrt(H/g)", "log10 of rms speed / sqrt(g H)"),
)


@dataclasses.dataclass(frozen=True)
class Parameters(TankParameters):
    """Two layers at rest in a box; with a density ratio of 1 they are one liquid."""

    cavity: str = parameter("box", choices=("box", "open_box"), meaning="closed and full box, or a free surface")
    density_ratio: float = parameter(0.965, exclusive_minimum=0.0, maximum=1.0, meaning="light over heavy density")
    viscosity: float = parameter(0.0, unit="Pa*s", minimum=0.0, meaning="viscosity of both liquids")
    tension: float = parameter(0.0, unit="N/m", minimum=0.0, meaning="tension of the interface, at 90 degrees to the "
                                                                     "walls")
    interface: str = parameter("labels", choices=("labels", "level_set"),
                               meaning="what tells the weights apart without a tension")
    rest_times: float = parameter(20.0, exclusive_minimum=0.0, meaning="length of the run in sqrt(H/g)")
    start: str = parameter("regular", choices=("regular", "packed"), meaning="lattice, or packed from disorder")
    speed_tolerance: float = parameter(1e-3, exclusive_minimum=0.0, meaning="allowed speed over sqrt(g H)")


def run(case: Parameters) -> Outcome:
    """Measure the largest speed of the second half, the energy and the drift, at every resolution."""
    outcome, speeds = Outcome(), []
    name = (f"{case.scheme} 1:{case.density_ratio:g} {case.viscosity:g} Pa s {case.tension:g} N/m {case.cavity} "
            f"{case.start} {case.interface}")
    for resolution in case.resolutions:
        result = _rest(case, resolution)
        late = result.values("time") > 0.5 * result.until if not result.failure else slice(None)
        speed = result.values("speed")[late].max() / np.sqrt(GRAVITY * HEIGHT)
        mass = HEAVY * 0.25 * HEIGHT**2 * (1.0 + case.density_ratio)
        energy = result.values("kinetic_energy")[late].max() / (mass * GRAVITY * HEIGHT)
        drift = np.abs(result.values("height") - result.values("height")[0]).max() * resolution / HEIGHT
        speeds.append(speed)
        common: dict[str, Any] = {"at": result.label, "wall_s": result.wall_s}
        outcome.rows += [bounded("rms speed / sqrt(g H), second half", speed, case.speed_tolerance, **common),
                         bounded("kinetic energy / (m g H), second half", energy, 1e-5, **common),
                         bounded("drift of the center of mass / spacing", drift, 0.1, **common), *result.rows()]
        if case.cavity == "open_box":
            outcome.rows.append(compared("height of the column / start", _column(result), 1.0, 0.01, **common))
        outcome.remarks += result.remarks(name)
        if not result.failure:
            shown = slice(1, None, max(1, len(result.history["time"]) // 400))
            outcome.curves.append(Curve(
                "still_tank_speed", f"{name} {result.label}", result.history["time"][shown] / np.sqrt(HEIGHT / GRAVITY),
                np.log10(np.maximum(result.history["speed"][shown] / np.sqrt(GRAVITY * HEIGHT), 1e-12)), "line"))
    outcome.rows.append(Row("observed order of the speed", observed_order([1.0 / n for n in case.resolutions], speeds)))
    return outcome


def _column(result: Run) -> float:
    """Height of the liquid over that of the start."""
    return np.nan if result.failure else 2.0 * float(field(result.solver, "position")[:, 1].mean() + _floor()) / HEIGHT


def _floor() -> float:
    """Depth of the floor below the origin in an open box, m."""
    return 0.75 * HEIGHT


def _rest(case: Parameters, resolution: int) -> Run:
    spacing, is_open = HEIGHT / resolution, case.cavity == "open_box"
    arrays = cavity("box", (0.5 * HEIGHT, 1.5 * HEIGHT if is_open else HEIGHT), spacing, start=case.start,
                    support_ratio=case.support_ratio)
    level = 0.5 * HEIGHT - _floor() if is_open else 0.0
    liquids = [Liquid("heavy", HEAVY, case.viscosity), Liquid("light", HEAVY * case.density_ratio, case.viscosity)]
    layers = case.density_ratio < 1.0
    effects = {"gravity": {"magnitude": GRAVITY}}
    if case.viscosity:
        effects["viscosity_implicit"] = {}
    if case.tension or case.interface == "level_set":
        effects["interface_tension"] = {"coefficient": case.tension}
    solver = build(case, arrays, liquids=liquids if layers else liquids[:1], effects=effects,
                   phase=lambda x: (x[:, 1] > level) & layers,
                   filled=(lambda x: x[:, 1] < level + 0.5 * HEIGHT) if is_open else None,
                   maximum_time_step=case.largest_step * np.sqrt(spacing / GRAVITY))
    return advance(solver, case.rest_times * np.sqrt(HEIGHT / GRAVITY), f"n={resolution}", motion)


FAMILY = Family(__name__, Parameters, run, effects=("gravity", "viscosity_implicit", "interface_tension"),
                figures=FIGURES)
