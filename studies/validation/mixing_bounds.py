"""Bounds and conservation of the exchange between particles over many steps, from a checkerboard or at random.

Three liquids, unequal volumes, disordered places and velocities: drift and diffusion act together on particles that do
not move. Nothing is clipped or normalized: the fractions have to stay in [0, 1] and add up to 1 by themselves, and
volumes, mass and momentum may change by round-off only, for any D dt/h^2.
"""
import dataclasses
import time
from typing import Any

import numpy as np

from pipeline.studies.family import Family
from pipeline.studies.model import Curve, Figure, Outcome, Row, bounded
from sim.parameters import parameter
from sim.settings import Liquid
from studies.validation.diffusion import set_fractions
from studies.validation.kit.tank import TankParameters, build, cavity, field

LENGTH = 0.1  # m, side of the box
LIQUIDS = (Liquid("water", 1000.0, 1e-3), Liquid("oil", 963.0, 1.0), Liquid("light", 500.0, 1e-2))
SLIP = 0.05  # largest way of the slip per step, about, in particle spacings
VOLUMES = (0.7, 1.3)  # of the particles, in spacing^2
RECORDS = 200  # points of the curve
FIGURES = (Figure("mixing_bounds", "Conservation of the exchange in double precision", "step",
                  "largest relative change of volume, mass or momentum", logarithmic=True),)


@dataclasses.dataclass(frozen=True)
class Parameters(TankParameters):
    """A square box of particles that do not move."""

    start: str = parameter("packed", choices=("regular", "packed"), meaning="lattice, or packed from disorder")
    fractions: str = parameter("random", choices=("random", "checkerboard"),
                               meaning="liquids at the start: single ones or mixtures at random, or two in turn")
    diffusion_number: float = parameter(0.002, minimum=0.0, meaning="D dt/h^2")
    drifts: bool = parameter(True, meaning="whether the liquids drift too")
    steps: int = parameter(10000, minimum=1, meaning="number of time steps")
    tolerance: float = parameter(1e-12, exclusive_minimum=0.0, meaning="allowed relative change")


def run(case: Parameters) -> Outcome:
    """Measure bounds and changes at every resolution."""
    outcome = Outcome()
    for resolution in case.resolutions:
        begin = time.perf_counter()
        found = _mix(case, resolution)
        at: dict[str, Any] = {"at": f"n={resolution}", "wall_s": time.perf_counter() - begin}
        worst = found["change"]
        outcome.rows += [bounded(f"change of {name} / {of}", worst[name], case.tolerance, **at) for name, of in (
            ("volumes", "volume"), ("mass", "mass"), ("momentum", "sum of m |v|"))]
        outcome.rows += [
            bounded("volume fraction beyond 0 and 1", found["beyond"], case.tolerance, **at),
            bounded("sum of the fractions - 1", found["sum"], case.tolerance, **at),
            bounded("gain of kinetic energy / start", found["energy"], 1e-12, **at),
            Row("variance of the fractions / start", found["variance"], **at),
            Row("sub-steps per step", found["sub_steps"], **at)]
        outcome.curves.append(Curve("mixing_bounds", f"{case.fractions} D dt/h² {case.diffusion_number:g}",
                                    found["step"], np.maximum(found["curve"], 1e-17), "line"))
    return outcome


def _start(case: Parameters, position: np.ndarray, spacing: float, rng) -> np.ndarray:
    count = len(position)
    if case.fractions == "checkerboard":
        cell = np.floor((position + 0.5 * LENGTH) / spacing).astype(int).sum(axis=1) % 2
        return np.eye(3)[cell]
    mixed = rng.dirichlet(np.ones(3), count)
    pure = np.eye(3)[rng.integers(0, 3, count)]
    return np.where(rng.random(count)[:, None] < 0.5, mixed, pure)


def _mix(case: Parameters, resolution: int) -> dict:
    spacing = LENGTH / resolution
    support = case.support_ratio * spacing
    arrays = cavity("box", (LENGTH, LENGTH), spacing, start=case.start, support_ratio=case.support_ratio)
    effects: dict[str, Any] = {"gravity": {}}
    if case.drifts:  # the fastest slip is that of the light liquid in water
        effects["drift"] = {"droplet_diameter": 1e-3, "hindrance": 2.65}
    step = SLIP * spacing / 0.4
    if case.diffusion_number > 0.0:
        effects["diffusion"] = {"coefficient": case.diffusion_number * support**2 / step}
    solver = build(case, arrays, liquids=LIQUIDS, effects=effects)
    rng = np.random.default_rng(3)
    position = field(solver, "position")
    volume = field(solver, "volume") * rng.uniform(*VOLUMES, len(position))
    solver.particles.from_numpy("volume", volume)
    solver.particles.from_numpy("velocity", rng.normal(size=position.shape))
    solver.search.build()
    set_fractions(solver, _start(case, position, spacing, rng))
    mixing = [effect for effect in solver.effects if effect.name in ("drift", "diffusion")]

    def sums() -> tuple[np.ndarray, float, float]:
        mass, velocity, fraction = (field(solver, name) for name in ("mass", "velocity", "volume_fraction"))
        return (np.array([*(volume @ fraction), mass.sum(), *(mass @ velocity)]),
                float((mass[:, None] * np.abs(velocity)).sum()), 0.5 * float(mass @ (velocity**2).sum(axis=1)))

    (before, momentum, energy), spread = sums(), field(solver, "volume_fraction").var(axis=0).sum()
    scale = np.array([*3 * [volume.sum()], before[3], momentum, momentum])
    result: dict[str, Any] = {"beyond": 0.0, "sum": 0.0, "energy": 0.0, "step": [], "curve": []}
    every, worst, sub_steps = max(1, case.steps // RECORDS), np.zeros(6), 0
    for number in range(1, case.steps + 1):
        for effect in mixing:
            effect.prepare(step)
            sub_steps += effect.sub_steps
        if number % every and number != case.steps:
            continue
        now, _, energy_now = sums()
        fraction = field(solver, "volume_fraction")
        worst = np.maximum(worst, np.abs(now - before) / scale)
        result["beyond"] = max(result["beyond"], -fraction.min(), fraction.max() - 1.0)
        result["sum"] = max(result["sum"], float(np.abs(fraction.sum(axis=1) - 1.0).max()))
        result["energy"] = max(result["energy"], energy_now / energy - 1.0)
        result["step"].append(number)
        result["curve"].append(float((np.abs(now - before) / scale).max()))
    return result | {"change": {"volumes": worst[:3].max(), "mass": worst[3], "momentum": worst[4:].max()},
                     "sub_steps": sub_steps / case.steps,
                     "variance": field(solver, "volume_fraction").var(axis=0).sum() / spread}


FAMILY = Family(__name__, Parameters, run, effects=("drift", "diffusion", "gravity"), figures=FIGURES)
