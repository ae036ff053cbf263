"""A sphere (or circle) full of one liquid, whose wall turns: forth and back for ever, or once in a saccade.

The liquid moves along circles, with the same law on each in both dimensions. Seen from outside, an oscillation at the
rate w0 cos(W t) drives u = Re[w0 R j(a r/R)/j(a) exp(i W t)] sin(theta), a = exp(-i pi/4) R sqrt(W/nu), with the
spherical Bessel function j_1 (the Bessel function J_1 in a circle); |a| is the Womersley number. A saccade is a sum of
modes, each of which decays by itself while the wall accelerates it. The stress at the wall is read as in the eye.
"""
import dataclasses

import numpy as np
from scipy.optimize import brentq
from scipy.special import jn_zeros, jv, spherical_jn

from pipeline.cavity.signed_distance_grid import SignedDistance
from pipeline.measures.wall_shear import wall_shear_stress
from pipeline.studies.family import Family
from pipeline.studies.model import Curve, Figure, Outcome, Row, bounded, compared, observed_order
from sim.effects.eye_rotation import EyeRotationParameters, Oscillation, Saccade
from sim.parameters import parameter
from sim.settings import Liquid
from studies.validation.kit.tank import Run, TankParameters, advance, build, cavity, field

RADIUS = 11e-3  # m, R, that of an eye
DENSITY = 970.0  # kg/m^3
AMPLITUDE = np.radians(10.0)
MODES = 60  # of a saccade: at Womersley 10 the last one decays within a thousandth of it
AXIS = (0.0, 0.0, 1.0)
SUBSTEPS = 2000  # of the exact modes of a saccade
FIGURES = (
    Figure("turned_sphere_wall", "Root mean square stress at the wall of a turned sphere", "time / period",
           "stress (Pa)"),
    Figure("turned_sphere_error", "Error of the velocity in a turned sphere", "particle spacing / radius",
           "relative error", logarithmic=True),
)


@dataclasses.dataclass(frozen=True)
class Parameters(TankParameters):
    """A round cavity packed from disorder; resolutions count particles along the radius."""

    dimension: int = parameter(3, minimum=2, maximum=3, meaning="2 for a circle")
    motion: str = parameter("oscillation", choices=("oscillation", "saccade"), meaning="how the wall turns")
    womersley: float = parameter(2.0, exclusive_minimum=0.0,
                                 meaning="R sqrt(W/nu), W the pulsation, or pi over the duration of a saccade")
    periods: float = parameter(1.5, minimum=1.0, meaning="length of the run in periods or in durations of a saccade")
    steps: int = parameter(200, minimum=20, meaning="smallest number of time steps in a period")
    tolerance: float = parameter(0.02, exclusive_minimum=0.0,
                                 meaning="allowed error of the velocity, over the largest speed of the wall")
    stress_tolerance: float = parameter(0.05, exclusive_minimum=0.0,
                                        meaning="allowed error of the stress at the wall, over its largest value")

    @property
    def saccade(self) -> Saccade:
        """The saccade, by the main sequence."""
        return Saccade(0.0, AMPLITUDE, AXIS)

    @property
    def pulsation(self) -> float:
        """W, 1/s: a saccade and an oscillation of half a period that long are alike."""
        return np.pi / self.saccade.lasts

    @property
    def rotation(self) -> EyeRotationParameters:
        """Parameters of the effect."""
        if self.motion == "saccade":
            return EyeRotationParameters(saccades=(self.saccade,))
        return EyeRotationParameters(oscillation=Oscillation(AMPLITUDE, self.pulsation / (2.0 * np.pi), AXIS))

    @property
    def viscosity(self) -> float:
        """Kinematic viscosity, m^2/s."""
        return self.pulsation * (RADIUS / self.womersley) ** 2


def exact_solution(case: Parameters) -> "Oscillating | Turned":
    """Return the exact solution of a case."""
    if case.motion == "oscillation":
        return Oscillating(case)
    return Turned(case.saccade, case.viscosity, DENSITY, RADIUS, case.dimension)


