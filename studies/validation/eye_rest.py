"""The eye itself: oil that starts level above the aqueous rounds up under its tension; compared with a finer run.

There is no exact solution: the height of the aqueous' center of mass, less that at the start, is compared with that of
the run with the most particles (root mean square of the difference over that of the height: self-convergence). The
scene is ``resting_eye`` with other numerics; resolutions count particles along the 22 mm of the cavity.
"""
import dataclasses

import numpy as np

from pipeline.scenes.model import Scene
from pipeline.studies.family import Family, Headline
from pipeline.studies.model import Curve, Figure, Outcome
from sim.parameters import parameter
from studies.validation.kit.tank import TankParameters, advance, field, scene_solver

SCENE = "resting_eye"
WIDTH = 0.022  # m
FIGURES = (Figure("eye_rest_height", "Oil coming to rest in the eye", "time / s", "rise of the aqueous / mm"),)


@dataclasses.dataclass(frozen=True)
class Parameters(TankParameters):
    """The scene at several resolutions; without ``largest_step``, which is the scene's own."""

    duration: float = parameter(0.3, unit="s", exclusive_minimum=0.0, meaning="simulated time")


def solves(case: Parameters) -> str:
    """The scene of the eye."""
    return SCENE


def run(case: Parameters, scene: Scene) -> Outcome:
    """Watch the height of the aqueous at every resolution."""
    outcome = Outcome()
    for resolution in case.resolutions:
        solver = scene_solver(case, scene, WIDTH / resolution)
        result = advance(solver, case.duration, f"n={resolution}", height_of_aqueous)
        outcome.rows += result.rows()
        outcome.remarks += result.remarks("eye at rest")
        if not result.failure:
            height = result.history["height"] - result.history["height"][0]
            outcome.curves.append(Curve("eye_rest_height", result.label, result.history["time"], 1e3 * height, "line"))
    return outcome


def height_of_aqueous(solver) -> dict[str, float]:
    """Height of the center of mass of the aqueous, m."""
    aqueous = solver.particles.to_numpy("phase") == 0
    mass = field(solver, "mass")[aqueous]
    return {"height": float(mass @ field(solver, "position")[aqueous, 1] / np.sum(mass))}


FAMILY = Family(__name__, Parameters, run, solves=solves, figures=FIGURES,
                headline=Headline("height of the aqueous, difference from the finest run", 1.0, self_convergence=True,
                                  shown_by=("gravity", "viscosity_implicit", "interface_tension")))
