"""A wave on the interface of two liquids of one viscosity, from rest to flat: Prosperetti's solution (1981).

Half a wave between two walls that hold nothing, contact angle 90 degrees: no contact line resists, so that tension,
viscosity and pressure answer alone. With k = pi/width, nu of both liquids, omega_0^2 = sigma k^3/(rho_1 + rho_2) and
beta = rho_1 rho_2/(rho_1 + rho_2)^2 an amplitude a is

    a(t)/a(0) = 4 (1 - 4 beta) (nu k^2)^2/(8 (1 - 4 beta) (nu k^2)^2 + omega_0^2) erfc sqrt(nu k^2 t)
                + sum over i of (z_i/Z_i) omega_0^2/(z_i^2 - nu k^2) exp((z_i^2 - nu k^2) t) erfc(z_i sqrt t)

with the four roots z of z^4 - 4 beta sqrt(nu k^2) z^3 + 2 (1 - 6 beta) nu k^2 z^2 + 4 (1 - 3 beta) (nu k^2)^1.5 z
+ (1 - 4 beta) (nu k^2)^2 + omega_0^2, and Z_1 = (z_2 - z_1)(z_3 - z_1)(z_4 - z_1). The Laplace number
sigma wavelength/(rho nu^2) is 3000 in Popinet's test (2009), where the wave swings, and 1 for a wave of an inch in
silicone oil of 1 Pa s, where it creeps. The layers are as deep as half a wave: omega_0^2 is less by tanh(k depth).
"""
import dataclasses

import numpy as np
from scipy.special import erfc, wofz

from pipeline.studies.family import Family
from pipeline.studies.model import Curve, Figure, Outcome, Row, bounded, observed_order
from sim.parameters import parameter
from sim.settings import Liquid
from studies.validation.kit.tank import PackedParameters, Run, advance, build, cavity, field

WIDTH, TENSION, DENSITY = 0.0128, 0.04, 1000.0  # m, half a wave; N/m; kg/m^3
AMPLITUDE = 0.06  # of the width
TIMES = 25.0  # length of the run in 1/omega_0, as Popinet's
FIGURES = (Figure("capillary_wave", "A capillary wave, finest resolution", "time x omega_0", "amplitude / its first"),)


@dataclasses.dataclass(frozen=True)
class Parameters(PackedParameters):
    """A wave between two liquids; resolutions count particles along half of it."""

    laplace: float = parameter(1.0, exclusive_minimum=0.0, meaning="sigma wavelength / (rho nu^2) of both liquids")
    form: str = parameter("central", choices=("central", "laplacian", "strain"), meaning="form of viscosity")
    resolutions: tuple[int, ...] = parameter((16, 32, 64), minimum=8, meaning="particles along half a wave")
    largest_step: float = parameter(0.2, exclusive_minimum=0.0, meaning="largest time step in 1 / omega_0")
    tolerance: float = parameter(0.03, exclusive_minimum=0.0,
                                 meaning="allowed root mean square error over the first amplitude")


def run(case: Parameters) -> Outcome:
    """Compare the amplitude with Prosperetti's at every resolution."""
    outcome, errors = Outcome(), []
    for resolution in case.resolutions:
        result = _decay(case, resolution)
        outcome.remarks += result.remarks(f"capillary wave La {case.laplace:g}")
        time, found = result.values("time"), result.values("amplitude")
        error = float(np.sqrt(np.mean((found / found[0] - expected(case, time)) ** 2)))
        tolerance = case.tolerance if resolution == max(case.resolutions) else None
        errors.append(error)
        outcome.rows += [bounded("error of the amplitude (root mean square) / the first", error, tolerance,
                                 at=result.label, wall_s=result.wall_s), *result.rows()]
    outcome.rows.append(Row("observed order of the amplitude",
                            observed_order([1.0 / resolution for resolution in case.resolutions], errors)))
    if not result.failure:
        name, scaled = f"La {case.laplace:g}", time * frequency()
        outcome.curves += [Curve("capillary_wave", f"{name}, h/dx {case.support_ratio:g}", scaled, found / found[0],
                                 "line"),
                           Curve("capillary_wave", f"{name}, Prosperetti", scaled, expected(case, time), "reference")]
    return outcome


