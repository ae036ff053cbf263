"""What movements do to an eye filled with oil: saccades, a jolt of the head, and standing up, oil by oil.

Every movement begins with the oil at rest (`studies.questions.kit.resting_eye`). In saccades and in the jolt the
patient is upright; the stress on the retina and the shift of the interface are read while the movement lasts and a
little after. Standing up is slow, so that its particles may be larger and its steps longer; what is watched is the way
of the aqueous' center from where it rests in the supine patient to where it rests in the upright one. Beside the stress
in a saccade stands the exact one in a sphere of the eye's volume full of the oil.
"""
import dataclasses
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from pipeline.base.progress import progress
from pipeline.equilibrium.of_scene import rest_of
from pipeline.measures.interface_shift import InterfaceShift
from pipeline.measures.rotation_metrics import retina_shear_stress
from pipeline.planning.settings import postures
from pipeline.scenes.effects import down_at_start
from pipeline.scenes.load import project_materials
from pipeline.scenes.model import Scene
from pipeline.studies.family import Family
from pipeline.studies.model import Outcome, Row
from sim.effects.eye_rotation import EyeRotationParameters, Saccade
from sim.effects.gravity import Jolt, Turn
from sim.parameters import parameter
from studies.questions.kit.resting_eye import RestingEye
from studies.questions.kit.words import OILS
from studies.questions.moved_oil._words import (
    COURSES,
    EXACT_STRESS,
    HIGH_STRESS,
    JOLT,
    MOVEMENTS,
    SACCADES,
    SHIFT,
    STANDING_UP,
    STRESS,
    WAY_LEFT,
    time_to_make,
)
from studies.validation.turned_sphere import Turned

SCENE = "resting_eye"
SETTLE = 0.2            # s, in which the particles find their places before anything moves
AFTER = 0.05            # s, watched after a movement
READINGS = 12           # of a saccade and of a jolt
PERCENTILE = 99.0       # of the shift of the interface that is called its largest
LONGEST_STEP = 20e-3    # s, while standing up; the limit of the tension, which grows with viscosity, is smaller
WAYS = (0.5, 0.8)       # shares of the way whose times are told
MODES = 300             # of the exact stress in a sphere


@dataclasses.dataclass(frozen=True)
class Parameters:
    """One oil and one kind of movement."""

    movement: str = parameter(choices=("shaken", STANDING_UP), meaning="saccades and a jolt, or standing up")
    oil: str = parameter(choices=OILS, meaning="liquid of config/materials.yaml")
    coarser: float = parameter(1.0, minimum=0.25, maximum=2.0, meaning="particle spacing over that of the level")
    fill: float = parameter(0.85, minimum=0.5, maximum=0.98, meaning="share of the cavity that is oil")
    amplitude: float = parameter(np.radians(20.0), unit="rad", exclusive_minimum=0.0, maximum=np.radians(60.0),
                                 meaning="turn of the eye in a saccade, to the left and back")
    saccades: int = parameter(2, minimum=1, maximum=20, meaning="number of saccades")
    interval: float = parameter(0.2, unit="s", minimum=0.16, meaning="from one saccade to the next")
    acceleration: tuple[float, float, float] = parameter((0.0, 0.0, 49.05), unit="m/s**2", minimum=-200.0,
                                                         maximum=200.0, meaning="largest acceleration of the head")
    jolt_lasts: float = parameter(0.05, unit="s", exclusive_minimum=0.0, meaning="time that the jolt takes")
    turn_lasts: float = parameter(1.0, unit="s", exclusive_minimum=0.0, meaning="time that standing up takes")
    watched: float = parameter(15.0, unit="s", exclusive_minimum=0.0,
                               meaning="time watched from then on, for an oil of 1 Pa s, and in proportion to that")
    precision: str = parameter("f32", choices=("f32", "f64"), meaning="floating point format of the fields")


def solves(case: Parameters) -> str:
    """The scene that is changed."""
    return SCENE


def liquids(case: Parameters) -> tuple[str, ...]:
    """Liquids of ``config/materials.yaml`` that the case reads."""
    return (case.oil,)


def changed(case: Parameters, scene: Scene) -> Scene:
    """Return the scene with the oil and the movements of a case."""
    oil = project_materials()[case.oil]
    numerics = dataclasses.replace(scene.numerics, particle_spacing=case.coarser * scene.numerics.particle_spacing,
                                   precision=case.precision, threads=0)
    effects = dict(scene.effects)
    weight = effects["gravity"]
    if case.movement == STANDING_UP:
        numerics = dataclasses.replace(numerics, maximum_time_step=LONGEST_STEP)
        effects["gravity"] = dataclasses.replace(weight, posture="supine",
                                                 turns=(Turn(SETTLE, "upright", duration=case.turn_lasts),))
    else:
        effects["eye_rotation"] = EyeRotationParameters((saccade_of(case),))
    initial = dataclasses.replace(scene.initial, fill={case.oil: case.fill, scene.liquids[0].name: 1.0 - case.fill})
    return dataclasses.replace(scene, liquids=(scene.liquids[0], oil), initial=initial, effects=effects,
                               numerics=numerics)


