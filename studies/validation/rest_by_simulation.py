"""Oil or gas at rest by energy (`pipeline.equilibrium`) beside simulations in eyes for which it was not made.

A shape at rest depends on densities, tension, contact angle and the eye, not on viscosity: both liquids get one small
viscosity, so that the simulation rests within seconds. It starts level, which tells whether it finds the shape, or in
the shape, which tells whether it keeps it. What it covers is read by the project's rule (`pipeline.measures.coverage`),
and so is the sharp shape on the same particles: that tells what the rule adds from what the solver does.
"""
import dataclasses
import time

import numpy as np

from pipeline.cavity.surface import cavity_mesh
from pipeline.cavity.voxels import voxelize
from pipeline.equilibrium.contact import Contact, shares
from pipeline.equilibrium.of_scene import depth_in_oil, rest_of
from pipeline.equilibrium.rest import Rest
from pipeline.measures.coverage import WallContact
from pipeline.planning.settings import postures
from pipeline.scenes.model import AT_REST, Eye, Scene
from pipeline.simulation.solver_setup import build_solver
from pipeline.studies.family import Family
from pipeline.studies.model import Curve, Figure, Outcome, Row
from sim.effects.gravity import POSTURES
from sim.parameters import parameter
from studies.validation.kit.tank import advance, time_rows

SCENES, AQUEOUS = ("resting_eye", "gas_eye"), "aqueous"
PARTS = {"retina": "whole", "superior": "superior", "inferior": "inferior", "macula": "macula"}
TOLERANCE = 3.0     # points of a covered share
ASKED = ("retina", "inferior")
WINDOWS = 20        # of the duration, at whose ends the coverage is read
FIGURES = (Figure("rest_by_simulation", "Coming to rest", "time / s", "covered retina less that at rest / points"),)


@dataclasses.dataclass(frozen=True)
class Parameters:
    """One eye, fill and posture."""

    patient: str = parameter(meaning="name of the eye")
    eye: Eye = parameter(Eye(), meaning="the eye, as in a scene")
    scene: str = parameter("resting_eye", choices=SCENES, meaning="scene that has the liquids and their tension")
    fill: float = parameter(0.85, minimum=0.5, maximum=0.98, meaning="share of the cavity that is oil or gas")
    posture: str = parameter("upright", choices=tuple(POSTURES), meaning="posture of the patient")
    start: str = parameter("level", choices=("level", AT_REST), meaning="where the oil or gas is at first")
    coarser: float = parameter(1.0, minimum=0.25, maximum=2.0, meaning="particle spacing over that of the level")
    viscosity: float = parameter(0.1, unit="Pa s", exclusive_minimum=0.0, meaning="of both liquids")
    duration: float = parameter(3.0, unit="s", exclusive_minimum=0.0, meaning="simulated time")
    precision: str = parameter("f32", choices=("f32", "f64"), meaning="floating point format of the fields")


def solves(case: Parameters) -> str:
    """The scene that is changed."""
    return case.scene


def changed(case: Parameters, scene: Scene) -> Scene:
    """Return the scene with the eye, fill, posture, viscosity and particle spacing of a case."""
    effects = scene.effects | {"gravity": dataclasses.replace(scene.effects["gravity"], posture=case.posture)}
    liquids = tuple(dataclasses.replace(liquid, dynamic_viscosity=case.viscosity) for liquid in scene.liquids)
    fill = {tamponade_of(scene): case.fill, AQUEOUS: 1.0 - case.fill}
    initial = dataclasses.replace(scene.initial, shape=case.start, fill=fill)
    numerics = dataclasses.replace(scene.numerics, particle_spacing=case.coarser * scene.numerics.particle_spacing,
                                   precision=case.precision, threads=0)
    return dataclasses.replace(scene, eye=case.eye, effects=effects, liquids=liquids, initial=initial,
                               numerics=numerics)


def tamponade_of(scene: Scene) -> str:
    """Name of the liquid in place of the vitreous that is not aqueous."""
    return next(liquid.name for liquid in scene.liquids if liquid.name != AQUEOUS)


