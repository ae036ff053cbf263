"""A small drop rises slowly through another liquid.

Hadamard and Rybczynski's drop of radius a, in the middle of a spherical cavity of radius R instead of an infinite
liquid (after Haberman & Sayre 1958): both flows solve the equations of Stokes, u_r = f(r) cos(theta) with

    f = A + B r^2 inside,   f = E + F r^2 + D/r + C/r^3 outside,

and the six numbers follow from f = U on both sides of the drop's surface, equal tangential velocity and shear stress
there, and no slip at the wall. The force on the drop is 4 pi mu_o D, its buoyancy (4/3) pi a^3 drho g.

Tension keeps the drop round (Bond number 0.1) and viscosity keeps it slow (Reynolds number 0.1), so that it takes this
speed long before it has moved by a tenth of its radius.
"""
import dataclasses
from typing import Any

import numpy as np

from pipeline.studies.family import Family
from pipeline.studies.model import Curve, Figure, Outcome, Row, bounded, compared, observed_order
from sim.parameters import parameter
from sim.settings import Liquid
from studies.validation.kit.tank import Run, TankParameters, advance, build, cavity, field

RADIUS = 1e-3  # m, a
DENSITY = 1000.0  # kg/m^3
LIGHTER = 35.0  # kg/m^3, drho
GRAVITY = 9.81  # m/s^2
BOND, REYNOLDS = 0.1, 0.1  # drho g a^2 / sigma and rho U a / mu_o, U as in an infinite liquid
FIGURES = (
    Figure("creeping_drop", "Speed of a rising drop", "way / radius", "speed / exact"),
)


@dataclasses.dataclass(frozen=True)
class Parameters(TankParameters):
    """A light drop in the middle of a sphere of another liquid."""

    support_ratio: float = parameter(2.5, minimum=2.0, maximum=4.0,
                                     meaning="support radius of the kernel in particle spacings")
    viscosity_ratio: float = parameter(1.0, exclusive_minimum=0.0, meaning="viscosity of the drop over that around it")
    form: str = parameter("central", choices=("central", "laplacian", "strain"), meaning="form of the viscous forces")
    cavity_ratio: float = parameter(3.0, minimum=1.5, meaning="radius of the cavity over that of the drop")
    way: float = parameter(0.1, exclusive_minimum=0.0, maximum=0.5, meaning="length of the run in radii of the drop")
    tolerance: float = parameter(0.1, exclusive_minimum=0.0, meaning="allowed relative error of the speed at the "
                                                                     "finest resolution")
    resolutions: tuple[int, ...] = parameter((4, 6), minimum=3, meaning="particles along the radius of the drop")