def saccade_of(case: Parameters) -> Saccade:
    """The saccades, about the vertical axis of the head."""
    return Saccade(SETTLE, case.amplitude, (0.0, 1.0, 0.0), count=case.saccades, interval=case.interval)


def run(case: Parameters, scene: Scene) -> Outcome:
    """Make the movements and watch."""
    begin, cpu_begin = time.perf_counter(), time.process_time()
    scene = changed(case, scene)
    eye = RestingEye.of(scene)
    eye.fill_as(rest_of(scene, down_at_start(scene), case.fill))
    outcome = (_stood_up if case.movement == STANDING_UP else _shaken)(case, eye)
    at: dict[str, Any] = {"at": f"[{1e3 * scene.numerics.particle_spacing:g} mm]"}
    outcome.rows += [Row("particles", float(eye.solver.count[None]), **at),
                     Row("time steps", float(eye.solver.step_count), **at),
                     Row("processor time", time.process_time() - cpu_begin, "s", **at,
                         wall_s=time.perf_counter() - begin)]
    return outcome


def _heads(case: Parameters, eye: RestingEye) -> list[str]:
    """The cells that every line of the tables begins with."""
    oil = eye.scene.liquids[1]
    return [case.oil, f"{1e3 * oil.dynamic_viscosity:g}", f"{oil.density:g}",
            f"{1e3 * eye.scene.numerics.particle_spacing:g}"]


def _shaken(case: Parameters, eye: RestingEye) -> Outcome:
    """Saccades, and a jolt from the same rest."""
    solver, saccade = eye.solver, saccade_of(case)
    turning, weight = (next(effect for effect in solver.effects if effect.name == name)
                       for name in ("eye_rotation", "gravity"))
    for _ in solver.advance(SETTLE):
        pass
    rest = solver.state()
    watch = Watch(eye)
    outcome = Outcome()
    still = watch()
    times, readings = [], []
    for number in range(case.saccades):
        start = saccade.start + number * case.interval
        found = _read(solver, start, saccade.lasts, watch)
        times.append(np.array([t - start for t, *_ in found]))
        readings.append(np.array([values for _, *values in found]))
    solver.restore(rest)
    turning.parameters = dataclasses.replace(turning.parameters, saccades=(dataclasses.replace(
        saccade, start=10.0 * saccade.end),))
    weight.parameters = dataclasses.replace(weight.parameters, jolts=(
        Jolt(SETTLE, case.acceleration, case.jolt_lasts),))
    jolted = np.array([values for _, *values in _read(solver, SETTLE, case.jolt_lasts, watch)])
    peaks = np.array([one.max(axis=0) for one in readings])
    exact = _exact(case, eye)
    heads, lines, course = _heads(case, eye), [], []
    for column, (quantity, unit) in enumerate(Watch.QUANTITIES):
        middle, spread = peaks[:, column].mean(), 0.5 * np.ptp(peaks[:, column])
        lines.append([*heads, SACCADES, quantity, f"{middle:.4g}", f"{spread:.2g}", f"{still[column]:.2g}", unit])
        lines.append([*heads, JOLT, quantity, f"{jolted[:, column].max():.4g}", "", f"{still[column]:.2g}", unit])
    lines.append([*heads, SACCADES, EXACT_STRESS, f"{exact.max():.4g}", "", "", "Pa"])
    for t, values, known in zip(times[0], readings[0], exact, strict=True):
        course.append([*heads, SACCADES, f"{t:.5g}", f"{values[0]:.5g}", f"{known:.5g}"])
    outcome.tables = {"movements": [list(MOVEMENTS), *lines], "courses": [list(COURSES), *course]}
    outcome.rows += [Row(f"{line[5]}, {line[4]}", float(line[6]), line[9],
                         at=f"[{1e3 * solver.spacing:g} mm]") for line in lines]
    return outcome


def _read(solver, start: float, lasts: float, watch: "Watch") -> list[tuple[float, ...]]:
    """Times and readings of a movement and a little after."""
    ends = start + np.arange(1, round(READINGS * (lasts + AFTER) / lasts) + 1) * lasts / READINGS
    found: list[tuple[float, ...]] = []
    with progress(len(ends), f"from {start:.3g} s on") as bar:
        for end in ends:
            for _ in solver.advance(float(end)):
                pass
            found.append((solver.time, *watch()))
            bar.update(1)
    return found


