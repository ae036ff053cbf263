"""Two layers of liquid driven along a channel (two-phase Poiseuille flow).

A force density G along x in a channel that repeats itself, liquid 1 below and 2 above the middle, no slip at the walls
y = -H and H: u_k = G H^2/(2 mu_k) [2 mu_k/(mu_1 + mu_2) + (mu_1 - mu_2)/(mu_1 + mu_2) y/H - (y/H)^2]. The shear stress
is the same on both sides of the middle, so the gradient of the velocity jumps by the ratio of the viscosities: pair
forces have to find the stress between particles of unlike liquids. The flow is creeping, and so slow that particles
keep their places: what is measured is the viscous force itself on particles packed from disorder as in the eye, with
the noise that the pressure solve adds.
"""
import dataclasses
from typing import Any

import numpy as np

from pipeline.studies.family import Family, Headline
from pipeline.studies.model import Curve, Figure, Outcome, Row, bounded, observed_order
from sim.parameters import parameter
from sim.settings import Liquid
from studies.validation.kit.tank import PackedParameters, Run, advance, build, cavity, field

HALF_WIDTH = 1.0  # m, H
DENSITY = 1000.0  # kg/m^3
THIN = 1.0  # Pa s, mu_2
PERIOD = 12  # length of the channel in particle spacings, in three dimensions its width too
TRAVEL = 0.1  # way of the fastest liquid in the whole run, in particle spacings
FIGURES = (
    Figure("channel_profile", "Velocity of two layers in a channel, finest resolution", "velocity / largest",
           "y / H"),
    Figure("channel_error", "Error of the velocity of two layers", "particle spacing / H", "relative L2 error",
           logarithmic=True),
)


@dataclasses.dataclass(frozen=True)
class Parameters(PackedParameters):
    """A viscous layer below a thin one; resolutions count particles across one layer."""


    dimension: int = parameter(2, choices=(2, 3), meaning="a channel, or two plates")
    ratio: float = parameter(1.0, minimum=1.0, meaning="viscosity of the lower liquid over that of the upper one")
    viscosity: str = parameter("implicit", choices=("implicit", "explicit"), meaning="time integration of the forces")
    form: str = parameter("central", choices=("central", "laplacian", "strain"), meaning="form of the viscous forces")
    start: str = parameter("packed", choices=("regular", "packed", "disordered"),
                           meaning="lattice, packed from some disorder, or from so much that no lattice is left")
    times: float = parameter(4.0, exclusive_minimum=0.0, meaning="length of the run in rho H^2 / mu of the thin liquid")
    steps: int = parameter(40, minimum=4, meaning="smallest number of time steps in that time")
    tolerance: float = parameter(0.03, exclusive_minimum=0.0,
                                 meaning="allowed relative L2 error of the velocity at the finest resolution")


def run(case: Parameters) -> Outcome:
    """Measure the error of the velocity at every resolution, in both layers and in each, and its order."""
    outcome, errors = Outcome(), []
    name = (f"1:{case.ratio:g} {case.form}" + (" explicit" if case.viscosity == "explicit" else "")
            + (" 3D" if case.dimension == 3 else ""))
    for resolution in case.resolutions:
        result = _flow(case, resolution)
        finest = resolution == max(case.resolutions)
        layers = _layer_errors(result, case.ratio)
        errors.append(layers["both layers"])
        common: dict[str, Any] = {"at": result.label, "wall_s": result.wall_s}
        outcome.rows += [bounded(f"L2 error of the velocity, {layer}", error,
                                 case.tolerance if finest and layer == "both layers" else None, **common)
                         for layer, error in layers.items()]
        outcome.rows += [bounded("change of the velocity in the last tenth", _late_change(result), 1e-3, **common),
                         Row("viscosity iterations per step", float(result.values("iterations").mean()), **common),
                         *result.rows()]
        outcome.remarks += result.remarks(name)
    spacings = [HALF_WIDTH / resolution for resolution in case.resolutions]
    outcome.rows.append(Row("observed order of the velocity", observed_order(spacings, errors)))
    outcome.curves.append(Curve("channel_error", name, spacings, errors))
    if not result.failure:
        outcome.curves += _profiles(result, case.ratio, name)
    return outcome


def exact_velocity(ratio: float, height: np.ndarray) -> np.ndarray:
    """Velocity along the channel in G H^2 / mu_2 at heights y/H, with mu_1 = ratio mu_2 below the middle."""
    own = np.where(height < 0.0, ratio, 1.0)
    return (2.0 * own / (ratio + 1.0) + (ratio - 1.0) / (ratio + 1.0) * height - height**2) / (2.0 * own)


