"""How many droplets saccades tear off the oil, by oil, tension, movement and fill, and where they gather, by posture.

The law is that of `sim.effects.contact_line_emulsification` (M7): per length of the contact line, a thread of droplets
for every saccade. The contact line is the exact one of oil at rest (`pipeline.equilibrium`), so no particle is
simulated; with `particles` the line of the effect itself is measured beside, on the particles of the eye.

Droplets rise as long as they can: along gravity through the aqueous, then along oil or wall (heavy oil: they sink).
Tracers follow that way in steps, from where the droplets are torn off. Equations: docs/methods/mixtures.md.
"""
import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from pipeline.cavity.rays import interpolation
from pipeline.equilibrium.contact import Contact
from pipeline.equilibrium.of_scene import rest_of
from pipeline.equilibrium.rest import Rest
from pipeline.planning.settings import postures
from pipeline.scenes.load import project_materials
from pipeline.scenes.model import Scene
from pipeline.studies.family import Family
from pipeline.studies.model import Outcome, Row, compared
from sim.effects.contact_line_emulsification import (
    ContactLineEmulsificationParameters,
    shear_per_distance,
    volume_per_shear,
)
from sim.parameters import parameter
from studies.questions.kit.resting_eye import RestingEye
from studies.questions.kit.words import OILS
from studies.questions.shed_droplets._words import (
    BASE,
    FILL,
    GATHERED,
    LINE_BY_PARTICLES,
    MOVEMENT,
    OIL,
    POSTURE,
    SHED,
    TENSION,
    TRACERS,
)

SCENE = "emulsification_contact_line"
WEEK = 7.0 * 86400.0        # s
STEP = 3e-4                 # m, of a tracer
TRACED = 400                # tracers of a posture
LONGEST_WAY = 400           # steps of a tracer
STUCK = 0.02                # of a step, that a tracer gains in height: less, and it has arrived
CLOSED, THIN = 1e-4, 5e-4   # m, between oil and wall: droplets go no farther into the wedge; they begin up to here
TILTS = (0.8, 1.4)          # rad, of steps aslant
WAYS = 12                   # directions of these
PLACES = ("before the equator", "superior half", "inferior half", "retina behind the equator")


@dataclasses.dataclass(frozen=True)
class Parameters:
    """The eye as it is by default, and what is changed, one thing at a time."""

    oil: str = parameter("silicone_oil_1000", choices=OILS, meaning="oil by default")
    tension: float = parameter(0.04, unit="N/m", exclusive_minimum=0.0, maximum=0.1, meaning="tension by default")
    amplitude: float = parameter(np.radians(10.0), unit="rad", exclusive_minimum=0.0, maximum=np.radians(60.0),
                                 meaning="saccade by default")
    fill: float = parameter(0.85, minimum=0.5, maximum=0.98, meaning="fill by default")
    contact_angles: tuple[float, ...] = parameter((18.2, 10.0, 25.0), unit="deg", minimum=5.0, maximum=45.0,
                                                  meaning="contact angle, and others that are possible too")
    oils: tuple[str, ...] = parameter(OILS, choices=OILS, meaning="oils")
    tensions: tuple[float, ...] = parameter((0.04, 0.025, 0.015), unit="N/m", exclusive_minimum=0.0, maximum=0.1,
                                            meaning="tensions, down to those with proteins")
    amplitudes: tuple[float, ...] = parameter(tuple(np.radians((5.0, 10.0, 20.0, 40.0))), unit="rad",
                                              exclusive_minimum=0.0, maximum=np.radians(60.0), meaning="saccades")
    fills: tuple[float, ...] = parameter((0.7, 0.8, 0.85, 0.9, 0.95), minimum=0.5, maximum=0.98, meaning="fills")
    postures: tuple[str, ...] = parameter(("upright", "supine", "prone", "left_side"),
                                          choices=("upright", "supine", "prone", "left_side", "right_side"),
                                          meaning="postures of the patient")
    particles: bool = parameter(False, meaning="measure the contact line on particles too, and nothing else")
    precision: str = parameter("f64", choices=("f32", "f64"), meaning="floating point format of the fields")


def solves(case: Parameters) -> str:
    """The scene with the effect."""
    return SCENE


def liquids(case: Parameters) -> tuple[str, ...]:
    """Liquids of ``config/materials.yaml`` that the case reads."""
    return (case.oil, *case.oils)


def run(case: Parameters, scene: Scene) -> Outcome:
    """Change one thing at a time; or measure the line on particles."""
    return _by_particles(case, scene) if case.particles else Study(case, scene).outcome()