def frequency() -> float:
    """omega_0, 1/s."""
    k = np.pi / WIDTH
    return float(np.sqrt(TENSION * k**3 * np.tanh(k * WIDTH) / (2.0 * DENSITY)))


def kinematic_viscosity(case: Parameters) -> float:
    """Return nu of both liquids, m^2/s."""
    return float(np.sqrt(TENSION * 2.0 * WIDTH / (DENSITY * case.laplace)))


def expected(case: Parameters, time: np.ndarray) -> np.ndarray:
    """Amplitude over that at the start, at times, (n,), s."""
    return prosperetti(time, kinematic_viscosity(case) * (np.pi / WIDTH) ** 2, frequency(), 0.25)


def prosperetti(time: np.ndarray, damping: float, omega: float, beta: float) -> np.ndarray:
    """Amplitude over that at the start, (n,), of a wave that starts at rest.

    Parameters
    ----------
    time : (n,), s. damping : nu k^2, 1/s. omega : omega_0, 1/s. beta : rho_1 rho_2/(rho_1 + rho_2)^2.
    """
    root, rest = np.sqrt(damping), 1.0 - 4.0 * beta
    z = np.roots([1.0, -4.0 * beta * root, 2.0 * (1.0 - 6.0 * beta) * damping, 4.0 * (1.0 - 3.0 * beta) * root**3,
                  rest * damping**2 + omega**2])
    total = 4.0 * rest * damping**2 / (8.0 * rest * damping**2 + omega**2) * erfc(np.sqrt(damping * time)) + 0j
    for i in range(4):
        others = np.prod(np.delete(z, i) - z[i])
        # exp(z^2 t) erfc(z sqrt t) is Faddeeva's w(i z sqrt t), which does not overflow on this side of the plane; on
        # the other one erfc(z) is 2 - erfc(-z).
        side = 1.0 if z[i].real >= 0.0 else -1.0
        fading = side * np.exp(-damping * time) * wofz(1j * side * z[i] * np.sqrt(time))
        if side < 0.0:
            fading += 2.0 * np.exp((z[i] ** 2 - damping) * time)
        total += z[i] / others * omega**2 / (z[i] ** 2 - damping) * fading
    return total.real


def _decay(case: Parameters, resolution: int) -> Run:
    arrays = cavity("box", (WIDTH, 2.0 * WIDTH), WIDTH / resolution, start="packed", support_ratio=case.support_ratio,
                    seed=case.seed)
    mode = np.pi / WIDTH

    def upper(x: np.ndarray) -> np.ndarray:
        return x[:, 1] > AMPLITUDE * WIDTH * np.cos(mode * (x[:, 0] + 0.5 * WIDTH))

    def watch(solver) -> dict[str, float]:
        position, volume = field(solver, "position"), field(solver, "volume")
        of_upper = solver.particles.to_numpy("phase") == 1
        wave = np.cos(mode * (position[of_upper, 0] + 0.5 * WIDTH))
        return {"amplitude": float(-2.0 / WIDTH * volume[of_upper] @ wave)}

    viscosity = DENSITY * kinematic_viscosity(case)
    solver = build(case, arrays, phase=upper, liquids=tuple(Liquid(name, DENSITY, viscosity)
                                                           for name in ("lower", "upper")),
                   effects={"interface_tension": {"coefficient": TENSION, "contact_angle": 0.5 * np.pi},
                            "viscosity_implicit": {"wall": "free_slip", "form": case.form}},
                   maximum_time_step=case.largest_step / frequency())
    return advance(solver, TIMES / frequency(), f"n={resolution}", watch)


FAMILY = Family(__name__, Parameters, run, effects=("viscosity_implicit", "interface_tension"), figures=FIGURES)