def run(case: Parameters) -> Outcome:
    """Compare velocity and stress at the wall with the exact solution at every resolution."""
    outcome, errors = Outcome(), []
    exact = exact_solution(case)
    name = f"{case.motion}, {case.dimension}D, Womersley {case.womersley:g}"
    for resolution in case.resolutions:
        result = _turned(case, resolution, exact)
        finest = resolution == max(case.resolutions)
        late = ~(result.values("time") < (case.periods - 1.0) / case.periods * result.until)  # nan of a failed run too
        for quantity, tolerance, scale in (
                ("velocity", case.tolerance, exact.wall_speed),
                ("stress", case.stress_tolerance, np.abs(result.values("exact stress")).max())):
            error = np.sqrt(np.mean(result.values(f"{quantity} error")[late] ** 2)) / scale
            outcome.rows.append(bounded(f"error of the {quantity}", float(error), tolerance if finest else None,
                                        at=result.label, wall_s=result.wall_s))
            if quantity == "velocity":
                errors.append(float(error))
        outcome.rows += [compared("largest stress at the wall", float(result.values("stress")[late].max()),
                                  float(result.values("exact stress")[late].max()),
                                  case.stress_tolerance if finest else None, unit="Pa", at=result.label,
                                  wall_s=result.wall_s), *result.rows()]
        outcome.remarks += result.remarks(name)
    spacings = [1.0 / resolution for resolution in case.resolutions]
    outcome.rows.append(Row("observed order of the velocity", observed_order(spacings, errors)))
    outcome.curves.append(Curve("turned_sphere_error", name, spacings, errors))
    if not result.failure:
        time = result.history["time"] * case.periods / result.until
        outcome.curves += [Curve("turned_sphere_wall", name, time, result.history["stress"], "line"),
                           Curve("turned_sphere_wall", f"{name}, exact", time, result.history["exact stress"],
                                 "reference")]
    return outcome


class Oscillating:
    """Exact solution in a cavity that oscillates, seen from the wall; the start has decayed."""

    def __init__(self, case: Parameters):
        self.case = case
        self.argument = np.exp(-0.25j * np.pi) * case.womersley
        self.wall_speed = case.rotation.peak * RADIUS

    def _profile(self, share: np.ndarray, derivative: bool = False) -> np.ndarray:
        bessel = spherical_j1 if self.case.dimension == 3 else cylindrical_j1
        scale = bessel(self.argument)
        return bessel(self.argument * share, derivative) / scale * (self.argument if derivative else 1.0)

    def speed(self, radius: np.ndarray, time: float) -> np.ndarray:
        """Velocity along the circles at r (n,), over sin(theta), m/s."""
        phase = np.exp(1j * self.case.pulsation * time)
        return self.wall_speed * np.real((self._profile(radius / RADIUS) - radius / RADIUS) * phase)

    def stress(self, time: float) -> float:
        """Stress along the wall, over sin(theta), Pa: mu (du/dr - u/r), that drags the wall along."""
        phase = np.exp(1j * self.case.pulsation * time)
        slope = self.wall_speed / RADIUS * np.real((self._profile(np.ones(1), True)[0] - 1.0) * phase)
        return -DENSITY * self.case.viscosity * slope


class Turned:
    """Exact solution in a cavity that makes a saccade, seen from the wall, by its modes.

    Parameters
    ----------
    viscosity : kinematic, m^2/s.
    density : kg/m^3.
    radius : of the cavity, m.
    dimension : 3 for a sphere, 2 for a circle.
    modes : number of modes; the stress of a stiff liquid lacks a share of 1/modes.
    """

    def __init__(self, saccade: Saccade, viscosity: float, density: float, radius: float, dimension: int = 3,
                 modes: int = MODES):
        self.saccade, self.viscosity, self.density, self.radius = saccade, viscosity, density, radius
        self.wall_speed = saccade.peak * radius
        if dimension == 3:  # tan z = z
            self.zeros = np.array([brentq(lambda z: np.sin(z) - z * np.cos(z), n * np.pi, (n + 0.5) * np.pi)
                                   for n in range(1, modes + 1)])
            self.share = 2.0 * radius / (self.zeros * spherical_jn(2, self.zeros))
        else:
            self.zeros = jn_zeros(1, modes)
            self.share = 2.0 * radius / (self.zeros * jv(2, self.zeros))
        self.bessel = spherical_j1 if dimension == 3 else cylindrical_j1

    def amplitudes(self, time: float) -> np.ndarray:
        """Amplitudes of the modes at a time, (modes,): each decays, and gains what the wall turns away from it."""
        if time <= 0.0:
            return np.zeros_like(self.zeros)
        decay = self.viscosity * (self.zeros / self.radius) ** 2
        times = np.linspace(0.0, time, SUBSTEPS + 1)
        rates = np.array([self.saccade.rate(t) for t in times])
        # The wall accelerates evenly within a substep, in which the last modes decay altogether.
        left = np.exp(-np.multiply.outer(decay, time - times))
        return -self.share * (np.diff(left, axis=1) @ (np.diff(rates) / np.diff(times))) / decay

    def speed(self, radius: np.ndarray, time: float) -> np.ndarray:
        """Velocity along the circles at r (n,), over sin(theta), m/s."""
        return self.bessel(np.multiply.outer(radius / self.radius, self.zeros)).real @ self.amplitudes(time)

    def stress(self, time: float) -> float:
        """Stress along the wall, over sin(theta), Pa."""
        slope = (self.bessel(self.zeros, True).real * self.zeros / self.radius) @ self.amplitudes(time)
        return -self.density * self.viscosity * float(slope)


