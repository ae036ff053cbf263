"""Injection in the eye at any spacing and flow: the fill over time, and what it does to the particles.

Oil is injected into the eye full of aqueous, as in the scene ``tamponade``, or taken out again, as in ``oil_removal``.
The volume that has entered is compared, in every step, with what there was at the start and what has flowed since;
compression rates, the smallest distance of two particles and the iterations of the pressure tell how the particles bear
it. Resolutions count particles along the 22 mm of the cavity: 11, 22, 31, 44 and 55 are spacings of 2, 1, 0.7, 0.5 and
0.4 mm.
"""
import dataclasses
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from pipeline.cavity.surface import cavity_mesh
from pipeline.scenes.model import Scene
from pipeline.studies.family import Family
from pipeline.studies.model import Curve, Figure, Outcome, Row, bounded
from sim.parameters import parameter
from studies.validation.kit.tank import Run, TankParameters, advance, field, scene_solver

WIDTH = 0.022  # m
READINGS = 20  # of the distances between particles
FIGURES = (
    Figure("injection_volume", "Volume injected", "time / s", "volume that has entered / mL"),
    Figure("injection_compression", "Compression while oil is injected", "time / s", "largest compression rate"),
)


@dataclasses.dataclass(frozen=True)
class Parameters(TankParameters):
    """The scene at several resolutions; without ``largest_step``, which is the scene's own."""

    scene: str = parameter("tamponade", choices=("tamponade", "oil_removal"), meaning="scene of the eye")
    flow: float = parameter(2e-6, unit="m**3/s", exclusive_minimum=0.0, meaning="volume per time")
    drain_gap: float | None = parameter(None, unit="m", exclusive_minimum=0.0, meaning="distance of the drain from the "
                                        "wall at the posterior pole, else the drain of the scene")
    duration: float = parameter(0.1, unit="s", exclusive_minimum=0.0, meaning="simulated time")


def solves(case: Parameters) -> str:
    """The scene of the eye."""
    return case.scene


def run(case: Parameters, scene: Scene) -> Outcome:
    """Inject at every resolution."""
    outcome = Outcome()
    injection = dataclasses.replace(scene.effects["injection"], flow=case.flow)
    if case.drain_gap is not None:
        pole = float(cavity_mesh(scene.eye)[0].bounds[0, 2])
        injection = dataclasses.replace(injection, drain=(0.0, 0.0, pole + case.drain_gap))
    entering = [liquid.name for liquid in scene.liquids].index(injection.liquid)
    scene = dataclasses.replace(scene, effects=scene.effects | {"injection": injection})
    for resolution in case.resolutions:
        label = f"{1e3 * WIDTH / resolution:.2g} mm, {1e6 * case.flow:g} mL/s"
        if case.scene != "tamponade":
            label += f", {scene.title.lower()}"
        if case.drain_gap is not None:
            label += f", drain {1e3 * case.drain_gap:g} mm from the wall"
        solver = scene_solver(case, scene, WIDTH / resolution)
        result = advance(solver, case.duration, label, _watch(case.duration, entering))
        outcome.rows += result.rows() + _rows(injection, result)
        outcome.remarks += result.remarks("injection")
        if not result.failure and resolution == max(case.resolutions):  # curves of all would hide each other
            time, entered = result.history["time"][1:], result.history["entering"][1:]
            flowed = np.array([injection.flowed(t) for t in time])
            outcome.curves += [
                Curve("injection_volume", label, time, 1e6 * (entered - entered[0] + flowed[0]), "line"),
                Curve("injection_volume", f"asked for, {1e6 * case.flow:g} mL/s", time, 1e6 * flowed, "reference"),
                Curve("injection_compression", label, time, result.history["highest"][1:], "line")]
    return outcome


def _watch(duration: float, entering: int):
    """Reader of the volumes and of the packing; the distances, which take a tree, now and then."""
    nearest = {"due": 0.0, "value": np.nan}

    def watch(solver) -> dict[str, float]:
        volume, compression = field(solver, "volume"), field(solver, "compression_rate")
        if solver.time >= nearest["due"]:
            position = field(solver, "position")
            nearest["value"] = float(cKDTree(position).query(position, k=2)[0][:, 1].min()) / solver.spacing
            nearest["due"] += duration / READINGS
        low, high = np.percentile(compression, (1.0, 99.0))
        outside = solver.distance.at(field(solver, "position")) > 0.0
        entered = volume[solver.particles.to_numpy("phase") == entering].sum()
        return {"entering": entered, "cavity": solver.cavity_volume, "total": volume.sum(), "low": low, "high": high,
                "highest": compression.max(), "nearest": nearest["value"], "outside": float(outside.sum())}

    return watch


def _rows(injection, result: Run) -> list[Row]:
    """What is asked, and what is told."""
    entered, time, cavity = (result.values(name) for name in ("entering", "time", "cavity"))
    common: dict[str, Any] = {"at": result.label, "wall_s": result.wall_s}
    if result.failure:
        return [bounded("fill, largest difference from what is asked for", np.nan, 1e-3, **common)]
    flowed = np.array([injection.flowed(t) for t in time])
    difference = np.abs((entered[1:] - entered[1]) - (flowed[1:] - flowed[1])).max() / cavity[0]
    total = np.abs(result.values("total") / cavity - 1.0).max()
    return [bounded("fill, largest difference from what is asked for", float(difference), 1e-3, **common),
            bounded("volume of both liquids, largest change", float(total), 1e-6, **common),
            bounded("particles outside", float(result.values("outside").max()), 0.0, **common),
            Row("compression rate, lowest of 1st percentiles", float(result.values("low")[1:].min()), **common),
            Row("compression rate, highest of 99th percentiles", float(result.values("high")[1:].max()), **common),
            Row("compression rate, largest", float(result.values("highest")[1:].max()), **common),
            Row("smallest distance of two particles, in spacings", float(result.values("nearest").min()), **common)]


FAMILY = Family(__name__, Parameters, run, solves=solves, figures=FIGURES)
