"""A drop that is a little longer than wide oscillates (Lamb 1932, in two dimensions and between walls).

A drop of radius R and density rho in the middle of a round cavity of radius b, without gravity, in a liquid of density
rho_o and the same kinematic viscosity nu. Its shape R (1 + e cos 2 theta) swings with period and decay of the normal
mode of both viscous liquids: on either side a potential flow, r^2 and r^-2, and one with vorticity, I_2(q r) and
K_2(q r) with q^2 = s/nu for a time dependence exp(s t), such that at the interface velocities and shear are the same
and the normal stress jumps by tension times curvature, and both velocities are zero at the wall. The determinant of
these six conditions is zero at s.

Without viscosity omega_0^2 = 6 sigma / ((rho + k rho_o) R^3), k = (1 + w)/(1 - w), w = (R/b)^4: the liquid between
drop and wall adds more mass than that around a lone drop (w = 0). From there the root is sought. The swing is read from
the second moments of the drop, 2 (Ixx - Iyy) / (Ixx + Iyy), and its frequency and decay from the best fitting damped
cosine.
"""
import dataclasses

import numpy as np
from scipy.optimize import curve_fit
from scipy.special import ive, kve

from pipeline.studies.family import Family
from pipeline.studies.model import Curve, Figure, Outcome, Row, compared, observed_order
from sim.parameters import parameter
from sim.settings import Liquid
from studies.validation.kit.tank import Run, TankParameters, advance, build, cavity, field

RADIUS, TENSION, DENSITY = 0.01, 0.04, 1000.0  # m, N/m, kg/m^3
CAVITY = 2.5  # b / R
AMPLITUDE = 0.05  # e
MODE = 2  # lobes of the shape
FIGURES = (
    Figure("oscillating_drop", "An oscillating drop, finest resolution", "time / period",
           "elongation / that of the start"),
)


@dataclasses.dataclass(frozen=True)
class Parameters(TankParameters):
    """A drop in another liquid; resolutions count particles along its radius."""

    density_ratio: float = parameter(1.0, minimum=0.01, maximum=100.0, meaning="density outside over that of the drop")
    ohnesorge: float = parameter(0.005, minimum=1e-4,
                                 meaning="nu sqrt(rho / (sigma R)), rho the larger density, of both liquids")
    periods: float = parameter(3.0, minimum=1.0, meaning="length of the run in periods")
    tolerance: float = parameter(0.03, exclusive_minimum=0.0, meaning="allowed relative error of the period")
    decay_tolerance: float = parameter(0.05, exclusive_minimum=0.0, meaning="allowed relative error of the decay")


def run(case: Parameters) -> Outcome:
    """Measure period and decay at every resolution."""
    outcome, errors = Outcome(), []
    expected, expected_decay = normal_mode(case)
    for resolution in case.resolutions:
        result = _swing(case, resolution)
        outcome.remarks += result.remarks(f"oscillating drop 1:{case.density_ratio:g}")
        found, decay = np.nan, np.nan
        if not result.failure:
            found, decay = fitted(result.history["time"], result.history["elongation"], expected)
        finest = resolution == max(case.resolutions)
        row = compared("period", found, expected, case.tolerance if finest else None, "s", at=result.label,
                       wall_s=result.wall_s)
        errors.append(row.error)
        outcome.rows += [row, compared("decay rate of the amplitude", decay, expected_decay,
                                       case.decay_tolerance if finest else None, "1/s", at=result.label),
                         *result.rows()]
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


def normal_mode(case: Parameters) -> tuple[float, float]:
    """Period, s, and decay rate of the amplitude, 1/s, of a small oscillation of two viscous liquids.

    The root of the determinant of `_conditions` that the secant method finds from the oscillation without viscosity.
    """
    def determinant(s: complex) -> complex:
        return np.linalg.det(_conditions(case, s) / scale)

    before = complex(-0.01, 1.0) * _frequency_without_viscosity(case)
    scale = np.abs(_conditions(case, before)).max(axis=0)  # the same for all s: the secant method needs it smooth
    s = before * (1.0 + 1e-4)
    last = determinant(before)
    for _ in range(100):
        value = determinant(s)
        step = value * (s - before) / (value - last)
        before, last, s = s, value, s - step
        if abs(step) < 1e-10 * abs(s):
            return float(2.0 * np.pi / s.imag), float(-s.real)
    raise ArithmeticError(f"no normal mode of a drop was found for {case}")


