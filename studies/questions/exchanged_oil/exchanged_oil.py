"""Oil out of the eye and aqueous in, or the other way: what is left when the tip that drains no longer touches it.

A tip that stands still drains the liquid that gathers there. Of the liquid that is left the nearest is watched: when it
is farther from the tip than the ball that the tip drains, the tip has lost it. What is left then stays behind, unless
the surgeon moves the tip or the eye.

In surgery the oil creeps, so that its shape follows from densities, tension and the capillary number mu Q/(pi R^2
sigma) alone. That one is the same for all oils in one cannula, since the flow Q falls as the viscosity mu rises (J6). A
simulation cannot wait for minutes: the flow is larger here and the oil as much thinner, at the capillary number of
surgery. Equations: docs/methods/injection.md.
"""
import dataclasses
import time
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pipeline.base.progress import progress
from pipeline.equilibrium.of_scene import liquids_at_rest, rest_of
from pipeline.planning.settings import postures
from pipeline.scenes.load import project_materials
from pipeline.scenes.model import Scene
from pipeline.studies.family import Family
from pipeline.studies.model import Outcome, Row
from sim.errors import RunError
from sim.parameters import parameter
from studies.questions.exchanged_oil._words import EXCHANGE_COURSES, EXCHANGES, LARGEST, LEFT, LOST_AT, PIECES
from studies.questions.kit.resting_eye import RestingEye
from studies.questions.kit.words import OILS

SCENES = {"removal": "oil_removal", "filling": "tamponade"}
READING = 0.01      # of the cavity, that flows from one reading to the next
LOST = 3            # readings in a row without the liquid at the tip
JOINED = 1.5        # particle spacings between particles of one piece
MOST = 0.985        # of the cavity, that the entering liquid may come to hold


@dataclasses.dataclass(frozen=True)
class Parameters:
    """One exchange."""

    exchange: str = parameter(choices=tuple(SCENES), meaning="removal of the oil, or filling with it")
    oil: str = parameter(choices=OILS, meaning="liquid of config/materials.yaml")
    tip_name: str = parameter(meaning="where the tip is, in a few words")
    tip: tuple[float, float, float] = parameter(unit="m", minimum=-0.02, maximum=0.02, meaning="tip that drains")
    cannula: tuple[float, float, float] = parameter(unit="m", minimum=-0.02, maximum=0.02,
                                                    meaning="tip through which liquid enters")
    flow: float = parameter(unit="m**3/s", exclusive_minimum=0.0, maximum=1e-5, meaning="volume per time")
    viscosity: float = parameter(0.1, unit="Pa s", exclusive_minimum=0.0, meaning="of the oil in the simulation")
    fill: float = parameter(0.85, minimum=0.5, maximum=0.98, meaning="share of the cavity that is oil before a removal")
    posture: str = parameter("supine", choices=("supine", "upright", "left_side", "right_side"),
                             meaning="posture of the patient")
    precision: str = parameter("f32", choices=("f32", "f64"), meaning="floating point format of the fields")


def solves(case: Parameters) -> str:
    """The scene that is changed."""
    return SCENES[case.exchange]


def liquids(case: Parameters) -> tuple[str, ...]:
    """Liquids of ``config/materials.yaml`` that the case reads."""
    return (case.oil,)


def changed(case: Parameters, scene: Scene) -> Scene:
    """Return the scene with the oil, the tips and the flow of a case."""
    material = project_materials()[case.oil]
    aqueous, oil = scene.liquids[0], dataclasses.replace(material, dynamic_viscosity=case.viscosity)
    removal = case.exchange == "removal"
    effects = scene.effects | {
        "gravity": dataclasses.replace(scene.effects["gravity"], posture=case.posture, turns=(), jolts=()),
        "injection": dataclasses.replace(
            scene.effects["injection"], liquid=aqueous.name if removal else oil.name,
            drained_liquid=oil.name if removal else aqueous.name, flow=case.flow, fill=MOST, cannula=case.cannula,
            drain=case.tip, start=0.0)}
    initial = (dataclasses.replace(scene.initial, fill={oil.name: case.fill, aqueous.name: 1.0 - case.fill})
               if removal else scene.initial)
    numerics = dataclasses.replace(scene.numerics, precision=case.precision, threads=0)
    return dataclasses.replace(scene, liquids=(aqueous, oil), initial=initial, effects=effects, numerics=numerics)


