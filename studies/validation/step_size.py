"""What the length of the time step costs in accuracy, and saves in time: oil that comes to rest in the eye.

There is no exact solution: the rise of the aqueous' center of mass, and the kinetic energy, are compared with those of
the run with the smallest steps (root mean square of the difference over that of the quantity). Steps are the largest
ones; where particles move fast, the solver takes shorter ones all the same.
"""
import dataclasses

import numpy as np

from pipeline.scenes.model import Scene
from pipeline.studies.family import Family
from pipeline.studies.model import Curve, Figure, Outcome, Row
from sim.backend.runtime import restart
from sim.parameters import parameter
from studies.validation.eye_rest import SCENE, height_of_aqueous
from studies.validation.kit.tank import TankParameters, advance, field, scene_solver

COST, ERROR = "step_size_cost", "step_size_error"
FIGURES = (Figure("step_size", "Oil coming to rest in the eye", "time / s", "rise of the aqueous / mm"),
           Figure(ERROR, "Error of the rise by the time step", "largest time step / ms",
                  "off the smallest steps / %", True),
           Figure(COST, "Error of the rise against computing time", "computing time per simulated second / min",
                  "off the smallest steps / %", True))
LARGEST_ERROR = 0.1  # `numerics.time_error` of all runs, so that it shortens no step


@dataclasses.dataclass(frozen=True)
class Parameters(TankParameters):
    """The scene with several largest steps; ``resolutions``, ``largest_step`` and ``time_step_factor`` are not used."""

    largest_steps: tuple[float, ...] = parameter((8e-3, 4e-3, 2e-3, 1e-3, 0.5e-3), unit="s", exclusive_minimum=0.0,
                                                 meaning="largest time steps, downwards")
    spacing_factor: float = parameter(1.0, minimum=0.5, maximum=4.0,
                                      meaning="particle spacing, over that of the accuracy level")
    duration: float = parameter(0.3, unit="s", exclusive_minimum=0.0, meaning="simulated time")


def solves(case: Parameters) -> str:
    """The scene of the eye."""
    return SCENE


def run(case: Parameters, scene: Scene) -> Outcome:
    """Watch the height of the aqueous with every largest step."""
    outcome, curves, energies, minutes = Outcome(), {}, {}, {}
    spacing = case.spacing_factor * scene.numerics.particle_spacing
    for step in case.largest_steps:
        restart()  # the kernels of the solver before are found again, and its memory is free
        numerics = dataclasses.replace(scene.numerics, maximum_time_step=step, time_error=LARGEST_ERROR)
        solver = scene_solver(case, dataclasses.replace(scene, numerics=numerics), spacing)
        result = advance(solver, case.duration, f"[{1e3 * step:g} ms]", _motion)
        outcome.rows += [*result.rows(), Row("particle spacing", 1e3 * spacing, "mm", at=result.label)]
        outcome.remarks += result.remarks("eye at rest")
        if not result.failure:
            rise = 1e3 * (result.history["height"] - result.history["height"][0])
            times = result.history["time"]
            curves[result.label] = np.array([times, rise])
            energies[result.label] = np.array([times, result.history["energy"]])
            minutes[result.label] = result.seconds[1] / 60.0 / case.duration
            outcome.rows.append(Row("rise of the aqueous at the end", rise[-1], "mm", at=result.label))
            outcome.curves.append(Curve("step_size", f"{1e3 * spacing:g} mm, {result.label.strip('[]')}", times, rise,
                                        "line"))
    found = differences(curves)
    outcome.rows += [*found, *differences(energies, "kinetic energy, ")]
    steps = [float(row.at.strip("[] ms")) for row in found]
    errors = [100.0 * row.value for row in found]
    label = f"{1e3 * spacing:g} mm, support of {case.support_ratio:g} spacings"
    outcome.curves += [Curve(ERROR, label, steps, errors),
                       Curve(COST, label, [minutes[row.at] for row in found], errors)]
    return outcome


def _motion(solver) -> dict[str, float]:
    """Height of the center of mass of the aqueous, m, and kinetic energy, J."""
    velocity = field(solver, "velocity")
    return {**height_of_aqueous(solver), "energy": 0.5 * float(field(solver, "mass") @ (velocity**2).sum(axis=1))}


def differences(curves: dict[str, np.ndarray], of: str = "") -> list[Row]:
    """Return how far every curve, (2, n), is from the last one."""
    if not curves:
        return []
    *others, finest = curves
    time, expected = curves[finest]
    return [Row(f"{of}difference from {finest.strip('[]')}", at=label, value=float(
        np.sqrt(((np.interp(time, *curves[label]) - expected) ** 2).mean() / (expected**2).mean())))
        for label in others]


FAMILY = Family(__name__, Parameters, run, solves=solves, figures=FIGURES)