def run(case: Parameters, scene: Scene) -> Outcome:
    """Simulate, and set what is covered beside the shape of least energy."""
    scene = changed(case, scene)
    begin = time.perf_counter()
    exact = rest_of(scene, postures()[case.posture], case.fill)
    exact_s = time.perf_counter() - begin
    initial = voxelize(scene, cavity_mesh(scene.eye)[0])[0]
    solver = build_solver(scene, initial)
    oil = [liquid.name for liquid in scene.liquids].index(tamponade_of(scene))
    times, covered, seconds, failure = [0.0], [_read(scene, initial, solver, oil)], np.zeros(2), ""
    for end in case.duration * np.arange(1, WINDOWS + 1) / WINDOWS:
        run = advance(solver, float(end), f"{case.patient} {case.posture} to {end:.2g} s", lambda solver: {})
        seconds += np.nan_to_num(run.seconds)
        failure = run.failure
        if failure:
            break
        times.append(solver.time)
        covered.append(_read(scene, initial, solver, oil))
    found = np.array(covered)
    return _outcome(case, exact, exact_s, _reading(scene, initial, exact), np.array(times), found, seconds, failure,
                    len(initial["fluid_position"]))


def _read(scene: Scene, initial: dict[str, np.ndarray], solver, oil: int) -> list[float]:
    arrays = solver.snapshot()
    return retina_covered(scene, initial, arrays["position"].astype(float),
                          arrays["volume_fraction"][:, oil].astype(float))


def retina_covered(scene: Scene, initial: dict[str, np.ndarray], position: np.ndarray,
                   oil_fraction: np.ndarray) -> list[float]:
    """Covered shares of the retina and its parts by the project's rule, in percent."""
    numerics = scene.numerics
    contact = WallContact.of(initial, position, oil_fraction, particle_spacing=numerics.particle_spacing,
                             support_radius=numerics.support_ratio * numerics.particle_spacing,
                             contact_angle=scene.effects["interface_tension"].contact_angle)
    masks = contact.retina_masks()
    return [100.0 * contact.covered_share(masks[name]) for name in PARTS.values()]


def _reading(scene: Scene, initial: dict[str, np.ndarray], exact: Rest) -> list[float]:
    """What the project's rule reads of the sharp shape on the particles at the start."""
    position = initial["fluid_position"]
    return retina_covered(scene, initial, position, (depth_in_oil(exact, position) > 0.0).astype(float))


def _outcome(case: Parameters, exact: Rest, exact_s: float, reading: list[float], times: np.ndarray,
             found: np.ndarray, seconds: np.ndarray, failure: str, particles: int) -> Outcome:
    at = (f"{case.patient}, {100 * case.fill:g} %, {case.posture.replace('_', ' ')}"
          + (", from rest" if case.start == AT_REST else "")
          + ("" if case.coarser == 1.0 else f", spacing {case.coarser:g}"))
    outcome, sharp = Outcome(), shares(Contact.of(exact))
    quarter = max(len(found) // 4, 1)
    last, before = found[-quarter:].mean(axis=0), found[-2 * quarter:-quarter].mean(axis=0)
    if failure:
        last = np.full(len(PARTS), np.nan)
        outcome.remarks.append(f"{at}: ended at {times[-1]:.3g} s of {case.duration:g} s: {failure}.")
    for n, name in enumerate(PARTS):
        reference = 100.0 * sharp[name]
        outcome.rows += [
            Row(f"covered {name}", last[n], "%", at, reference, abs(last[n] - reference),
                TOLERANCE if name in ASKED else None, float(seconds[0])),
            Row(f"covered {name}, the sharp shape read on particles", reading[n], "%", at, reference,
                abs(reading[n] - reference)),
            Row(f"covered {name}, change from the third to the last quarter", last[n] - before[n], "%", at)]
    outcome.rows += [Row("particles", float(particles), at=at), Row("seconds for the sharp shape", exact_s, "s", at),
                     *time_rows((float(seconds[0]), float(seconds[1])), at=at)]
    outcome.curves.append(Curve("rest_by_simulation", at, times, found[:, 0] - 100.0 * sharp["retina"], "line"))
    return outcome


FAMILY = Family(__name__, Parameters, run, solves=solves, unnamed=("eye", "scene"), figures=FIGURES)