def run(case: Parameters, scene: Scene) -> Outcome:
    """Exchange until the tip has lost the liquid that it drains."""
    begin, cpu_begin = time.perf_counter(), time.process_time()
    scene = changed(case, scene)
    eye = RestingEye.of(scene)
    if case.exchange == "removal":
        eye.fill_as(rest_of(scene, postures()[case.posture], case.fill))
    injection, solver = scene.effects["injection"], eye.solver
    drained = [liquid.name for liquid in scene.liquids].index(injection.drained_liquid)
    reach = injection.radius + 0.5 * solver.spacing
    step, readings, lost_since, ended = READING * solver.cavity_volume / case.flow, [], 0, ""
    most = (MOST - (1.0 - case.fill if case.exchange == "removal" else 0.0)) * solver.cavity_volume
    with progress(round(most / (READING * solver.cavity_volume)), case.exchange) as bar:
        while injection.flowed(solver.time) < most and lost_since < LOST:
            try:
                for _ in solver.advance(solver.time + step):
                    pass
            except RunError as error:  # what is left is too little to give way evenly
                if not readings:
                    raise
                ended = str(error)
                break
            readings.append((solver.time, *_left(solver, drained, case.tip)))
            lost_since = lost_since + 1 if readings[-1][2] > reach else 0
            bar.update(1)
    return _outcome(case, eye, np.array(readings), lost_since >= LOST, drained, ended,
                    (time.process_time() - cpu_begin, time.perf_counter() - begin))


def _left(solver, liquid: int, tip) -> tuple[float, float]:
    """Volume of a liquid, m3, and the distance of its nearest particle from the tip, m."""
    chosen = solver.particles.to_numpy("phase") == liquid
    position, volume = (solver.particles.to_numpy(name).astype(float)[chosen] for name in ("position", "volume"))
    return float(volume.sum()), float(np.linalg.norm(position - np.array(tip), axis=1).min(initial=np.inf))


def pieces_of(position: np.ndarray, volume: np.ndarray, apart: float) -> np.ndarray:
    """Volumes of the pieces that particles (n, 3) make up, the largest first: neighbors are not farther than apart."""
    if not len(position):
        return np.zeros(0)
    pairs = cKDTree(position).query_pairs(apart, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(position),) * 2)
    return np.sort(np.bincount(connected_components(graph, directed=False)[1], volume))[::-1]


def _outcome(case: Parameters, eye: RestingEye, readings: np.ndarray, lost: bool, drained: int, ended: str,
             seconds: tuple[float, float]) -> Outcome:
    solver, cavity = eye.solver, eye.solver.cavity_volume
    chosen = solver.particles.to_numpy("phase") == drained
    position, volume = (solver.particles.to_numpy(name).astype(float)[chosen] for name in ("position", "volume"))
    pieces = pieces_of(position, volume, JOINED * solver.spacing)
    at_loss = readings[-LOST if lost else -1]
    radius = (3.0 * cavity / (4.0 * np.pi)) ** (1.0 / 3.0)
    capillary = case.viscosity * case.flow / (np.pi * radius**2 * liquids_at_rest(eye.scene).tension)
    heads = [case.exchange, case.tip_name, f"{1e6 * case.flow:g}"]
    numbers = [(LEFT, 100.0 * at_loss[1] / cavity, "%"), (PIECES, float(len(pieces)), ""),
               (LARGEST, 100.0 * pieces.max(initial=0.0) / cavity, "%"), (LOST_AT, at_loss[0] if lost else np.nan, "s")]
    lines = [[*heads, f"{capillary:.3g}", f"{1e3 * solver.spacing:g}", quantity,
              f"{value:.4g}" if np.isfinite(value) else "", unit] for quantity, value, unit in numbers]
    course = [[*heads, f"{1e6 * (case.flow * t):.4g}", f"{100.0 * left / cavity:.4g}", f"{1e3 * distance:.4g}"]
              for t, left, distance in readings]
    common: dict[str, Any] = {"at": f"[{1e3 * solver.spacing:g} mm]"}
    outcome = Outcome(tables={"exchanges": [list(EXCHANGES), *lines], "courses": [list(EXCHANGE_COURSES), *course]})
    outcome.rows += [Row(quantity, value, unit or "1", **common) for quantity, value, unit in numbers
                     if np.isfinite(value)]
    outcome.rows += [Row("capillary number", capillary, **common),
                     Row("particles", float(solver.count[None]), **common),
                     Row("time steps", float(solver.step_count), **common),
                     Row("processor time", seconds[0], "s", wall_s=seconds[1], **common)]
    if ended:
        outcome.remarks.append(f"{case.exchange}, {case.tip_name}: ended since {ended}.")
    return outcome


FAMILY = Family(__name__, Parameters, run, solves=solves, liquids=liquids,
                unnamed=("tip", "cannula", "viscosity", "fill"))
