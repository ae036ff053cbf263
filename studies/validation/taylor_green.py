"""Decay of Taylor-Green vortices.

u = U sin kx cos ky, v = -U cos kx sin ky in a square that repeats itself after L = 2 pi/k along both axes. The
energy decays as exp(-4 nu k^2 t). Re = U L/nu. Two liquids that do not differ, mixed at random, have to flow as one.
(A box with free slip around one vortex would be the same flow, but the viscous forces of particles lack their other
half at such a wall, and that error hides the one of the pressure solve.)
"""
import dataclasses

import numpy as np

from pipeline.studies.family import Family, Headline
from pipeline.studies.model import Curve, Figure, Outcome, Row, bounded, compared, observed_order
from sim.parameters import parameter
from sim.settings import Liquid
from studies.validation.kit.tank import PackedParameters, Run, advance, build, cavity, field, motion

PERIOD = 1.0  # m, L = 2 pi / k
SPEED = 1.0  # m/s, U
DENSITY = 1000.0  # kg/m^3
FIGURES = (
    Figure("taylor_green_decay", "Energy of a Taylor-Green vortex, finest resolution", "4 nu k² t",
           "ln(kinetic energy / start)"),
    Figure("taylor_green_error", "Error of the decay rate", "particle spacing / period", "relative error",
           logarithmic=True),
)


@dataclasses.dataclass(frozen=True)
class Parameters(PackedParameters):
    """Four vortices in a periodic square; resolutions count particles along the period."""

    reynolds: float = parameter(100.0, exclusive_minimum=0.0, meaning="U L / nu")
    liquids: int = parameter(1, minimum=1, maximum=2, meaning="2: two equal liquids, mixed at random")
    start: str = parameter("packed", choices=("regular", "packed"), meaning="lattice, or packed from disorder")
    viscosity: str = parameter("laplacian", choices=("laplacian", "central", "implicit"),
                               meaning="form of the explicit viscosity, or the implicit one")
    decay: float = parameter(1.5, exclusive_minimum=0.0, meaning="length of the run in e-foldings of the energy")
    steps: int = parameter(200, minimum=10, meaning="smallest number of time steps per e-folding of the energy")
    tolerance: float = parameter(0.03, exclusive_minimum=0.0, meaning="allowed relative error of the decay rate")


def run(case: Parameters) -> Outcome:
    """Measure the decay rate at every resolution; with two liquids, the difference from one too."""
    outcome, errors = Outcome(), []
    name = f"{case.scheme} Re {case.reynolds:g}" + (" two liquids" if case.liquids == 2 else "")
    for resolution in case.resolutions:
        result = _decay(case, resolution, case.liquids)
        finest = resolution == max(case.resolutions)
        row = compared("decay rate of the energy", _measured_rate(result), decay_rate(case.reynolds),
                       case.tolerance if finest else None, "1/s", at=result.label, wall_s=result.wall_s)
        errors.append(row.error)
        outcome.rows += [row, *result.rows()]
        outcome.remarks += result.remarks(name)
        if case.liquids == 2:
            outcome.rows.append(_difference(case, resolution, result))
    spacings = [1.0 / resolution for resolution in case.resolutions]
    outcome.rows.append(Row("observed order of the decay rate", observed_order(spacings, errors)))
    outcome.curves.append(Curve("taylor_green_error", name, spacings, errors))
    if not result.failure:
        energy, scaled = result.history["kinetic_energy"], decay_rate(case.reynolds) * result.history["time"]
        outcome.curves += [Curve("taylor_green_decay", name, scaled, np.log(energy / energy[0]), "line"),
                           Curve("taylor_green_decay", "exact", [0.0, case.decay], [0.0, -case.decay], "reference")]
    return outcome


def decay_rate(reynolds: float) -> float:
    """Rate at which the energy decays, 4 nu k^2, 1/s."""
    return 4.0 * (SPEED * PERIOD / reynolds) * (2.0 * np.pi / PERIOD) ** 2


def vortex(position: np.ndarray) -> np.ndarray:
    """Velocity at positions, (n, 2), m/s."""
    x, y = (2.0 * np.pi / PERIOD * position).T
    return SPEED * np.stack([np.sin(x) * np.cos(y), -np.cos(x) * np.sin(y)], axis=1)


def _decay(case: Parameters, resolution: int, liquids: int) -> Run:
    arrays = cavity("box", (PERIOD, PERIOD), PERIOD / resolution, start=case.start, support_ratio=case.support_ratio,
                    seed=case.seed, periodic=(0, 1))
    viscosity = DENSITY * SPEED * PERIOD / case.reynolds
    effect = {"viscosity_implicit": {}} if case.viscosity == "implicit" else {"viscosity": {"form": case.viscosity}}
    alike = tuple(Liquid(f"liquid_{k}", DENSITY, viscosity) for k in range(liquids))
    rate = decay_rate(case.reynolds)
    solver = build(case, arrays, liquids=alike, effects=effect, velocity=vortex,
                   phase=lambda x: np.random.default_rng(1).integers(0, liquids, len(x)),
                   maximum_time_step=1.0 / (case.steps * rate), minimum_time_step=1e-8 / rate)
    return advance(solver, case.decay / rate, f"n={resolution}", motion)


def _measured_rate(result: Run) -> float:
    """Slope of the logarithm of the energy, without the first tenth, in which the start settles."""
    if result.failure:
        return np.nan
    time, energy = result.history["time"], result.history["kinetic_energy"]
    late = time > 0.1 * result.until
    return float(-np.polyfit(time[late], np.log(energy[late]), 1)[0])


def _difference(case: Parameters, resolution: int, result: Run) -> Row:
    """Largest difference of the velocities from a run with one liquid, over U."""
    one = _decay(case, resolution, 1)
    broken = result.failure or one.failure
    velocities = [field(run.solver, "velocity")[np.argsort(run.solver.particles.to_numpy("id"))]
                  for run in (one, result)]
    difference = np.nan if broken else float(np.abs(velocities[1] - velocities[0]).max() / SPEED)
    return bounded("largest difference from one liquid / U", difference, 1e-6, at=result.label, wall_s=one.wall_s)


FAMILY = Family(__name__, Parameters, run, effects=("viscosity", "viscosity_implicit"), figures=FIGURES,
                headline=Headline("decay rate of the energy", 1.0, shown_by=("viscosity",)))