def run(case: Parameters) -> Outcome:
    """Measure the speed of the drop over the second half of its way, at every resolution."""
    outcome, errors = Outcome(), []
    name = f"1:{case.viscosity_ratio:g} {case.form}"
    for resolution in case.resolutions:
        result = rise(case, resolution)
        exact = exact_speed(case.viscosity_ratio, case.cavity_ratio) * _scale(case)
        way, speed = result.values("way"), result.values("speed")
        late = way > 0.5 * way[-1]
        mean = float(speed[late].mean()) if not result.failure else np.nan
        errors.append(abs(mean / exact - 1.0))
        common: dict[str, Any] = {"at": result.label, "wall_s": result.wall_s}
        outcome.rows += [
            compared("speed of the drop", mean, exact, case.tolerance if resolution == max(case.resolutions) else None,
                     "m/s", **common),
            Row("change of the speed over that time", float(speed[-1] / speed[late][0] - 1.0), **common),
            bounded("sideways speed / speed", float(result.values("sideways")[-1]) / exact, 0.1, **common),
            *result.rows()]
        outcome.remarks += result.remarks(name)
        if not result.failure:
            shown = slice(1, None, max(1, len(way) // 300))
            outcome.curves.append(Curve("creeping_drop", f"{name} {result.label}", way[shown] / RADIUS,
                                        speed[shown] / exact, "line"))
    outcome.rows.append(Row("observed order of the speed", observed_order(
        [1.0 / resolution for resolution in case.resolutions], errors)))
    return outcome


def exact_speed(viscosity_ratio: float, cavity_ratio: float) -> float:
    """Speed of the drop in drho g a^2 / mu_o; without end 2/3 (1 + k) / (2 + 3 k) with the viscosity ratio k."""
    k, wall = viscosity_ratio, cavity_ratio
    # In units of a; the balance with the buoyancy gives D = 1/3, and A, B, E, F, C and U are unknown. For f = r^n the
    # tangential velocity is -g sin(theta) with g = f + r f'/2, the shear stress -mu (r (g/r)' + f/r) sin(theta).
    drag = 1.0 / 3.0
    tangential = {n: 1.0 + 0.5 * n for n in (0, 2, -1, -3)}
    stress = {n: -(g * (n - 1.0) + 1.0) for n, g in tangential.items()}
    inner, outer = (0, 2), (0, 2, -3)
    rows = [
        [1.0, 1.0, 0.0, 0.0, 0.0, -1.0, 0.0],
        [0.0, 0.0, 1.0, 1.0, 1.0, -1.0, -drag],
        [*(tangential[n] for n in inner), *(-tangential[n] for n in outer), 0.0, drag * tangential[-1]],
        [*(k * stress[n] for n in inner), *(-stress[n] for n in outer), 0.0, drag * stress[-1]],
        [0.0, 0.0, *(wall**n for n in outer), 0.0, -drag / wall],
        [0.0, 0.0, *(tangential[n] * wall**n for n in outer), 0.0, -drag * tangential[-1] / wall],
    ]
    table = np.array(rows)
    return float(np.linalg.solve(table[:, :6], table[:, 6])[5])


def rise(case: Parameters, resolution: int) -> Run:
    """Let the drop rise by its way."""
    spacing = RADIUS / resolution
    arrays = cavity("circle", case.cavity_ratio * RADIUS, spacing, start="packed", support_ratio=case.support_ratio,
                    dimension=3)
    viscosity = _viscosity(case)
    solver = build(case, arrays, phase=lambda x: np.linalg.norm(x, axis=1) < RADIUS,
                   liquids=(Liquid("around", DENSITY, viscosity),
                            Liquid("drop", DENSITY - LIGHTER, case.viscosity_ratio * viscosity)),
                   effects={"gravity": {"magnitude": GRAVITY}, "viscosity_implicit": {"form": case.form},
                            "interface_tension": {"coefficient": LIGHTER * GRAVITY * RADIUS**2 / BOND}},
                   viscosity_tolerance=1e-5, maximum_iterations=1000,
                   maximum_time_step=case.largest_step * np.sqrt(spacing / GRAVITY))
    inside = solver.particles.to_numpy("phase") == 1
    start = float(_axis(field(solver, "position")[inside]).mean())

    def watch(solver) -> dict[str, float]:
        drop = solver.particles.to_numpy("phase") == 1
        velocity = field(solver, "velocity")[drop].mean(axis=0)
        along = float(_axis(velocity))
        return {"way": float(_axis(field(solver, "position")[drop]).mean()) - start, "speed": along,
                "sideways": float(np.sqrt(max((velocity**2).sum() - along**2, 0.0)))}

    speed = exact_speed(case.viscosity_ratio, case.cavity_ratio) * _scale(case)
    return advance(solver, case.way * RADIUS / speed, f"a/dx={resolution}", watch)


def _axis(vectors: np.ndarray) -> np.ndarray:
    """Component upwards, the patient sitting: y."""
    return vectors[..., 1]


def _viscosity(case: Parameters) -> float:
    """Viscosity of the outer liquid, Pa s, that gives the Reynolds number."""
    free = 2.0 / 3.0 * (1.0 + case.viscosity_ratio) / (2.0 + 3.0 * case.viscosity_ratio)
    return np.sqrt(free * DENSITY * LIGHTER * GRAVITY * RADIUS**3 / REYNOLDS)


def _scale(case: Parameters) -> float:
    """drho g a^2 / mu_o, m/s."""
    return LIGHTER * GRAVITY * RADIUS**2 / _viscosity(case)


FAMILY = Family(__name__, Parameters, run, effects=("gravity", "viscosity_implicit", "interface_tension"),
                figures=FIGURES)
