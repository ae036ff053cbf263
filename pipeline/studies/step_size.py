"""What large time steps do to the eye: oil that comes to rest, with largest steps of several capillary limits.

There is no exact solution: the rise of the aqueous' center of mass is compared with that of the run with the smallest
steps (root mean square of the difference over that of the rise). Steps are counted in those of Brackbill et al. (1992),
which follow the shortest wave between liquids without viscosity; the limits of the solver hold all the same.
"""
import dataclasses

import numpy as np

from pipeline.scenes.model import Scene
from pipeline.studies.eye_rest import SCENE, height_of_aqueous
from pipeline.study_kit.model import Curve, Figure, Outcome, Row
from pipeline.study_kit.tank import TankParameters, advance, scene_solver
from sim.effects.interface_tension import capillary_limit
from sim.parameters import parameter
from sim.runtime import restart

FIGURES = (Figure("step_size", "Oil coming to rest in the eye", "time / s", "rise of the aqueous / mm"),)


@dataclasses.dataclass(frozen=True)
class Parameters(TankParameters):
    """The scene with several largest steps; ``resolutions``, ``largest_step`` and ``time_step_factor`` are not used."""

    capillary_steps: tuple[float, ...] = parameter((4.0, 1.0, 0.5), exclusive_minimum=0.0,
                                                   meaning="largest time steps over the capillary limit, downwards")
    duration: float = parameter(0.3, unit="s", exclusive_minimum=0.0, meaning="simulated time")


def solves(case: Parameters) -> str:
    """The scene of the eye."""
    return SCENE


def run(case: Parameters, scene: Scene) -> Outcome:
    """Watch the height of the aqueous with every largest step."""
    outcome, curves = Outcome(), {}
    limit = capillary_limit(scene.effects["interface_tension"].coefficient, scene.settings())
    for factor in case.capillary_steps:
        restart()  # the kernels of the solver before are found again, and its memory is free
        numerics = dataclasses.replace(scene.numerics, maximum_time_step=factor * limit)
        solver = scene_solver(case, dataclasses.replace(scene, numerics=numerics), numerics.particle_spacing)
        result = advance(solver, case.duration, f"[{factor:g} capillary limits]", height_of_aqueous)
        outcome.rows += [*result.rows(), Row("capillary limit", limit, "s", at=result.label)]
        outcome.remarks += result.remarks("eye at rest")
        if not result.failure:
            rise = 1e3 * (result.history["height"] - result.history["height"][0])
            times = result.history["time"]
            curves[result.label] = np.array([times, rise])
            outcome.rows.append(Row("rise of the aqueous at the end", rise[-1], "mm", at=result.label))
            outcome.curves.append(Curve("step_size", result.label.strip("[]"), times, rise, "line"))
    outcome.rows += differences(curves)
    return outcome


def differences(curves: dict[str, np.ndarray]) -> list[Row]:
    """Return how far every curve, (2, n), is from the last one."""
    if not curves:
        return []
    *others, finest = curves
    time, expected = curves[finest]
    return [Row(f"difference from {finest.strip('[]')}", at=label, value=float(
        np.sqrt(((np.interp(time, *curves[label]) - expected) ** 2).mean() / (expected**2).mean())))
        for label in others]
