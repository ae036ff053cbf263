"""What viscosity XSPH is: the decay of a shear wave.

u = U sin ky in a periodic square decays as exp(-nu k^2 t), k = 2 pi/L. A coefficient c in steps dt should be the
viscosity nu = c M/(2 dt) (``sim.effects.xsph``), and the liquid's own viscosity should be itself. The time step is the
one in which c stands for the asked Re = U L/nu. What the wave loses without any viscosity is the scheme's own.
"""
import dataclasses
from typing import Any

import numpy as np

from pipeline.studies.family import Family
from pipeline.studies.model import Curve, Figure, Outcome, Row, compared
from sim.effects.xsph import kinematic_viscosity
from sim.parameters import parameter
from sim.settings import Liquid, Numerics
from studies.validation.kit.tank import TankParameters, advance, build, cavity, field

PERIOD, SPEED, DENSITY = 1.0, 1.0, 1000.0  # m, m/s, kg/m^3
WAVE_NUMBER = 2.0 * np.pi / PERIOD
TOLERANCE = 0.05
FIGURES = (Figure("shear_wave_decay", "Shear wave under XSPH", "nu k² t", "ln(amplitude / start)"),)


@dataclasses.dataclass(frozen=True)
class Parameters(TankParameters):
    """A shear wave in a periodic square; resolutions count particles along the period."""

    coefficient: float = parameter(0.1, exclusive_minimum=0.0, maximum=0.5, meaning="c, which sets the time step")
    viscosity: str = parameter("coefficient", choices=("coefficient", "own", "none"),
                               meaning="that of the coefficient, the same number as the liquid's own, or none")
    reynolds: float = parameter(10.0, exclusive_minimum=0.0, meaning="U L / nu")
    decay: float = parameter(1.0, exclusive_minimum=0.0, meaning="length of the run in e-foldings of the wave")


def run(case: Parameters) -> Outcome:
    """Measure the viscosity at every resolution."""
    outcome, name = Outcome(), f"{case.viscosity} {case.coefficient:g}"
    nu = SPEED * PERIOD / case.reynolds
    for resolution in case.resolutions:
        arrays = cavity("box", (PERIOD, PERIOD), PERIOD / resolution, start="packed", support_ratio=case.support_ratio,
                        periodic=(0, 1))
        numerics = Numerics(particle_spacing=PERIOD / resolution, kernel=case.kernel, support_ratio=case.support_ratio)
        step = kinematic_viscosity(case.coefficient, 1.0, numerics, 2) / nu
        effects: dict[str, Any] = {
            "coefficient": {"xsph": {"coefficient": case.coefficient}}, "own": {"xsph": {}}, "none": {}}
        solver = build(case, arrays, liquids=(Liquid("liquid", DENSITY, DENSITY * nu),),
                       effects=effects[case.viscosity], velocity=wave, time_step=step, maximum_time_step=step,
                       minimum_time_step=1e-6 * step)
        result = advance(solver, case.decay / (nu * WAVE_NUMBER**2), f"n={resolution}", amplitude)
        outcome.rows += result.rows()
        outcome.remarks += result.remarks(f"shear wave {name}")
        at: dict[str, Any] = {"at": result.label, "wall_s": result.wall_s}
        if result.failure:
            outcome.rows.append(Row("viscosity of the wave's decay / asked", np.nan, error=np.nan,
                                    tolerance=TOLERANCE, **at))
            continue
        time, wave_left = result.history["time"], result.values("amplitude")
        slope = -float(np.polyfit(nu * WAVE_NUMBER**2 * time, np.log(wave_left), 1)[0])
        quantity = "viscosity of the wave's decay / asked"
        outcome.rows.append(Row(quantity, slope, **at) if case.viscosity == "none" else
                            compared(quantity, slope, 1.0, TOLERANCE, **at))
        outcome.curves += [Curve("shear_wave_decay", f"{name} {result.label}", nu * WAVE_NUMBER**2 * time,
                                 np.log(wave_left / wave_left[0]), "line"),
                           Curve("shear_wave_decay", "exact", [0.0, case.decay], [0.0, -case.decay], "reference")]
    return outcome


def wave(position: np.ndarray) -> np.ndarray:
    """Velocity at positions, (n, 2), m/s."""
    return SPEED * np.stack([np.sin(WAVE_NUMBER * position[:, 1]), np.zeros(len(position))], axis=1)


def amplitude(solver) -> dict[str, float]:
    """Amplitude of the wave, m/s: its share of the velocities by least squares."""
    shape = np.sin(WAVE_NUMBER * field(solver, "position")[:, 1])
    return {"amplitude": float(field(solver, "velocity")[:, 0] @ shape / (shape @ shape))}


FAMILY = Family(__name__, Parameters, run, effects=("xsph",), figures=FIGURES)
