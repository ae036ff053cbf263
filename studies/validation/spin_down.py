"""Spin-down of a liquid that turns like a solid body, in a circle whose wall stops at once.

The velocity along the angle decays as a sum of J_1(j_k r/R) exp(-j_k^2 nu t/R^2), j_k the zeros of the Bessel function
J_1; after a while as the first of them, exp(-14.68 nu t/R^2). It is the friction at the wall that is measured, as in
the eye after a saccade.
"""
import dataclasses

import numpy as np
from scipy.special import jn_zeros

from pipeline.studies.family import Family
from pipeline.studies.model import Curve, Figure, Outcome, Row, compared, observed_order
from sim.parameters import parameter
from sim.settings import Liquid
from studies.validation.kit.tank import Run, TankParameters, advance, build, cavity, field

RADIUS = 1.0  # m, R
DENSITY = 1000.0  # kg/m^3
RATE = 1.0  # 1/s, angular velocity of the start
ZEROS = jn_zeros(1, 6)  # of J_1, the first ones
SETTLING = 0.5  # e-foldings of the first mode in which the higher ones fall to a few percent
FIGURES = (
    Figure("spin_down_decay", "Spin of a liquid in a circle that stopped, finest resolution", "14.68 nu t / R²",
           "ln(angular momentum / start)"),
    Figure("spin_down_error", "Error of the decay rate", "particle spacing / radius", "relative error",
           logarithmic=True),
)


@dataclasses.dataclass(frozen=True)
class Parameters(TankParameters):
    """A circle packed from disorder; resolutions count particles along the radius."""

    reynolds: float = parameter(10.0, exclusive_minimum=0.0, meaning="angular velocity R^2 / nu at the start")
    form: str = parameter("central", choices=("central", "laplacian", "strain"), meaning="form of the viscous forces")
    decay: float = parameter(2.0, minimum=1.0, meaning="length of the run in e-foldings of the first mode")
    steps: int = parameter(200, minimum=10, meaning="smallest number of time steps per e-folding")
    tolerance: float = parameter(0.05, exclusive_minimum=0.0, meaning="allowed relative error of the decay rate")


def run(case: Parameters) -> Outcome:
    """Measure the decay rate of the angular momentum at every resolution, and its order."""
    outcome, errors, expected = Outcome(), [], decay_rate(case.reynolds)
    name = f"{case.form} Re {case.reynolds:g}"
    for resolution in case.resolutions:
        result = _spin_down(case, resolution)
        finest = resolution == max(case.resolutions)
        scaled = expected * result.history["time"]
        measured = np.nan if result.failure else _late_rate(scaled, result.history["spin"])
        row = compared("decay rate of the angular momentum R² / nu", measured * ZEROS[0] ** 2,
                       _late_rate(scaled, exact_spin(scaled)) * ZEROS[0] ** 2,
                       case.tolerance if finest else None, at=result.label, wall_s=result.wall_s)
        errors.append(row.error)
        outcome.rows += [row, Row("viscosity iterations per step", float(result.values("iterations")[1:].mean()),
                             at=result.label, wall_s=result.wall_s), *result.rows()]
        outcome.remarks += result.remarks(name)
    spacings = [RADIUS / resolution for resolution in case.resolutions]
    outcome.rows.append(Row("observed order of the decay rate", observed_order(spacings, errors)))
    outcome.curves.append(Curve("spin_down_error", name, spacings, errors))
    if not result.failure:
        spin = result.history["spin"]
        outcome.curves += [Curve("spin_down_decay", name, scaled, np.log(spin / spin[0]), "line"),
                           Curve("spin_down_decay", "exact", scaled, np.log(exact_spin(scaled)), "reference")]
    return outcome


def decay_rate(reynolds: float) -> float:
    """Rate at which the first mode decays, 14.68 nu / R^2, 1/s."""
    return ZEROS[0] ** 2 * RATE / reynolds


def exact_spin(scaled: np.ndarray) -> np.ndarray:
    """Angular momentum over that of the start, at times in e-foldings of the first mode.

    The modes of a solid body have shares 8/j_k^2; those beyond the ones listed matter at the very start only.
    """
    modes = 8.0 / ZEROS**2 * np.exp(-np.multiply.outer(np.asarray(scaled), (ZEROS / ZEROS[0]) ** 2))
    return modes.sum(axis=-1) + np.where(np.asarray(scaled) == 0.0, 1.0 - (8.0 / ZEROS**2).sum(), 0.0)


def _spin_down(case: Parameters, resolution: int) -> Run:
    arrays = cavity("circle", RADIUS, RADIUS / resolution, start="packed", support_ratio=case.support_ratio)
    rate = decay_rate(case.reynolds)
    solver = build(case, arrays, effects={"viscosity_implicit": {"form": case.form}},
                   liquids=(Liquid("liquid", DENSITY, DENSITY * RATE * RADIUS**2 / case.reynolds),),
                   velocity=lambda x: RATE * np.stack([-x[:, 1], x[:, 0]], axis=1), viscosity_tolerance=1e-6,
                   maximum_time_step=1.0 / (case.steps * rate), minimum_time_step=1e-8 / rate)
    return advance(solver, case.decay / rate, f"n={resolution}", _watch)


def _watch(solver) -> dict[str, float]:
    mass, position, velocity = (field(solver, name) for name in ("mass", "position", "velocity"))
    spin = mass @ (position[:, 0] * velocity[:, 1] - position[:, 1] * velocity[:, 0])
    return {"spin": float(spin), "iterations": solver.statistics.get("viscosity_iterations", 0.0)}


def _late_rate(scaled: np.ndarray, spin: np.ndarray) -> float:
    """Slope of the logarithm after `SETTLING`; 1 for the first mode alone."""
    late = scaled > SETTLING
    return float(-np.polyfit(scaled[late], np.log(spin[late]), 1)[0])


FAMILY = Family(__name__, Parameters, run, effects=("viscosity", "viscosity_implicit"), figures=FIGURES)