class Study:
    """Evaluates the law on shapes at rest."""

    def __init__(self, case: Parameters, scene: Scene):
        self.case, self.scene = case, scene
        self.materials = project_materials()
        self._shapes: dict[tuple, Rest] = {}

    def outcome(self) -> Outcome:
        """Return all lines of both tables."""
        case, outcome = self.case, Outcome()
        changes: list[tuple[str, str, dict[str, Any]]] = [(BASE, "as by default", {})]
        changes += [(OIL, oil, {"oil": oil}) for oil in case.oils]
        changes += [(TENSION, f"{1e3 * tension:g} mN/m", {"tension": tension}) for tension in case.tensions]
        changes += [(MOVEMENT, f"{np.degrees(size):g} degrees", {"amplitude": size}) for size in case.amplitudes]
        changes += [(FILL, f"{100 * fill:g} %", {"fill": fill}) for fill in case.fills]
        changes += [(POSTURE, posture, {"posture": posture}) for posture in case.postures]
        lines = []
        for factor, setting, changed in changes:
            shed, lengths = np.transpose([self.shed(angle=angle, **changed) for angle in case.contact_angles])
            lines.append([factor, setting, f"{1e3 * lengths[0]:.4g}",
                          *(f"{1e6 * value * WEEK:.4g}" for value in (shed[0], shed.min(), shed.max()))])
            outcome.rows.append(Row("droplets shed in a week / cavity", 1e6 * shed[0] * WEEK, "ppm",
                                    at=f"{factor}, {setting}"))
        gathered, tracers = [], []
        for posture in case.postures:
            ends = self.gathered(posture)
            gathered.append([posture, *(f"{100.0 * mask.mean():.1f}" for mask in places_of(ends)),
                             *(f"{1e3 * value:.1f}" for value in np.median(ends, axis=0))])
            tracers += [[posture, *(f"{1e3 * value:.3f}" for value in end)] for end in ends]
        outcome.tables = {"shed": [list(SHED), *lines], "gathered": [["posture", *PLACES, *GATHERED], *gathered],
                          "tracers": [list(TRACERS), *tracers]}
        outcome.tables["sections"] = [["posture", "what", "y [mm]", "z [mm]"], *(
            [posture, what, f"{1e3 * y:.3f}", f"{1e3 * z:.3f}"] for posture in case.postures
            for what, points in self.section(posture) for y, z in points)]
        return outcome

    def rest(self, oil: str = "", tension: float = 0.0, fill: float = 0.0, posture: str = "upright",
             angle: float = 0.0, **_) -> Rest:
        """The shape at rest; what is not given is as by default."""
        case = self.case
        oil, tension, fill, angle = (oil or case.oil, tension or case.tension, fill or case.fill,
                                     angle or case.contact_angles[0])
        density = self.materials[oil].density
        key = (density, tension, fill, posture, angle)
        if key not in self._shapes:
            pull = dataclasses.replace(self.scene.effects["interface_tension"], coefficient=tension,
                                       contact_angle=np.radians(angle))
            liquids = (self.scene.liquids[0], self.materials[oil])
            self._shapes[key] = rest_of(dataclasses.replace(
                self.scene, liquids=liquids, effects=self.scene.effects | {"interface_tension": pull}),
                                        postures()[posture], fill)
        return self._shapes[key]

    def shed(self, **changed) -> tuple[float, float]:
        """Volume torn off over that of the cavity, 1/s, and length of the contact line, m."""
        case, rest = self.case, self.rest(**changed)
        oil = self.materials[changed.get("oil", case.oil)]
        aqueous, amplitude = self.scene.liquids[0], changed.get("amplitude", case.amplitude)
        law = dataclasses.replace(self.law, interface_tension=changed.get("tension", case.tension),
                                  saccade_amplitude=amplitude, time_lapse=1.0)
        middle, length = line_of(rest)
        rate = volume_per_shear(law, oil, aqueous) * shear_per_distance(amplitude, aqueous)
        return rate * float(length @ self._away(middle)) / rest.cavity.volume, float(length.sum())

    @property
    def law(self) -> ContactLineEmulsificationParameters:
        """Parameters of the law."""
        return self.scene.effects["contact_line_emulsification"]

    def gathered(self, posture: str) -> np.ndarray:
        """Where tracers of droplets end, (k, 3), m; they begin in the wedge at the contact line."""
        rest = self.rest(posture=posture)
        place, gap = _between(rest, rest.other.position)
        wedge = np.flatnonzero((gap > CLOSED) & (gap < THIN))
        weight = rest.other.volume[wedge] / gap[wedge] * self._away(place[wedge])
        chosen = np.random.default_rng(0).choice(wedge, TRACED, p=weight / weight.sum())
        rises = self.materials[self.case.oil].density < self.scene.liquids[0].density
        return risen(rest, place[chosen], postures()[posture] * (-1.0 if rises else 1.0))

    def _away(self, points: np.ndarray) -> np.ndarray:
        """Distances (k,) of points (k, 3) from the axis of the saccades, m."""
        axis = np.array(self.law.saccade_axis) / np.linalg.norm(self.law.saccade_axis)
        return np.linalg.norm(points - (points @ axis)[:, None] * axis, axis=1)

    def section(self, posture: str) -> list[tuple[str, np.ndarray]]:
        """Outlines of wall and oil in the plane x = 0: (y, z) in m."""
        rest = self.rest(posture=posture)
        angle = np.linspace(0.0, 2.0 * np.pi, 241)
        direction = np.stack([np.zeros_like(angle), np.sin(angle), np.cos(angle)], axis=1)
        return [(what, (rest.cavity.viewpoint + along(rest, values, direction)[:, None] * direction)[:, 1:])
                for what, values in (("wall", rest.cavity.radius), ("oil", rest.distance))]


