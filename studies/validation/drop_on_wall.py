"""A drop on a flat wall takes the contact angle that was asked for.

Without gravity a drop at a wall is a part of a circle (3D: ball) that meets the wall at the contact angle. Half a
circle is laid on the floor of a full box and comes to rest. The circle that parts the particles of the two liquids best
(`studies.validation.kit.interface_fit`), its radius and the height of its center free, gives the angle; height and base
of the drop, which follow from its volume, are compared beside it. What is compared is the mean of the last fifth of the
run.
"""
import dataclasses
from typing import Any

import numpy as np

from pipeline.studies.family import Family
from pipeline.studies.model import Curve, Figure, Outcome, Row, bounded, compared
from sim.parameters import parameter
from sim.settings import Liquid
from studies.validation.kit.interface_fit import part
from studies.validation.kit.tank import PackedParameters, Run, advance, build, cavity, field

DENSITY = 1000.0  # kg/m^3
WIDTH, HEIGHT = 6.0, 2.5  # sides of the box over the radius of the half circle at the start
READINGS = 60  # of the history
LATE = 0.2  # share of the run whose mean is compared
FIGURES = (
    Figure("drop_on_wall_angle", "Contact angle on the way to rest", "time / sqrt(rho R^3 / sigma)",
           "angle less that asked for, deg"),
    Figure("drop_on_wall", "Contact angle of a drop on a wall", "angle asked for, deg", "angle measured, deg"),
)


@dataclasses.dataclass(frozen=True)
class Parameters(PackedParameters):
    """A drop on a wall; resolutions count particles along the radius of the half circle at the start."""

    dimension: int = parameter(2, choices=(2, 3), meaning="part of a circle or of a ball")
    contact_angle: float = parameter(60.0, unit="deg", exclusive_minimum=0.0, maximum=179.0,
                                     meaning="contact angle through the drop")
    radius: float = parameter(0.004, unit="m", exclusive_minimum=0.0,
                              meaning="radius R of the half circle of the start")
    tension: float = parameter(0.04, unit="N/m", exclusive_minimum=0.0, meaning="interface tension")
    viscosity: float = parameter(0.1, unit="Pa*s", exclusive_minimum=0.0, meaning="viscosity of both liquids")
    rest_times: float = parameter(30.0, exclusive_minimum=0.0, meaning="length of the run in sqrt(rho R^3 / sigma)")
    tolerance: float = parameter(5.0, unit="deg", exclusive_minimum=0.0, meaning="allowed error of the angle")
    resolutions: tuple[int, ...] = parameter((8, 12), minimum=6, meaning="particles along R, coarse to fine")


