"""The slip of droplets under weight and drag, of an even mixture at rest, for any time step.

u(t) = tau (1 - rho/rho_k) g (1 - exp(-t/tau)). Where tau is far beyond the time, u grows linearly: what [song,
eq. 12] gives for ever. The algebraic form is the limit for t/tau -> infinity.
"""
import dataclasses
import time

import numpy as np

from pipeline.studies.family import Family
from pipeline.studies.model import Curve, Figure, Outcome, compared
from sim.effects.drift import response_time
from sim.parameters import parameter
from sim.settings import Liquid
from studies.validation.diffusion import set_fractions
from studies.validation.kit.tank import TankParameters, build, cavity, field

GRAVITY = 9.81  # m/s^2
LIQUIDS = (Liquid("water", 1000.0, 1e-3), Liquid("oil", 963.0, 1.0))
FRACTION = 0.1  # of the second liquid
DIAMETER = 1e-3  # m
TINY = 1e-12  # factor of the transport, so that the mixture stays even
NO_DRAG = 1e-4  # t/tau that counts as without drag
FIGURES = (Figure("drift_drag", "Slip with drag, dynamic form", "t / tau", "slip / slip in equilibrium"),)


@dataclasses.dataclass(frozen=True)
class Parameters(TankParameters):
    """Steps of any length over the response time."""

    steps_over_tau: tuple[float, ...] = parameter((1e-3, 0.1, 1.0, 10.0, 1e3), exclusive_minimum=0.0,
                                                  meaning="lengths of the time step, over tau")
    tolerance: float = parameter(1e-9, exclusive_minimum=0.0, meaning="allowed relative error of the slip")


def run(case: Parameters) -> Outcome:
    """Compare the slip of both liquids with the exact one after one and after ten steps of every length."""
    outcome = Outcome()
    solver = _mixture(case, "dynamic")
    times = [time_of(k) for k in range(2)]
    curve = [[], []]
    for ratio in case.steps_over_tau:
        begin = time.perf_counter()
        worst = 0.0
        for k in range(2):
            solver.particles.arrays["droplet_velocity"].fill(0.0)
            for step in range(1, 11):
                _drift(solver).prepare(ratio * times[k])
                found = velocity(solver, k) / equilibrium(k)
                worst = max(worst, abs(found / -np.expm1(-step * ratio) - 1.0))
                if k == 1 and step * ratio < 20.0:
                    curve[0].append(step * ratio)
                    curve[1].append(found)
        outcome.rows.append(compared("slip after 1 to 10 steps / exact, worst", 1.0 + worst, 1.0, case.tolerance,
                                     at=f"dt/tau={ratio:g}", wall_s=time.perf_counter() - begin))
    solver.particles.arrays["droplet_velocity"].fill(0.0)
    _drift(solver).prepare(NO_DRAG * times[1])
    outcome.rows.append(compared("slip without drag / (1 - rho/rho_k) g t", velocity(solver, 1) / (
        acceleration(1) * NO_DRAG * times[1]), 1.0, NO_DRAG, at=f"t/tau={NO_DRAG:g}"))
    algebraic = _mixture(case, "algebraic")
    _drift(algebraic).prepare(1e-6 * times[1])
    outcome.rows.append(compared("slip in the algebraic form / limit", velocity(algebraic, 1) / equilibrium(1), 1.0,
                                 case.tolerance))
    order, smooth = np.argsort(curve[0]), np.linspace(0.0, 10.0, 101)
    outcome.curves += [
        Curve("drift_drag", "steps of any length", np.array(curve[0])[order], np.array(curve[1])[order]),
        Curve("drift_drag", "exact", smooth, -np.expm1(-smooth), "reference")]
    return outcome


def time_of(k: int) -> float:
    """tau_k of droplets in the other liquid, s."""
    return response_time(LIQUIDS[k], LIQUIDS[1 - k], DIAMETER)


def acceleration(k: int) -> float:
    """(1 - rho/rho_k) g of liquid k upwards, m/s^2."""
    density = FRACTION * LIQUIDS[1].density + (1.0 - FRACTION) * LIQUIDS[0].density
    return -(1.0 - density / LIQUIDS[k].density) * GRAVITY


def equilibrium(k: int) -> float:
    """u_k in local equilibrium, upwards, m/s."""
    return time_of(k) * acceleration(k)


def velocity(solver, k: int) -> float:
    """Mean of u_k upwards, m/s."""
    return float(field(solver, "droplet_velocity")[:, 2 * k + 1].mean())


def _drift(solver):
    return next(effect for effect in solver.effects if effect.name == "drift")


def _mixture(case: Parameters, form: str):
    arrays = cavity("box", (0.1, 0.1), 0.1 / min(case.resolutions), support_ratio=case.support_ratio)
    solver = build(case, arrays, liquids=LIQUIDS, effects={
        "gravity": {"magnitude": GRAVITY},
        "drift": {"droplet_diameter": DIAMETER, "form": form, "coefficient": TINY}})
    even = np.full(solver.count[None], FRACTION)
    set_fractions(solver, np.stack([1.0 - even, even], axis=1))
    return solver


FAMILY = Family(__name__, Parameters, run, effects=("drift", "gravity"), figures=FIGURES)
