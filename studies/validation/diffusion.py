"""Diffusion of volume fractions between particles at rest, from a step and from a Gaussian blob.

A step becomes alpha = erfc(x/(2 sqrt(D t)))/2: the second moment of its slope, 2 times the integral of
|x| |alpha - step|, is 2 D t. The mean square distance of a blob from its center grows by 4 D t in two dimensions. The
slope of these moments in time is D_eff. The box repeats itself across the gradient: particles within a support radius
of a wall lack partners there, so that diffusion along a wall is slower in that layer, which is not measured here.
"""
import dataclasses
import time
from typing import Any

import numpy as np
from scipy.special import erfc

from pipeline.studies.family import Family, Headline
from pipeline.studies.model import Curve, Figure, Outcome, Row, bounded, compared, observed_order
from sim.parameters import parameter
from sim.settings import Liquid
from studies.validation.kit.tank import PackedParameters, Stopwatch, build, cavity, field, time_rows

LENGTH = 1.0  # m, side of the box
COEFFICIENT = 1e-4  # m^2/s, D
DENSITIES = (1000.0, 500.0)  # kg/m^3
BLOB = 0.06  # width of the blob at the start, in sides of the box
END = 0.08  # sqrt(2 D t) at the end, in sides of the box
TIMES = 10  # at which the moment is taken
FIGURES = (
    Figure("diffusion_profile", "Step after diffusion, finest resolution", "x / sqrt(D t)", "volume fraction"),
    Figure("diffusion_error", "Error of the diffusion coefficient", "particle spacing / side", "relative error",
           logarithmic=True),
)


@dataclasses.dataclass(frozen=True)
class Parameters(PackedParameters):
    """A square box, periodic across the gradient; resolutions count particles along its side."""

    shape: str = parameter("step", choices=("step", "blob"), meaning="what diffuses")
    start: str = parameter("regular", choices=("regular", "packed"), meaning="lattice, or packed from disorder")
    tolerance: float = parameter(0.01, exclusive_minimum=0.0, meaning="allowed relative error of D_eff")


def run(case: Parameters) -> Outcome:
    """Measure D_eff at every resolution, and what is conserved."""
    outcome, errors = Outcome(), []
    name = f"{case.shape} {case.start} h/dx {case.support_ratio:g}"
    for resolution in case.resolutions:
        finest = resolution == max(case.resolutions)
        begin = time.perf_counter()
        times, moments, solver, drift, seconds = _spread(case, resolution)
        at: dict[str, Any] = {"at": f"n={resolution}", "wall_s": time.perf_counter() - begin}
        effective = np.polyfit(times, moments, 1)[0] / (2.0 if case.shape == "step" else 4.0)
        row = compared("D_eff / D", effective / COEFFICIENT, 1.0, case.tolerance if finest else None, **at)
        errors.append(row.error)
        outcome.rows += [row, bounded("change of the volume of a liquid / volume", drift, 1e-12, **at),
                         Row("particles", float(solver.count[None]), **at),
                         Row("sub-steps per exchange", float(solver.effects[0].sub_steps), **at),
                         *time_rows(seconds, **at)]
    spacings = [LENGTH / resolution for resolution in case.resolutions]
    outcome.rows.append(Row("observed order of D_eff", observed_order(spacings, errors)))
    outcome.curves.append(Curve("diffusion_error", name, spacings, errors))
    if case.shape == "step":
        x = field(solver, "position")[:, 0] / np.sqrt(COEFFICIENT * times[-1])
        order, near = np.argsort(x), np.linspace(-5.0, 5.0, 101)
        outcome.curves += [
            Curve("diffusion_profile", name, x[order], field(solver, "volume_fraction")[order, 1]),
            Curve("diffusion_profile", "exact", near, 0.5 * erfc(0.5 * near), "reference")]
    return outcome


def _spread(case: Parameters, resolution: int):
    """Times, s, moments, m^2, the solver, the relative change of the volume of the second liquid, and seconds taken."""
    spacing = LENGTH / resolution
    arrays = cavity("box", (LENGTH, LENGTH), spacing, start=case.start, support_ratio=case.support_ratio,
                    seed=case.seed, periodic=(1,) if case.shape == "step" else (0, 1))
    solver = build(case, arrays, liquids=[Liquid(f"liquid_{k}", rho, 0.0) for k, rho in enumerate(DENSITIES)],
                   effects={"diffusion": {"coefficient": COEFFICIENT}})
    position, volume = field(solver, "position"), field(solver, "volume")
    if case.shape == "step":
        begin = (position[:, 0] < 0.0).astype(float)
    else:
        begin = np.exp(-(position**2).sum(axis=1) / (2.0 * (BLOB * LENGTH) ** 2))
    set_fractions(solver, np.stack([1.0 - begin, begin], axis=1))

    def moment() -> float:
        fraction = field(solver, "volume_fraction")[:, 1]
        if case.shape == "step":
            return float(2.0 / LENGTH * (volume * np.abs(position[:, 0])) @ np.abs(fraction - begin))
        return float((volume * (position**2).sum(axis=1)) @ fraction / (volume @ fraction))

    until = 0.5 * (END * LENGTH) ** 2 / COEFFICIENT
    times, moments, total = np.linspace(0.0, until, TIMES + 1), [moment()], volume @ begin
    stopwatch = Stopwatch()
    for _ in stopwatch.timed(solver.effects[0].prepare(until / TIMES) for _ in range(TIMES)):
        moments.append(moment())
    drift = abs(volume @ field(solver, "volume_fraction")[:, 1] - total) / total
    # A sharp step is known to a particle spacing only: the first moment would count that too.
    return times[1:], np.array(moments[1:]), solver, float(drift), stopwatch.seconds()


def set_fractions(solver, fractions: np.ndarray) -> None:
    """Give the particles volume fractions, (n, liquids), and the masses that go with them."""
    density = np.array([liquid.density for liquid in solver.liquids])
    solver.particles.from_numpy("volume_fraction", fractions)
    solver.particles.from_numpy("mass", field(solver, "volume") * (fractions @ density))


FAMILY = Family(__name__, Parameters, run, effects=("diffusion",), figures=FIGURES,
                headline=Headline("D_eff / D", 1.0))