def run(case: Parameters) -> Outcome:
    """Run to rest at every resolution and compare angle, height and base."""
    outcome = Outcome(curves=[Curve("drop_on_wall", "asked for", [0.0, 180.0], [0.0, 180.0], "reference")])
    name = f"{case.dimension}D {case.contact_angle:g} deg"
    for resolution in case.resolutions:
        result = _rest(case, resolution)
        outcome.remarks += result.remarks(name)
        outcome.rows += _rows(case, result)
        if not result.failure:
            shown = slice(None, None, max(1, len(result.history["time"]) // READINGS))
            outcome.curves += [
                Curve("drop_on_wall_angle", f"{name} {result.label}", result.history["time"][shown] / _time(case),
                      result.history["angle"][shown] - case.contact_angle, "line"),
                Curve("drop_on_wall", f"{case.dimension}D {result.label}", [case.contact_angle],
                      [_late(result, "angle").mean()])]
    return outcome


def shape(angle: float, volume: float, dimension: int) -> tuple[float, float, float]:
    """Radius, height and half the base, m, of a drop with a contact angle, rad, and a volume, m3 (m2 in 2D)."""
    if dimension == 2:
        radius = np.sqrt(volume / (angle - np.sin(angle) * np.cos(angle)))
    else:
        radius = np.cbrt(3.0 * volume / (np.pi * (2.0 + np.cos(angle)) * (1.0 - np.cos(angle)) ** 2))
    return radius, radius * (1.0 - np.cos(angle)), radius * np.sin(angle)


def _time(case: Parameters) -> float:
    return float(np.sqrt(DENSITY * case.radius**3 / case.tension))


def _rest(case: Parameters, resolution: int) -> Run:
    spacing = case.radius / resolution
    sides = spacing * np.round(resolution * np.array([WIDTH, HEIGHT, WIDTH][: case.dimension]))
    floor = -0.5 * sides[1]
    arrays = cavity("box", sides, spacing, start="packed", support_ratio=case.support_ratio, dimension=case.dimension,
                    seed=case.seed)
    foot = floor * np.eye(case.dimension)[1]
    solver = build(case, arrays, phase=lambda x: np.linalg.norm(x - foot, axis=1) > case.radius,
                   liquids=(Liquid("drop", DENSITY, case.viscosity), Liquid("around", DENSITY, case.viscosity)),
                   effects={"viscosity_implicit": {}, "interface_tension": {
                       "coefficient": case.tension, "contact_angle": np.radians(case.contact_angle)}},
                   maximum_time_step=0.02 * _time(case))
    return advance(solver, case.rest_times * _time(case), f"R/dx={resolution}", _watch(case, floor))


def _watch(case: Parameters, floor: float):
    """Return a function that reads the drop from time to time and repeats itself in between."""
    last: dict[str, float] = {}
    interval, due = case.rest_times * _time(case) / READINGS, [0.0]

    def watch(solver) -> dict[str, float]:
        if solver.time >= due[0]:
            due[0] += interval
            last.update(read(solver, floor, last))
        return dict(last)

    return watch


def read(solver, floor: float, last: dict[str, float]) -> dict[str, float]:
    """Angle, deg, height and half the base, m, of the drop; share of particles near its surface on the wrong side.

    Parameters
    ----------
    last : what was read before, from which the search starts; may be empty.
    """
    position, phase, volume = (field(solver, name) for name in ("position", "phase", "volume"))
    drop = phase < 0.5
    size = float(volume[drop].sum())
    middle = position[drop].mean(axis=0)
    middle[1] = floor
    guess = np.radians(last.get("angle", 90.0))
    radius = shape(guess, size, position.shape[1])[0]
    start = np.array([radius, -radius * np.cos(guess)])
    up = np.eye(position.shape[1])[1]

    def distance(unknown, chosen):
        return (unknown[0] - np.linalg.norm(position[chosen] - middle - unknown[1] * up, axis=1)) / solver.spacing

    (radius, center), mixed = part(distance, np.where(drop, 1.0, -1.0), start, np.full(2, 0.5 * solver.spacing))
    cosine = np.clip(-center / radius, -1.0, 1.0)
    return {"angle": float(np.degrees(np.arccos(cosine))), "height": float(radius + center),
            "base": float(radius * np.sqrt(1.0 - cosine**2)), "mixed": mixed, "volume": size}


def _late(result: Run, name: str) -> np.ndarray:
    if result.failure:
        return np.array([np.nan])
    return result.history[name][result.history["time"] > (1.0 - LATE) * result.until]


def _rows(case: Parameters, result: Run) -> list[Row]:
    common: dict[str, Any] = {"at": result.label, "wall_s": result.wall_s}
    angle, late = case.contact_angle, _late(result, "angle")
    _, height, base = shape(np.radians(angle), _late(result, "volume").mean(), case.dimension)
    drift = late[len(late) // 2:].mean() - late[: max(1, len(late) // 2)].mean()
    return [Row("contact angle", late.mean(), "deg", reference=angle, error=abs(late.mean() - angle),
                tolerance=case.tolerance, **common),
            compared("height of the drop", _late(result, "height").mean(), height, None, "m", **common),
            compared("half the base of the drop", _late(result, "base").mean(), base, None, "m", **common),
            bounded("drift of the angle over the last tenth", drift, 1.0, "deg", **common),
            Row("share of particles near the surface on the wrong side", _late(result, "mixed").mean(), **common),
            *result.rows()]


FAMILY = Family(__name__, Parameters, run, effects=("viscosity_implicit", "interface_tension"), figures=FIGURES)