def line_of(rest: Rest) -> tuple[np.ndarray, np.ndarray]:
    """Middles (k, 3) and lengths (k,) of the segments of the contact line, m."""
    line = Contact.of(rest).line
    return line.mean(axis=1), np.linalg.norm(line[:, 1] - line[:, 0], axis=1)


def along(rest: Rest, values: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Values (..., n) of the directions of a cavity in other directions (k, 3), (..., k)."""
    cavity = rest.cavity
    corners, weights = interpolation(cavity.wall - cavity.viewpoint, cavity.faces, direction)
    return (values[..., corners] * weights).sum(axis=-1)


def risen(rest: Rest, start: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Where droplets end that start at points (k, 3), m, and go up (3,) in the other liquid as far as they can.

    A step goes straight up, or aslant where oil or wall are in the way; none goes to where the oil touches the wall.
    """
    place, moving = _between(rest, start)[0], np.arange(len(start))
    ways = _ways(up)
    for _ in range(LONGEST_WAY):
        tried, gap = _between(rest, (place[moving, None] + STEP * ways).reshape(-1, 3))
        tried = tried.reshape(len(moving), len(ways), 3)
        gain = np.where(gap.reshape(len(moving), -1) > CLOSED, (tried - place[moving, None]) @ up, -1.0)
        best = gain.argmax(axis=1)
        goes = gain[np.arange(len(moving)), best] > STUCK * STEP
        place[moving[goes]] = tried[np.arange(len(moving)), best][goes]
        moving = moving[goes]
        if not len(moving):
            break
    return place


def _ways(up: np.ndarray) -> np.ndarray:
    """Unit vectors (w, 3) of the upper half of all directions, the first straight up (3,)."""
    side = np.cross(up, (1.0, 0.0, 0.0) if abs(up[0]) < 0.9 else (0.0, 1.0, 0.0))
    side /= np.linalg.norm(side)
    other = np.cross(up, side)
    around = 2.0 * np.pi * np.arange(WAYS) / WAYS
    flat = np.cos(around)[:, None] * side + np.sin(around)[:, None] * other
    return np.concatenate([up[None], *(np.cos(tilt) * up + np.sin(tilt) * flat for tilt in TILTS)])


def _between(rest: Rest, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (k, 3), moved along the ray from the viewpoint to between oil and wall, and the gap there (k,), m."""
    arm = points - rest.cavity.viewpoint
    distance = np.linalg.norm(arm, axis=1)
    direction = arm / distance[:, None]
    oil, wall = along(rest, np.stack([rest.distance, rest.cavity.radius]), direction)
    kept = np.minimum(np.maximum(distance, oil), wall)
    return rest.cavity.viewpoint + kept[:, None] * direction, wall - oil


def places_of(ends: np.ndarray) -> Sequence[np.ndarray]:
    """Which points (k, 3) are in every one of ``PLACES``."""
    y, z = ends[:, 1], ends[:, 2]
    return z > 0.0, y > 0.0, y < 0.0, z < 0.0


def _by_particles(case: Parameters, scene: Scene) -> Outcome:
    """The length of the contact line as the effect measures it on particles, beside that of the shape."""
    numerics = dataclasses.replace(scene.numerics, precision=case.precision, threads=0)
    eye = RestingEye.of(dataclasses.replace(scene, numerics=numerics))
    rest = rest_of(scene, postures()["upright"], case.fill)
    eye.fill_as(rest)
    effect = next(effect for effect in eye.solver.effects if effect.name == "contact_line_emulsification")
    exact = float(line_of(rest)[1].sum())
    row = compared(LINE_BY_PARTICLES, effect.contact_line_length(), exact, None, "m",
                   at=f"[{1e3 * scene.numerics.particle_spacing:g} mm]")
    return Outcome(rows=[row])


FAMILY = Family(__name__, Parameters, run, solves=solves, liquids=liquids, unnamed=("precision",))
