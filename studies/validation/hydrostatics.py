"""Two layers at rest under gravity, the light one on top.

The pressure is the weight of what lies above: p = rho_2 g (H - y) in the light layer, and a kink at the interface.
A closed cavity knows it up to a constant, which is taken from its mean; under a free surface it is known. With the
ratio the pressure solve becomes harder: the iterations per step may not exceed three times those of the ratio
1:1 by much, which the rows of the same resolution show.

The weight acts at the labels of the particles or, in a closed cavity, at the level set of `interface_tension`, which
has no tension here.
"""
import dataclasses
from typing import Any

import numpy as np

from pipeline.studies.family import Family, Headline
from pipeline.studies.model import Curve, Figure, Outcome, Row, bounded, observed_order
from sim.parameters import parameter
from sim.settings import Liquid
from studies.validation.kit.tank import PackedParameters, Run, advance, build, cavity, field, motion

GRAVITY = 9.81
HEIGHT = 0.02  # m, the size of an eye
HEAVY = 1000.0  # kg/m^3
FIGURES = (
    Figure("hydrostatics_error", "Pressure of two layers at rest", "particle spacing / height",
           "root mean square of the pressure error / (rho g H)", logarithmic=True),
    Figure("hydrostatics_profile", "Pressure at the finest resolution", "pressure / (rho g H)", "height / H"),
)


@dataclasses.dataclass(frozen=True)
class Parameters(PackedParameters):
    """Two layers in a cavity."""

    cavity: str = parameter("box", choices=("box", "circle", "open_box"),
                            meaning="closed and full box or circle, or a box with a free surface")
    density_ratio: float = parameter(0.5, exclusive_minimum=0.0, maximum=1.0, meaning="light over heavy density")
    viscosity: float = parameter(1e-3, unit="Pa*s", minimum=0.0, meaning="viscosity of the light liquid")
    start: str = parameter("regular", choices=("regular", "packed"),
                           meaning="a lattice, which a circle packs, or packed from disorder")
    interface: str = parameter("labels", choices=("labels", "level_set"), meaning="what tells the weights apart")
    rest_times: float = parameter(10.0, exclusive_minimum=0.0, meaning="length of the run in sqrt(H/g)")
    pressure_tolerance: float = parameter(0.02, exclusive_minimum=0.0, meaning="allowed error over rho g H")
    speed_tolerance: float = parameter(1e-3, exclusive_minimum=0.0, meaning="allowed speed over sqrt(g H)")


def run(case: Parameters) -> Outcome:
    """Measure pressure error, speed and iterations at every resolution, and the observed order."""
    outcome, errors = Outcome(), []
    name = f"{case.scheme} {case.cavity} 1:{case.density_ratio:g} {case.interface}"
    for index, resolution in enumerate(case.resolutions):
        result = _settle(case, resolution, f"n={resolution}")
        error, speed = _pressure_error(case, result), result.values("speed")[-1] / np.sqrt(GRAVITY * HEIGHT)
        errors.append(error)
        asked = index > 0  # the coarse run is there for the order only
        common: dict[str, Any] = {"at": result.label, "wall_s": result.wall_s}
        outcome.rows += [bounded("pressure error / (rho g H)", error, case.pressure_tolerance if asked else None,
                                 **common),
                         bounded("rms speed at the end / sqrt(g H)", speed, case.speed_tolerance if asked else None,
                                 **common), *result.rows()]
        outcome.remarks += result.remarks(name)
    spacings = [1.0 / resolution for resolution in case.resolutions]
    outcome.rows.append(Row("observed order of the pressure error", observed_order(spacings, errors)))
    outcome.curves.append(Curve("hydrostatics_error", name, spacings, errors))
    if not result.failure:
        outcome.curves += _profile(case, result, name)
    return outcome


def _settle(case: Parameters, resolution: int, label: str) -> Run:
    spacing = HEIGHT / resolution
    size: dict[str, Any] = {
        "box": (0.5 * HEIGHT, HEIGHT), "circle": 0.5 * HEIGHT, "open_box": (0.5 * HEIGHT, 1.5 * HEIGHT)}
    arrays = cavity(case.cavity.removeprefix("open_"), size[case.cavity], spacing, start=case.start,
                    support_ratio=case.support_ratio, seed=case.seed)
    liquids = (Liquid("heavy", HEAVY, 1e-3), Liquid("light", HEAVY * case.density_ratio, case.viscosity))
    level = _interface(case)
    effects: dict[str, Any] = {"gravity": {"magnitude": GRAVITY}, "viscosity_implicit": {}}
    if case.interface == "level_set":
        effects["interface_tension"] = {"coefficient": 0.0}
    solver = build(case, arrays, liquids=liquids, phase=lambda x: x[:, 1] > level,
                   filled=(lambda x: x[:, 1] < level + 0.5 * HEIGHT) if case.cavity == "open_box" else None,
                   effects=effects,
                   maximum_time_step=case.largest_step * np.sqrt(spacing / GRAVITY))
    return advance(solver, case.rest_times * np.sqrt(HEIGHT / GRAVITY), label, motion)


def _interface(case: Parameters) -> float:
    """Height of the interface, m: half the liquid is below it."""
    return -0.25 * HEIGHT if case.cavity == "open_box" else 0.0


def exact_pressure(density_ratio: float, height: np.ndarray) -> np.ndarray:
    """Pressure over rho g H of two equal layers that meet at height 0, zero at the top; heights over H."""
    return 0.5 * density_ratio - np.where(height < 0.0, height, density_ratio * height)


def _pressures(case: Parameters, result: Run) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Heights over H, pressures over rho g H and the exact ones; a closed cavity takes the mean from these."""
    state = result.solver.snapshot()
    height = (state["position"][:, 1] - _interface(case)) / HEIGHT
    exact = exact_pressure(case.density_ratio, height)
    pressure = state["pressure"].astype(float) / (HEAVY * GRAVITY * HEIGHT)
    unknown = 0.0 if case.cavity == "open_box" else (pressure - exact).mean()
    return height, pressure - unknown, exact


def _pressure_error(case: Parameters, result: Run) -> float:
    if result.failure:
        return np.nan
    _, pressure, exact = _pressures(case, result)
    return float(np.sqrt(((pressure - exact) ** 2).mean()))


def _profile(case: Parameters, result: Run, name: str) -> list[Curve]:
    height, pressure, _ = _pressures(case, result)
    line = np.array([height.min(), 0.0, height.max()])
    near = np.abs(field(result.solver, "position")[:, 0]) < 0.75 * HEIGHT / case.resolutions[-1]
    near = near[np.argsort(result.solver.particles.to_numpy("id"))]  # as the snapshot is sorted
    return [Curve("hydrostatics_profile", name, pressure[near], height[near]),
            Curve("hydrostatics_profile", f"exact 1:{case.density_ratio:g}",
                  exact_pressure(case.density_ratio, line), line, "reference")]


FAMILY = Family(__name__, Parameters, run, effects=("gravity", "viscosity_implicit", "interface_tension"),
                figures=FIGURES, headline=Headline("pressure error / (rho g H)", 1.0, shown_by=("gravity",)))