def _flow(case: Parameters, resolution: int) -> Run:
    spacing = HALF_WIDTH / resolution
    size, periodic = (PERIOD * spacing, 2.0 * HALF_WIDTH, PERIOD * spacing), (0, 2)
    arrays = cavity("box", size[: case.dimension], spacing, start=case.start, support_ratio=case.support_ratio,
                    dimension=case.dimension, seed=case.seed, periodic=periodic[: case.dimension - 1])
    until = case.times * DENSITY * HALF_WIDTH**2 / THIN
    effects: dict[str, Any] = {"gravity": {"posture": "left_side", "magnitude": _acceleration(case, spacing, until)},
               "viscosity_implicit" if case.viscosity == "implicit" else "viscosity": {"form": case.form}}
    solver = build(case, arrays, effects=effects, phase=lambda x: x[:, 1] > 0.0,
                   liquids=(Liquid("viscous", DENSITY, case.ratio * THIN), Liquid("thin", DENSITY, THIN)),
                   viscosity_tolerance=1e-6, maximum_iterations=2000, maximum_time_step=until / case.steps,
                   minimum_time_step=1e-9 * until)
    return _settled(advance(solver, until, f"n={resolution}", _watch), case, spacing)


def _settled(result: Run, case: Parameters, spacing: float) -> Run:
    """The run with ever smaller time steps at its end, down to dx^2 rho / mu of the viscous liquid.

    The pressure solve follows the viscous one. It turns what the thin liquid's disorder leaves of divergence into
    velocities of both liquids, which in steps beyond that of the viscous liquid no friction sees before the next step.
    """
    step, smallest = result.until / case.steps, DENSITY * spacing**2 / (case.ratio * THIN)
    if case.viscosity == "explicit" or result.failure:
        return result
    while step > smallest:
        step = max(0.5 * step, smallest)
        result.solver.step(step)
    return result


def _acceleration(case: Parameters, spacing: float, until: float) -> float:
    """Acceleration G/rho, m/s^2, at which the fastest liquid moves by `TRAVEL` spacings in the whole run."""
    largest = exact_velocity(case.ratio, np.linspace(-1.0, 1.0, 201)).max()
    return TRAVEL * spacing / until / (largest * HALF_WIDTH**2 * DENSITY / THIN)


def _watch(solver) -> dict[str, float]:
    along = field(solver, "velocity")[:, 0]
    return {"speed": float(np.sqrt((along**2).mean())),
            "iterations": solver.statistics.get("viscosity_iterations", 0.0)}


def _layer_errors(result: Run, ratio: float) -> dict[str, float]:
    """L2 error of the velocity over that of the exact one, in both layers and in each."""
    velocity, exact, lower = _velocities(result, ratio)
    if result.failure:
        velocity = np.full_like(velocity, np.nan)
    error = velocity.copy()
    error[:, 0] -= exact
    chosen = {"both layers": np.full(len(exact), True), "viscous layer": lower, "thin layer": ~lower}
    return {layer: float(np.sqrt((error[part] ** 2).sum() / (exact[part] ** 2).sum()))
            for layer, part in chosen.items()}


def _velocities(result: Run, ratio: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Velocities, (n, D), and what they should be along the channel, (n,), m/s; and which belong to the lower layer."""
    solver = result.solver
    gravity = next(effect for effect in solver.effects if effect.name == "gravity")
    scale = DENSITY * gravity.parameters.magnitude * HALF_WIDTH**2 / THIN
    lower = solver.particles.to_numpy("phase") == 0
    # A particle of the lower layer may sit a little above the middle, where the other branch of the profile begins.
    height = field(solver, "position")[:, 1] / HALF_WIDTH
    height = np.where(lower, np.minimum(height, -1e-12), np.maximum(height, 0.0))
    return field(solver, "velocity"), scale * exact_velocity(ratio, height), lower


def _late_change(result: Run) -> float:
    """Change of the root mean square velocity in the last tenth of the run, over the last one."""
    time, speed = result.values("time"), result.values("speed")
    return float((speed[-1] - np.interp(0.9 * time[-1], time, speed)) / speed[-1])


def _profiles(result: Run, ratio: float, name: str) -> list[Curve]:
    """Measured and exact profile, both over the largest exact velocity."""
    velocity, exact, _ = _velocities(result, ratio)
    height = field(result.solver, "position")[:, 1] / HALF_WIDTH
    axis = np.linspace(-1.0, 1.0, 201)
    profile = exact_velocity(ratio, axis)
    return [Curve("channel_profile", name, velocity[:, 0] / exact.max(), height),
            Curve("channel_profile", f"exact 1:{ratio:g}", profile / profile.max(), axis, "reference")]


FAMILY = Family(__name__, Parameters, run, effects=("gravity", "viscosity", "viscosity_implicit"),
                unnamed=("times", "steps"), figures=FIGURES,
                headline=Headline("L2 error of the velocity, both layers", 0.5, shown_by=("viscosity_implicit",)))