class Watch:
    """Reads stress and interface of an eye; the interface is compared with that at the time it was made."""

    QUANTITIES = ((STRESS, "Pa"), (HIGH_STRESS, "Pa"), (SHIFT, "mm"))

    def __init__(self, eye: RestingEye):
        self.eye = eye
        state = eye.measured()
        self.shift = InterfaceShift(state.distance, state.frame.particle_spacing, state.support_radius,
                                    *self._particles(state))

    @staticmethod
    def _particles(state) -> Iterator[np.ndarray]:
        return (values.astype(float) for values in (state.frame.position, state.frame.volume, state.oil_fraction))

    def __call__(self) -> tuple[float, float, float]:
        state = self.eye.measured()
        stress = retina_shear_stress(state)
        shift = np.abs(self.shift.of(*self._particles(state)))
        return stress["mean"], stress["high"], 1e3 * float(np.percentile(shift, PERCENTILE))


def _exact(case: Parameters, eye: RestingEye) -> np.ndarray:
    """Mean stress on the wall of a sphere full of the oil at the times of the readings of a saccade, Pa."""
    oil, saccade = eye.scene.liquids[1], dataclasses.replace(saccade_of(case), start=0.0, count=1)
    radius = (3.0 * eye.solver.cavity_volume / (4.0 * np.pi)) ** (1.0 / 3.0)
    exact = Turned(saccade, oil.dynamic_viscosity / oil.density, oil.density, radius, modes=MODES)
    count = round(READINGS * (saccade.lasts + AFTER) / saccade.lasts)
    return np.array([0.25 * np.pi * abs(exact.stress(n * saccade.lasts / READINGS)) for n in range(1, count + 1)])


def _stood_up(case: Parameters, eye: RestingEye) -> Outcome:
    """Follow the center of the aqueous from where it rests lying to where it rests standing."""
    solver, scene = eye.solver, eye.scene
    lying, standing = (rest_of(scene, postures()[posture], case.fill).other.center for posture in ("supine", "upright"))
    slower = scene.liquids[1].dynamic_viscosity
    ends = SETTLE + np.concatenate([np.linspace(0.0, case.turn_lasts, 9)[1:],
                                    case.turn_lasts + np.linspace(0.0, case.watched * slower, 181)[1:]])
    times, left = [0.0], [1.0]
    with progress(len(ends), "standing up") as bar:
        for _ in solver.advance(SETTLE):
            pass
        for end in ends:
            for _ in solver.advance(float(end)):
                pass
            center = _center(solver)
            times.append(solver.time - SETTLE)
            left.append(float(np.linalg.norm(center - standing) / np.linalg.norm(lying - standing)))
            bar.update(1)
    heads, made = _heads(case, eye), 1.0 - np.array(left)
    lines = [[*heads, STANDING_UP, time_to_make(way), _number(time_of(times, made, way)), "", "", "s"]
             for way in WAYS]
    lines.append([*heads, STANDING_UP, WAY_LEFT, f"{100 * made[-1]:.4g}", "", "", "%"])
    course = [[*heads, STANDING_UP, f"{t:.5g}", f"{100 * way:.5g}", ""] for t, way in zip(times, made, strict=True)]
    outcome = Outcome(tables={"movements": [list(MOVEMENTS), *lines], "courses": [list(COURSES), *course]})
    outcome.rows += [Row(f"{line[5]}, {line[4]}", float(line[6] or "nan"), line[9], at=f"[{1e3 * solver.spacing:g} mm]")
                     for line in lines]
    return outcome


def _center(solver) -> np.ndarray:
    """Center of the aqueous, (3,), m."""
    aqueous = solver.particles.to_numpy("phase") == 0
    volume, position = (solver.particles.to_numpy(name).astype(float)[aqueous] for name in ("volume", "position"))
    return volume @ position / volume.sum()


def _number(value: float) -> str:
    return f"{value:.4g}" if np.isfinite(value) else ""


def time_of(times, made, way: float) -> float:
    """Time at which a share of the way is made and kept, between readings; nan if it is not."""
    times, made = np.asarray(times), np.asarray(made)
    late = np.flatnonzero(made < way)
    last = late[-1] if len(late) else 0
    if last + 1 >= len(made):
        return np.nan
    share = (way - made[last]) / (made[last + 1] - made[last])
    return float(times[last] + share * (times[last + 1] - times[last]))


FAMILY = Family(__name__, Parameters, run, solves=solves, liquids=liquids, unnamed=("watched", "saccades"))
