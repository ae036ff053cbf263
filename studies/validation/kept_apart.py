"""Keeping aqueous and oil apart without surface tension: a round cavity turned on its side, with and without collision.

The oil starts beside the aqueous and rises over it; at the start, one particle in twenty of each is in the other. What
the liquids do to each other is counted: the share of isolated particles, most of whose neighbors are of the other
liquid, and the share of unlike pairs among the pairs of neighbors (the length of the interface). Without tension,
nothing but the hull test takes a single particle out of the other liquid.
"""
import dataclasses
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from pipeline.studies.family import Family
from pipeline.studies.model import Curve, Figure, Outcome, Row
from sim.parameters import parameter
from sim.settings import Liquid
from studies.validation.kit.tank import TankParameters, advance, build, cavity, field

RADIUS = 0.01  # m, of an eye
AQUEOUS, OIL = Liquid("aqueous", 1005.0, 0.7e-3), Liquid("oil", 970.0, 1.0)
NEIGHBORHOOD = 2.0  # spacings
SCATTERED = 0.05  # of the particles
FIGURES = (Figure("apart_isolated", "Particles left alone in the other liquid", "time / s", "isolated / particles"),)
FORMS = {"without": None, "hull": {}, "hull_and_half": {"least_share": 0.5}}


@dataclasses.dataclass(frozen=True)
class Parameters(TankParameters):
    """A circle, its left half oil."""

    collision: str = parameter("without", choices=tuple(FORMS),
                               meaning="no collision, that of the paper, or only where half the neighborhood is other")
    duration: float = parameter(0.5, unit="s", exclusive_minimum=0.0, meaning="simulated time")


def run(case: Parameters) -> Outcome:
    """Run every resolution and count."""
    outcome = Outcome()
    for resolution in case.resolutions:
        spacing = 2.0 * RADIUS / resolution
        effects = {"gravity": {}, "viscosity_implicit": {}}
        if FORMS[case.collision] is not None:
            effects["collision"] = FORMS[case.collision]
        solver = build(case, cavity("circle", RADIUS, spacing, support_ratio=case.support_ratio),
                       liquids=(AQUEOUS, OIL), effects=effects, phase=scattered)
        result = advance(solver, case.duration, f"n={resolution}", counts)
        outcome.rows += result.rows()
        outcome.remarks += result.remarks(f"apart {case.collision}")
        at: dict[str, Any] = {"at": result.label, "wall_s": result.wall_s}
        isolated, unlike = result.values("isolated"), result.values("unlike")
        outcome.rows += [Row("isolated particles / particles, at the start", float(isolated[0]), **at),
                         Row("isolated particles / particles, mean", float(np.mean(isolated)), **at),
                         Row("isolated particles / particles, at the end", float(isolated[-1]), **at),
                         Row("unlike pairs / pairs, at the end", float(unlike[-1]), **at),
                         Row("share of the oil in the upper half, at the end", float(result.values("risen")[-1]), **at),
                         Row("root mean square speed at the end", float(result.values("speed")[-1]), "m/s", **at),
                         Row("share of the time in collision",
                             solver.seconds.get("collision", 0.0) / sum(solver.seconds.values()), **at)]
        if not result.failure:
            outcome.curves.append(Curve("apart_isolated", f"{case.collision} {result.label}", result.history["time"],
                                        isolated, "line"))
    return outcome


def scattered(position: np.ndarray) -> np.ndarray:
    """Oil on the left, aqueous on the right, but for some particles anywhere, the same in every run."""
    return (position[:, 0] < 0.0) ^ (np.random.default_rng(0).random(len(position)) < SCATTERED)


def counts(solver) -> dict[str, float]:
    """Isolated particles, unlike pairs, share of the oil above the middle, and root mean square speed, m/s."""
    position, phase, velocity = field(solver, "position"), solver.particles.to_numpy("phase"), field(solver, "velocity")
    pairs = cKDTree(position).query_pairs(NEIGHBORHOOD * solver.spacing, output_type="ndarray")
    unlike = phase[pairs[:, 0]] != phase[pairs[:, 1]]
    number = np.bincount(pairs.ravel(), minlength=len(position))
    other = np.bincount(pairs[unlike].ravel(), minlength=len(position))
    return {"isolated": float(np.mean(other > 0.5 * number)), "unlike": float(unlike.mean()),
            "risen": float(np.mean(position[phase == 1, 1] > 0.0)),
            "speed": float(np.sqrt((velocity**2).sum(axis=1).mean()))}


FAMILY = Family(__name__, Parameters, run, effects=("gravity", "viscosity_implicit", "collision"), figures=FIGURES)