def spherical_j1(z: np.ndarray, derivative: bool = False) -> np.ndarray:
    """Spherical Bessel function of order 1 of complex numbers, or its derivative."""
    z = np.asarray(z, complex)
    return spherical_jn(1, z, derivative)


def cylindrical_j1(z: np.ndarray, derivative: bool = False) -> np.ndarray:
    """Bessel function of order 1 of complex numbers, or its derivative."""
    z = np.asarray(z, complex)
    return 0.5 * (jv(0, z) - jv(2, z)) if derivative else jv(1, z)


def _turned(case: Parameters, resolution: int, exact) -> Run:
    spacing = RADIUS / resolution
    arrays = cavity("sphere", RADIUS, spacing, start="packed", support_ratio=case.support_ratio,
                    dimension=case.dimension)
    period = case.saccade.lasts if case.motion == "saccade" else 2.0 * np.pi / case.pulsation
    watch = Watch(case, arrays, exact)

    def start(position: np.ndarray) -> np.ndarray:
        return watch.along(position) * (np.hypot(*position[:, :2].T) / np.linalg.norm(position, axis=1)
                                        * exact.speed(np.linalg.norm(position, axis=1), 0.0))[:, None]

    solver = build(case, arrays, effects={"viscosity_implicit": {},
                                          "eye_rotation": {f.name: getattr(case.rotation, f.name)
                                                           for f in dataclasses.fields(case.rotation)}},
                   liquids=(Liquid("liquid", DENSITY, DENSITY * case.viscosity),), velocity=start,
                   viscosity_tolerance=1e-5, maximum_time_step=period / case.steps, minimum_time_step=1e-9 * period)
    return advance(solver, case.periods * period, f"n={resolution}", watch)


class Watch:
    """Errors of velocity and stress after a step."""

    def __init__(self, case: Parameters, arrays: dict[str, np.ndarray], exact):
        self.case, self.exact, self.spacing = case, exact, float(arrays["particle_spacing"])
        self.distance = SignedDistance(arrays["sdf_values"], arrays["sdf_origin"], float(arrays["sdf_cell"]))
        self.wall = arrays["wall_position"][arrays["wall_distance"] < self.spacing]

    @staticmethod
    def along(position: np.ndarray) -> np.ndarray:
        """Unit vectors along the circles around the axis, (n, D)."""
        around = np.zeros_like(position)
        around[:, 0], around[:, 1] = -position[:, 1], position[:, 0]
        return around / np.maximum(np.hypot(*position[:, :2].T), 1e-12)[:, None]

    def __call__(self, solver) -> dict[str, float]:
        position, velocity = field(solver, "position"), field(solver, "velocity")
        radius = np.linalg.norm(position, axis=1)
        sine = np.hypot(*position[:, :2].T) / radius
        exact = (sine * self.exact.speed(radius, solver.time))[:, None] * self.along(position)
        stress = wall_shear_stress(self.wall, position, velocity,
                                   np.full(len(position), DENSITY * self.case.viscosity), self.distance, self.spacing)
        sine = np.hypot(*self.wall[:, :2].T) / np.linalg.norm(self.wall, axis=1)
        expected = (sine * self.exact.stress(solver.time))[:, None] * self.along(self.wall)
        return {"velocity error": float(np.sqrt(np.mean(np.sum((velocity - exact) ** 2, axis=1)))),
                "stress error": float(np.sqrt(np.mean(np.sum((stress - expected) ** 2, axis=1)))),
                "stress": float(np.sqrt(np.mean(np.sum(stress**2, axis=1)))),
                "exact stress": float(np.sqrt(np.mean(np.sum(expected**2, axis=1))))}


FAMILY = Family(__name__, Parameters, run, effects=("eye_rotation", "viscosity_implicit"), figures=FIGURES)