def _frequency_without_viscosity(case: Parameters) -> float:
    """omega_0, 1/s."""
    drop, outside = _densities(case)
    return float(np.sqrt(6.0 * TENSION / ((drop + _added_mass() * outside) * RADIUS**3)))


def _conditions(case: Parameters, s: complex) -> np.ndarray:
    """What the six flows add to the conditions of a mode, (6, 6): velocities along and across the interface, shear,
    normal stress, velocities at the wall.

    A flow has the stream function f(r) exp(s t + 2i theta), so that u_r = 2i f/r, u_theta = -f', and a pressure where
    it is that of a potential.
    """
    n, wall = MODE, CAVITY * RADIUS
    density = _densities(case)
    viscosity = [rho * _viscosity(case) for rho in density]
    q = np.sqrt(s / _viscosity(case))  # of the right half of the plane

    def growing(r: float, to: float) -> tuple[complex, complex, complex]:
        scale = np.exp(q.real * r - q * to)  # `ive` is without exp(Re q r)
        f, lower = ive(n, q * r) * scale, ive(n - 1, q * r) * scale
        slope = q * lower - n / r * f
        return f, slope, (q * q + (n / r) ** 2) * f - slope / r

    def falling(r: float) -> tuple[complex, complex, complex]:
        scale = np.exp(-q * (r - RADIUS))
        f, lower = kve(n, q * r) * scale, kve(n - 1, q * r) * scale
        slope = -q * lower - n / r * f
        return f, slope, (q * q + (n / r) ** 2) * f - slope / r

    def power(r: float, to: float, exponent: int) -> tuple[complex, complex, complex]:
        f = (r / to) ** exponent
        return f, exponent / r * f, exponent * (exponent - 1) / r**2 * f

    def outside(r: float) -> list:
        return [power(r, wall, n), power(r, RADIUS, -n), growing(r, wall), falling(r)]

    conditions = np.zeros((6, 6), complex)
    # Liquid, its side, flow, and its potential over i f, which makes its pressure.
    flows = [(0, 1.0, power(RADIUS, RADIUS, n), 1.0), (0, 1.0, growing(RADIUS, RADIUS), 0.0)]
    potentials = 1.0, -1.0, 0.0, 0.0
    flows += [(1, -1.0, flow, potential) for flow, potential in zip(outside(RADIUS), potentials, strict=True)]
    for k, (liquid, side, (f, slope, curvature), potential) in enumerate(flows):
        pressure = -density[liquid] * s * 1j * potential * f
        conditions[0, k] = side * f
        conditions[1, k] = side * slope * RADIUS
        conditions[2, k] = side * viscosity[liquid] / viscosity[1] * (
            -curvature * RADIUS**2 + slope * RADIUS - n * n * f)
        normal = -pressure + 2.0 * viscosity[liquid] * 1j * n * (slope / RADIUS - f / RADIUS**2)
        conditions[3, k] = -side * normal
        if liquid == 0:  # the interface moves with the drop
            conditions[3, k] -= TENSION * (n * n - 1) / RADIUS**2 * 1j * n * f / RADIUS / s
    conditions[3] /= max(density) * _frequency_without_viscosity(case)
    for k, (f, slope, _) in enumerate(outside(wall)):
        conditions[4, 2 + k], conditions[5, 2 + k] = f, slope * wall
    return conditions


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
    time, _ = normal_mode(case)

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
        effects={"interface_tension": {"coefficient": TENSION}, "viscosity_implicit": {}},
        maximum_time_step=time / 100.0, minimum_time_step=1e-7 * time)
    return advance(solver, case.periods * time, f"R/dx={resolution}", watch)


FAMILY = Family(__name__, Parameters, run, effects=("viscosity_implicit", "interface_tension"), figures=FIGURES)
