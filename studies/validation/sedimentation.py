"""A light liquid, spread evenly in a column, drifts to the top (Kynch 1952); particles are at rest.

With equal viscosities the slip v_s = d^2 (rho_1 - rho_2) g/(18 mu) 6/5 does not depend on the fractions, and the volume
flux of the light liquid is alpha (1 - alpha) v_s. From alpha_0 everywhere, clear heavy liquid grows at the bottom with
(1 - alpha_0) v_s and light liquid at the top with alpha_0 v_s; both fronts stay sharp and meet after H/v_s.
"""
import dataclasses
import time
from typing import Any

import numpy as np

from pipeline.studies.family import Family
from pipeline.studies.model import Curve, Figure, Outcome, Row, bounded, compared, observed_order
from sim.parameters import parameter
from sim.settings import Liquid
from studies.validation.diffusion import set_fractions
from studies.validation.kit.tank import TankParameters, build, cavity, field

HEIGHT = 1.0  # m, H
GRAVITY = 10.0  # m/s^2
DENSITIES = (1000.0, 900.0)  # kg/m^3, heavy and light
DIAMETER = 1e-3  # m
VISCOSITY = DIAMETER**2 * (DENSITIES[0] - DENSITIES[1]) * GRAVITY / 18.0 * 1.2 / 0.01  # Pa s, for 0.01 m/s
SLIP = 0.01  # m/s, v_s
FEWEST_ACROSS = 8  # particles across the column, which repeats itself
TIMES = (0.2, 0.4, 0.6, 0.8)  # of the measurement, in H/v_s
FIGURES = (
    Figure("sedimentation_profile", "Light liquid in a column, finest resolution", "height / H",
           "volume fraction of the light liquid"),
    Figure("sedimentation_error", "Largest error of the fronts", "particle spacing / H",
           "error / way of the front", logarithmic=True),
)


@dataclasses.dataclass(frozen=True)
class Parameters(TankParameters):
    """A closed column, periodic sideways; resolutions count particles along its height."""

    fraction: float = parameter(0.5, exclusive_minimum=0.0, maximum=0.99, meaning="alpha_0 of the light liquid")
    form: str = parameter("algebraic", choices=("algebraic", "dynamic"), meaning="form of the slip")
    start: str = parameter("regular", choices=("regular", "packed"), meaning="lattice, or packed from disorder")
    courant: float = parameter(0.25, exclusive_minimum=0.0, meaning="way of the slip per step, in particle spacings")
    tolerance: float = parameter(0.05, exclusive_minimum=0.0, meaning="allowed error of the fronts over their way")


def run(case: Parameters) -> Outcome:
    """Measure both fronts at every resolution, the bounds and what is conserved."""
    outcome, errors = Outcome(), []
    name = f"alpha_0 {case.fraction:g} {case.form} {case.start}"
    for resolution in case.resolutions:
        begin = time.perf_counter()
        profiles, extremes, change = _settle(case, resolution)
        tolerance = case.tolerance if resolution == max(case.resolutions) else None
        at: dict[str, Any] = {"at": f"n={resolution}", "wall_s": time.perf_counter() - begin}
        worst = 0.0
        for scaled, (height, fraction) in zip(TIMES, profiles, strict=True):
            fronts = _fronts(height, fraction, case.fraction)
            for which, found, exact in zip(("bottom", "top"), fronts, exact_fronts(case.fraction, scaled), strict=True):
                row = compared(f"{which} front / H at t v_s/H = {scaled:g}", found, exact, tolerance, **at)
                worst = max(worst, row.error)
                outcome.rows.append(row)
        errors.append(worst)
        outcome.rows += [
            bounded("volume fraction beyond 0 and 1", max(0.0, -extremes[0], extremes[1] - 1.0), 1e-12, **at),
            bounded("change of the volume of a liquid / volume", change, 1e-12, **at)]
    spacings = [1.0 / resolution for resolution in case.resolutions]
    outcome.rows.append(Row("observed order of the fronts", observed_order(spacings, errors)))
    outcome.curves.append(Curve("sedimentation_error", name, spacings, errors))
    for scaled, (height, fraction) in list(zip(TIMES, profiles, strict=True))[1::2]:
        bottom, top = exact_fronts(case.fraction, scaled)
        outcome.curves += [
            Curve("sedimentation_profile", f"{name}, t v_s/H = {scaled:g}", height, fraction),
            Curve("sedimentation_profile", "exact", [0.0, bottom, bottom, 1.0 - top, 1.0 - top, 1.0],
                  [0.0, 0.0, case.fraction, case.fraction, 1.0, 1.0], "reference")]
    return outcome


def exact_fronts(fraction: float, scaled: float) -> tuple[float, float]:
    """Depth of the clear liquid at the bottom and of the light liquid at the top over H, until they meet."""
    return (1.0 - fraction) * scaled, fraction * scaled


def _settle(case: Parameters, resolution: int):
    """Profiles at the times, the smallest and largest fraction ever, and the change of the light liquid's volume."""
    spacing = HEIGHT / resolution
    arrays = cavity("box", (FEWEST_ACROSS * spacing, HEIGHT), spacing, start=case.start,
                    support_ratio=case.support_ratio, periodic=(0,))
    solver = build(case, arrays, liquids=[Liquid(f"liquid_{k}", rho, VISCOSITY) for k, rho in enumerate(DENSITIES)],
                   effects={"gravity": {"magnitude": GRAVITY},
                            "drift": {"droplet_diameter": DIAMETER, "form": case.form}})
    drift = next(effect for effect in solver.effects if effect.name == "drift")
    even = np.full(solver.count[None], case.fraction)
    set_fractions(solver, np.stack([1.0 - even, even], axis=1))
    volume, height = field(solver, "volume"), field(solver, "position")[:, 1] / HEIGHT + 0.5
    profiles, low, high, reached = [], 1.0, 0.0, 0.0
    for scaled in TIMES:
        steps = int(np.ceil((scaled - reached) * resolution / case.courant))
        for _ in range(steps):
            drift.prepare((scaled - reached) / steps * HEIGHT / SLIP)
            fraction = field(solver, "volume_fraction")[:, 1]
            low, high = min(low, fraction.min()), max(high, fraction.max())
        reached = scaled
        rows = np.clip((height * resolution).astype(int), 0, resolution - 1)
        share = np.bincount(rows, volume * fraction, resolution) / np.bincount(rows, volume, resolution)
        profiles.append(((np.arange(resolution) + 0.5) / resolution, share))
    total = volume @ even
    return profiles, (low, high), abs(volume @ field(solver, "volume_fraction")[:, 1] - total) / total


def _fronts(height: np.ndarray, fraction: np.ndarray, initial: float) -> tuple[float, float]:
    """Where the profile crosses half of each jump: depth at the bottom and at the top over H."""
    bottom = np.flatnonzero(fraction > 0.5 * initial)[0]
    top = np.flatnonzero(fraction < 0.5 * (1.0 + initial))[-1]
    return (_crossing(height, fraction, bottom, 0.5 * initial),
            1.0 - _crossing(height, fraction, top + 1, 0.5 * (1.0 + initial)))


def _crossing(height: np.ndarray, fraction: np.ndarray, above: int, level: float) -> float:
    """Height at which the profile passes a level between the rows ``above - 1`` and ``above``."""
    if not 0 < above < len(height):
        return float(above > 0)
    low, high = fraction[above - 1], fraction[above]
    return float(height[above - 1] + (level - low) / (high - low) * (height[above] - height[above - 1]))


FAMILY = Family(__name__, Parameters, run, effects=("drift", "gravity"), figures=FIGURES)
