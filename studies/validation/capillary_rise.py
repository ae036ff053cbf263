"""What tension lifts: the heavy of two liquids rises between two plates until its weight balances the tension.

The output adds the potential of the tension to the pressure, so that a pressure jump tells the curvature and little
else. Here the solved pressure has to carry a weight: the plates stand in a box that is full, both liquids go around
their ends, and the mean heights between and beside them differ, at rest, by (Jurin, exact for mean heights between
upright plates)

    2 sigma cos(theta) / (drho g) (1/w_in - 1/w_out) ,

whatever the shape of the interface. Both liquids start level.
"""
import dataclasses
from typing import Any

import numpy as np

from pipeline.cavity.container import block_lattice, distance_to_funnels, lattice_arrays
from pipeline.scenes.model import Funnel
from pipeline.studies.family import Family
from pipeline.studies.model import Curve, Figure, Outcome, bounded, compared
from sim.parameters import parameter
from sim.settings import Liquid
from studies.validation.kit.tank import PackedParameters, Run, advance, build, field, packed

GRAVITY = 9.81
HEAVY, LIGHT = 1005.0, 970.0  # kg/m^3, aqueous and silicone oil
INSIDE, OUTSIDE = 6e-3, 12e-3  # m, between the plates and from each of them to the side of the box
PLATE, END = 3e-3, 4e-3  # m, thickness of a plate, and what is left open below and above it
WIDTH = INSIDE + 2.0 * (PLATE + OUTSIDE)
WALL_LAYERS = 4
FIGURES = (Figure("capillary_rise", "Rise between two plates", "time / s", "difference of the heights / mm"),)


@dataclasses.dataclass(frozen=True)
class Parameters(PackedParameters):
    """Two plates in a full box as high as wide; resolutions count particles between the plates."""

    support_ratio: float = parameter(2.5, minimum=2.0, maximum=4.0,
                                     meaning="support radius of the kernel in particle spacings")
    contact_angle: float = parameter(60.0, unit="deg", minimum=0.0, maximum=180.0,
                                     meaning="contact angle through the heavy liquid")
    tension: float = parameter(0.04, unit="N/m", exclusive_minimum=0.0, meaning="interface tension")
    viscosity: float = parameter(0.01, unit="Pa*s", exclusive_minimum=0.0, meaning="viscosity of both liquids")
    duration: float = parameter(4.0, unit="s", exclusive_minimum=0.0, meaning="simulated time")
    resolutions: tuple[int, ...] = parameter((10, 16), minimum=6, meaning="particles between the plates, even numbers")
    tolerance: float = parameter(0.05, exclusive_minimum=0.0, meaning="allowed relative error of the rise")


def run(case: Parameters) -> Outcome:
    """Compare the rise with Jurin's at every resolution."""
    outcome, expected = Outcome(), exact_rise(case)
    for resolution in case.resolutions:
        result = _rise(case, resolution)
        outcome.remarks += result.remarks(f"{case.contact_angle:g} degrees")
        common: dict[str, Any] = {"at": result.label, "wall_s": result.wall_s}
        rise, late = result.values("rise"), max(1, result.history["time"].size // 10)
        outcome.rows += [
            compared("rise between the plates", 1e3 * rise[-late:].mean(), 1e3 * expected, case.tolerance, "mm",
                     **common),
            bounded("change in the last tenth / rise", float(np.ptp(rise[-late:])) / expected, 0.02, **common),
            *result.rows()]
        if not result.failure:
            shown = slice(None, None, max(1, rise.size // 400))
            outcome.curves.append(Curve("capillary_rise", f"{case.contact_angle:g} degrees, {result.label}",
                                        result.history["time"][shown], 1e3 * rise[shown], "line"))
    outcome.curves.append(Curve("capillary_rise", f"{case.contact_angle:g} degrees, Jurin", [0.0, case.duration],
                                [1e3 * expected] * 2, "reference"))
    return outcome


def exact_rise(case: Parameters) -> float:
    """Mean height between the plates less that beside them, m; negative where the heavy liquid does not wet them."""
    tension = 2.0 * case.tension * np.cos(np.radians(case.contact_angle))
    return tension / ((HEAVY - LIGHT) * GRAVITY) * (1.0 / INSIDE - 1.0 / OUTSIDE)


def rise_of(solver) -> dict[str, float]:
    """Mean height of the heavy liquid between the plates less that beside them, m, from the volumes of its particles.

    It is counted from a quarter of the height of the box on: all below stays heavy.
    """
    x, volume = field(solver, "position"), field(solver, "volume")
    heavy = (field(solver, "phase") == 0) & (x[:, 1] > 0.25 * WIDTH)
    away = np.abs(x[:, 0] - 0.5 * WIDTH)
    inside = volume[heavy & (away < 0.5 * INSIDE)].sum() / INSIDE
    outside = volume[heavy & (away > 0.5 * INSIDE + PLATE)].sum() / (2.0 * OUTSIDE)
    return {"rise": float(inside - outside)}


def plates() -> Funnel:
    """Two upright plates: a funnel in two dimensions that does not widen. Their ends are round."""
    end, radius = END + 0.5 * PLATE, 0.5 * (INSIDE + PLATE)
    return Funnel(center=(0.5 * WIDTH, end), lower_radius=radius, upper_radius=radius, height=WIDTH - 2.0 * end,
                  thickness=PLATE)


def _rise(case: Parameters, resolution: int) -> Run:
    spacing, box = INSIDE / resolution, (np.zeros(2), np.full(2, WIDTH))
    points, volume = block_lattice(*box, spacing)
    points = points[distance_to_funnels(points, [plates()]) > 0.0]
    arrays = packed(lattice_arrays(box, [(points, volume)], spacing, WALL_LAYERS, [plates()]), "packed",
                    case.support_ratio, case.seed)
    liquids = (Liquid("heavy", HEAVY, case.viscosity), Liquid("light", LIGHT, case.viscosity))
    solver = build(case, arrays, liquids=liquids,
                   phase=lambda x: x[:, 1] > 0.5 * WIDTH,
                   effects={"gravity": {"magnitude": GRAVITY}, "viscosity_implicit": {},
                            "interface_tension": {"coefficient": case.tension,
                                                  "contact_angle": np.radians(case.contact_angle)}},
                   maximum_time_step=case.largest_step * np.sqrt(spacing / GRAVITY))
    return advance(solver, case.duration, f"n={resolution}", rise_of)


FAMILY = Family(__name__, Parameters, run, effects=("gravity", "viscosity_implicit", "interface_tension"),
                figures=FIGURES)
