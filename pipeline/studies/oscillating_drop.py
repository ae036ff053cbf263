"""A drop that is a little longer than wide oscillates (Lamb 1932, in two dimensions and between walls).

A drop of radius R and density rho in the middle of a round cavity of radius b, without gravity, in a liquid of density
rho_o and the same kinematic viscosity nu. Without viscosity its shape
R (1 + e cos 2 theta) swings with omega_0^2 = 6 sigma / ((rho + k rho_o) R^3), k = (1 + s)/(1 - s), s = (R/b)^4: the
liquid between drop and wall adds more mass than that around a lone drop (s = 0). The potential flows inside and outside
slip along each other by U (1 + k), U the speed of the interface. The layers in which viscosity prevents that share the
slip so that their shear is the same, and take the power pi R U^2 (1 + k)^2 sqrt(omega nu/2) m/2, m = rho rho_o/(rho +
rho_o), from an energy of pi R^2 U^2 (rho + k rho_o)/4. The amplitude decays with beta = sqrt(omega nu/2)/R (1 + k)^2
m/(rho + k rho_o) by that, and the frequency falls by the same beta, as in every Stokes layer. (That is the decay at
like densities; a hundred times apart, where the layers are weak, flow and wall decay it faster and leave the
frequency alone.) The swing is read from the second moments of the drop, 2 (Ixx - Iyy) / (Ixx + Iyy), and its frequency
and decay from the best fitting damped cosine.
"""
import dataclasses

import numpy as np
from scipy.optimize import curve_fit

from pipeline.study_kit.model import Curve, Figure, Outcome, Row, compared, observed_order
from pipeline.study_kit.tank import Run, TankParameters, advance, build, cavity, field
from sim.parameters import parameter
from sim.settings import Liquid

EFFECTS = ("viscosity", "interface_tension")
RADIUS, TENSION, DENSITY = 0.01, 0.04, 1000.0  # m, N/m, kg/m^3
CAVITY = 2.5  # b / R
AMPLITUDE = 0.05  # e
FIGURES = (
    Figure("oscillating_drop", "An oscillating drop, finest resolution", "time / period",
           "elongation / that of the start"),
)


@dataclasses.dataclass(frozen=True)
class Parameters(TankParameters):
    """A drop in another liquid; resolutions count particles along its radius."""

    density_ratio: float = parameter(1.0, minimum=0.01, maximum=100.0, meaning="density outside over that of the drop")
    ohnesorge: float = parameter(0.005, exclusive_minimum=0.0,
                                 meaning="nu sqrt(rho / (sigma R)), rho the larger density, of both liquids")
    periods: float = parameter(3.0, minimum=1.0, meaning="length of the run in periods")
    tolerance: float = parameter(0.03, exclusive_minimum=0.0, meaning="allowed relative error of the period")


def run(case: Parameters) -> Outcome:
    """Measure period and decay at every resolution."""
    outcome, errors = Outcome(), []
    expected = period(case)
    for resolution in case.resolutions:
        result = _swing(case, resolution)
        outcome.remarks += result.remarks(f"oscillating drop 1:{case.density_ratio:g}")
        found, decay = np.nan, np.nan
        if not result.failure:
            found, decay = fitted(result.history["time"], result.history["elongation"], expected)
        tolerance = case.tolerance if resolution == max(case.resolutions) else None
        row = compared("period", found, expected, tolerance, "s", at=result.label, wall_s=result.wall_s)
        errors.append(row.error)
        outcome.rows += [row, compared("decay rate of the amplitude (by the layers at the interface alone)", decay,
                                       layer_decay(case), None, "1/s", at=result.label), *result.rows()]
    outcome.rows.append(Row("observed order of the period",
                            observed_order([1.0 / resolution for resolution in case.resolutions], errors)))
    if not result.failure:
        time, swing = result.history["time"], result.history["elongation"]
        outcome.curves += [
            Curve("oscillating_drop", f"1:{case.density_ratio:g}", time / expected, swing / swing[0],
                  "line"),
            Curve("oscillating_drop", "without decay", time / expected, np.cos(2.0 * np.pi * time / expected),
                  "reference")]
    return outcome


def period(case: Parameters) -> float:
    """Period of a small oscillation, with the first-order effect of viscosity, s."""
    return 2.0 * np.pi / (_frequency_without_viscosity(case) - layer_decay(case))


def _frequency_without_viscosity(case: Parameters) -> float:
    """omega_0, 1/s."""
    drop, outside = _densities(case)
    return float(np.sqrt(6.0 * TENSION / ((drop + _added_mass() * outside) * RADIUS**3)))


def layer_decay(case: Parameters) -> float:
    """Decay rate of the amplitude by the layers at the interface, beta, 1/s."""
    drop, outside = _densities(case)
    shared = (1.0 + _added_mass()) ** 2 * drop * outside / (drop + outside) / (drop + _added_mass() * outside)
    return float(np.sqrt(0.5 * _frequency_without_viscosity(case) * _viscosity(case))) / RADIUS * shared


def _added_mass() -> float:
    """k, the mass that swings outside a drop over that inside at equal densities."""
    s = CAVITY**-4
    return (1.0 + s) / (1.0 - s)


def _densities(case: Parameters) -> tuple[float, float]:
    """Densities of the drop and of what is around it, kg/m^3; the larger one is that of water."""
    return DENSITY / max(1.0, case.density_ratio), DENSITY * min(1.0, case.density_ratio)


def fitted(time: np.ndarray, swing: np.ndarray, guess: float) -> tuple[float, float]:
    """Period, s, and decay rate, 1/s, of the best fitting damped cosine."""
    def damped(t, amplitude, omega, phase, rate, offset):
        return amplitude * np.exp(-rate * t) * np.cos(omega * t + phase) + offset

    best, _ = curve_fit(damped, time, swing, (swing[0], 2.0 * np.pi / guess, 0.0, 0.1 / guess, 0.0), maxfev=20000)
    return float(2.0 * np.pi / abs(best[1])), float(best[3])


def _viscosity(case: Parameters) -> float:
    """Kinematic viscosity of both liquids, m^2/s."""
    return case.ohnesorge * float(np.sqrt(TENSION * RADIUS / DENSITY))


def _swing(case: Parameters, resolution: int) -> Run:
    arrays = cavity("circle", CAVITY * RADIUS, RADIUS / resolution, start="packed", support_ratio=case.support_ratio)
    time = period(case)

    def inside(x: np.ndarray) -> np.ndarray:
        angle = np.arctan2(x[:, 1], x[:, 0])
        return np.linalg.norm(x, axis=1) < RADIUS * (1.0 + AMPLITUDE * np.cos(2.0 * angle) - 0.25 * AMPLITUDE**2)

    def watch(solver) -> dict[str, float]:
        drop = solver.particles.to_numpy("phase") == 1
        position, volume = field(solver, "position")[drop], field(solver, "volume")[drop]
        x, y = (position - volume @ position / volume.sum()).T ** 2 @ volume
        return {"elongation": float(2.0 * (x - y) / (x + y))}

    drop, outside = (Liquid(name, density, density * _viscosity(case))
                     for name, density in zip(("drop", "outside"), _densities(case), strict=True))
    solver = build(
        case, arrays, phase=inside, liquids=(outside, drop),
        effects={"interface_tension": {"coefficient": TENSION}, "viscosity": {"form": "laplacian"}},
        maximum_time_step=time / 100.0, minimum_time_step=1e-7 * time)
    return advance(solver, case.periods * time, f"R/dx={resolution}", watch)
