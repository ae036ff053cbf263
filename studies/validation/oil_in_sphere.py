"""Oil in a sphere of water at rest, where tension, weight and contact angle set the shape.

From a flat interface the run goes to rest; the arc of the wall that the oil touches, the height of the interface on the
axis and the covered share of the wall are compared with the equations of Young and Laplace
(`studies.validation.kit.young_laplace`). What is at rest does not depend on viscosity, which only has to let the
liquids come to rest soon. Early agreement is no equilibrium: runs pass the reference on their way, so the history is
drawn, and what is compared is the mean of its last fifth.

Arc and angle come from the curve of Young and Laplace, with curvature and height free, that parts the particles of the
two liquids best. The curve that fits the interface points of the tension best, without what lies within half a spacing
of the wall, is read beside it; at 18 degrees a tenth of a spacing turns the angle by two degrees. The covered share of
the wall is that of the metrics (`pipeline.measures.coverage`). Every operator is also applied to particles that are
labelled by the exact shape, which shows what it reads wrong.
"""
import dataclasses
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from pipeline.measures.coverage import WallContact
from pipeline.studies.family import Family, Headline
from pipeline.studies.model import Curve, Figure, Outcome, Row, bounded
from sim.parameters import parameter
from sim.settings import Liquid
from studies.validation.kit.interface_fit import part
from studies.validation.kit.tank import PackedParameters, Run, advance, build, cavity, field
from studies.validation.kit.young_laplace import Profile, covered_arc, distance_to, interface, oil_at_rest

GRAVITY = 9.81
WATER = 1005.0  # kg/m^3
READINGS = 30  # of the history
COVERAGE_TOLERANCE = 0.02  # of the covered share of the wall: two points of what is read from an eye
MIXED_TOLERANCE = 0.01  # of the particles near the interface; those of another color behind it are left behind
LATE = 0.2  # share of the run whose mean is compared
NEAR_WALL = 0.5  # contour closer to the wall than this, in particle spacings, is not fitted
FIT_POINTS, FIT_STEPS = 250, 60
FIT_STARTS = (-3.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 3.0, 5.0)  # curvatures on the axis tried, over 1/R
FIT_DIFFERENCE = 1e-4  # of the unknown, over its size
ROBUST = 0.3  # distance, in spacings, from which a point counts for less: droplets left on the wall
FIGURES = (
    Figure("oil_in_sphere_arc", "Arc of contact on the way to rest", "time steps", "arc less reference, deg"),
    Figure("oil_in_sphere_apex", "Height of the interface on the axis", "time steps", "(apex less reference) / dx"),
    Figure("oil_in_sphere_coverage", "Wall that the oil covers", "time steps",
           "covered share less that of ideal labels"),
    Figure("oil_in_sphere_profile", "Interface at the end, points fitted", "r / R", "z / R"),
)


@dataclasses.dataclass(frozen=True)
class Parameters(PackedParameters):
    """Oil in a sphere or circle full of water."""

    dimension: int = parameter(3, choices=(2, 3), meaning="a circle or a sphere")
    fill: float = parameter(0.8, exclusive_minimum=0.0, maximum=0.99, meaning="share of the cavity that is oil")
    contact_angle: float = parameter(18.2, unit="deg", minimum=0.0, maximum=180.0,
                                     meaning="contact angle through the water")
    density_difference: float = parameter(-35.0, unit="kg/m**3", minimum=-500.0, maximum=500.0,
                                          meaning="density of the oil less that of water; heavy oil sinks")
    tension: float = parameter(0.04, unit="N/m", exclusive_minimum=0.0, meaning="interface tension")
    oil_viscosity: float = parameter(0.1, unit="Pa*s", minimum=0.0, meaning="viscosity of the oil")
    water_viscosity: float = parameter(0.1, unit="Pa*s", minimum=0.0, meaning="viscosity of the water")
    radius: float = parameter(0.011, unit="m", exclusive_minimum=0.0, meaning="radius of the cavity")
    steps: int = parameter(5000, minimum=50, meaning="time steps at least")
    duration: float | None = parameter(None, unit="s", exclusive_minimum=0.0,
                                       meaning="simulated time in place of so many steps")
    resolutions: tuple[int, ...] = parameter((11,), minimum=6, meaning="particles along the radius, coarse to fine")
    # Gravity in full never acts: the limit of the tension is what counts.
    largest_step: float = parameter(0.2, exclusive_minimum=0.0, meaning="largest time step in sqrt(spacing / g)")
    arc_tolerance: float = parameter(5.0, unit="deg", exclusive_minimum=0.0, meaning="allowed error of the arc")


@dataclasses.dataclass(frozen=True)
class Reading:
    """What is read from a solver.

    Attributes
    ----------
    arc, angle, apex : arc and angle of contact, deg, and apex, m, of the curve that parts the particles.
    mixed : share of the particles near that curve that are on the wrong side.
    contour_arc, contour_angle, contour_apex, misfit : of the curve that fits the level set, and the root mean square
        distance between them, in particle spacings.
    coverage : covered share of the wall. speed : root mean square, m/s.
    """

    arc: float
    angle: float
    apex: float
    mixed: float
    contour_arc: float
    contour_angle: float
    contour_apex: float
    misfit: float
    coverage: float
    speed: float


def run(case: Parameters) -> Outcome:
    """Run to rest at every resolution and compare with the shape of Young and Laplace."""
    outcome = Outcome()
    exact = oil_at_rest(case.fill, np.radians(case.contact_angle), _capillary_constant(case), case.radius,
                        case.dimension)
    name = (f"{case.dimension}D {case.contact_angle:g} deg fill {case.fill:g}"
            + (" heavy" if case.density_difference > 0.0 else "") + f" seed {case.seed}")
    for resolution in case.resolutions:
        result, ideal = rest(case, exact, resolution)
        outcome.rows += _rows(case, exact, ideal, result)
        outcome.remarks += result.remarks(name)
        if not result.failure:
            outcome.curves += _curves(case, exact, ideal, result, f"{name} {result.label}")
    return outcome


def rest(case: Parameters, exact: Profile, resolution: int) -> tuple[Run, Reading]:
    """Run to rest from a flat interface; also return what is read from ideally labelled particles."""
    spacing = case.radius / resolution
    arrays = cavity("circle", case.radius, spacing, start="packed", support_ratio=case.support_ratio,
                    dimension=case.dimension, seed=case.seed)
    ideal = _ideal(case, exact, arrays)
    solver = _build(case, arrays, lambda x: _flat(case, x))
    tension = next(effect for effect in solver.effects if effect.name == "interface_tension")
    step = min(tension.stable_time_step(), solver.settings.numerics.maximum_time_step)
    steps = case.steps if case.duration is None else max(1, round(case.duration / step))
    return advance(solver, steps * step, f"R/dx={resolution}", _watch(case, arrays, steps)), ideal


def _capillary_constant(case: Parameters) -> float:
    return abs(case.density_difference) * GRAVITY / case.tension


def _up(case: Parameters) -> float:
    """Direction towards which the oil goes, along y."""
    return 1.0 if case.density_difference <= 0.0 else -1.0


def _flat(case: Parameters, position: np.ndarray) -> np.ndarray:
    """Label the particles above (heavy oil: below) a level so that the fill is met."""
    phase = np.zeros(len(position))
    phase[np.argsort(-_up(case) * position[:, 1], kind="stable")[: round(case.fill * len(position))]] = 1
    return phase


def _build(case: Parameters, arrays, phase):
    liquids = (Liquid("water", WATER, case.water_viscosity),
               Liquid("oil", WATER + case.density_difference, case.oil_viscosity))
    effects = {"gravity": {"magnitude": GRAVITY}, "viscosity_implicit": {},
               "interface_tension": {"coefficient": case.tension, "contact_angle": np.radians(case.contact_angle)}}
    return build(case, arrays, liquids=liquids, effects=effects, phase=phase,
                 maximum_time_step=case.largest_step * np.sqrt(float(arrays["particle_spacing"]) / GRAVITY))


def _ideal(case: Parameters, exact: Profile, arrays) -> Reading:
    """Read particles at their start that are labelled by the exact shape."""
    upright = np.ones(case.dimension)
    upright[1] = _up(case)
    solver = _build(case, arrays, lambda x: exact.is_oil(upright * x))
    for _ in range(10):  # the level set behind the wall follows that of the update before
        solver.prepare_output()
    return read(case, solver, arrays)


def _watch(case: Parameters, arrays, steps: int):
    """Return a function that reads the solver :data:`READINGS` times in so many steps and repeats itself in between."""
    last: dict[str, float] = {}

    def watch(solver) -> dict[str, float]:
        if not last:
            solver.prepare_output()
        if not last or solver.step_count % max(1, steps // READINGS) == 0:
            last.update(dataclasses.asdict(read(case, solver, arrays)))
        return dict(last)

    return watch


def read(case: Parameters, solver, arrays) -> Reading:
    """Read arc, angle, apex and coverage of the present state."""
    position, phase, velocity = (field(solver, name) for name in ("position", "phase", "velocity"))
    contact = WallContact.of(arrays, position, phase, particle_spacing=solver.spacing,
                             support_radius=solver.support_radius, contact_angle=np.radians(case.contact_angle))
    speed = float(np.sqrt((velocity**2).sum(axis=1).mean()))
    r, z = contour(case, solver)
    if len(r) < 5:
        nothing = [np.nan] * 8 + [contact.covered_share(), speed]
        return Reading(*nothing)
    curves = Curves(_capillary_constant(case), case.radius, case.dimension, solver.spacing)
    unknown, misfit = fit(curves, r, z)
    from_axis = np.linalg.norm(np.delete(position, 1, axis=1), axis=1)
    parting, mixed = parted(curves, from_axis, _up(case) * position[:, 1], phase > 0.5, unknown)
    return Reading(*curves.contact(parting), mixed, *curves.contact(unknown), misfit, contact.covered_share(), speed)


def contour(case: Parameters, solver) -> tuple[np.ndarray, np.ndarray]:
    """Return distance from the axis and height towards the oil's pole of the interface away from the wall, m."""
    tension = next(effect for effect in solver.effects if effect.name == "interface_tension")
    point = tension.point.to_numpy()[: tension.point_count[None]].astype(float)
    point = point[solver.distance.at(point) < -NEAR_WALL * solver.spacing]
    return np.linalg.norm(np.delete(point, 1, axis=1), axis=1), _up(case) * point[:, 1]


@dataclasses.dataclass(frozen=True)
class Curves:
    """Profiles of one capillary constant; unknown are (curvature x radius, height / radius) on the axis."""

    capillary_constant: float
    radius: float
    dimension: int
    spacing: float

    def of(self, curvature):
        """Return r, z and inclination of the profiles, (n, k), with z zero on the axis, m and rad."""
        b = np.asarray(curvature)
        length = self.radius * np.minimum(3.2, 1.2 * np.pi * self.dimension / np.maximum(np.abs(b), 1e-9))
        return interface(b / self.radius, self.capillary_constant, self.dimension, length, FIT_STEPS)

    def distances(self, r, z, curvature, heights) -> list[np.ndarray]:
        """Distances in spacings, positive above, from every profile at its height; beyond the wall it is straight."""
        found = []
        r_curves, z_curves, slopes = self.of(curvature)
        for r_curve, z_curve, phi, height in zip(r_curves.T, z_curves.T, slopes.T, heights, strict=True):
            z_curve = z_curve + height * self.radius
            end = np.argmax(np.append(np.hypot(r_curve, z_curve)[:-1] > self.radius, True))
            beyond = 5.0 * self.spacing
            r_all = np.append(r_curve[: end + 1], r_curve[end] + beyond * np.cos(phi[end]))
            z_all = np.append(z_curve[: end + 1], z_curve[end] + beyond * np.sin(phi[end]))
            found.append(distance_to(r, z, r_all, z_all) / self.spacing)
        return found

    def contact(self, unknown) -> tuple[float, float, float]:
        """Arc and angle, deg, where the profile first meets the wall (nan where it does not), and apex, m."""
        r, z, phi = (column[:, 0] for column in self.of(unknown[:1]))
        z = z + unknown[1] * self.radius
        miss = np.hypot(r, z) - self.radius
        ends = np.flatnonzero((miss[:-1] < 0.0) & (miss[1:] >= 0.0))
        apex = float(unknown[1] * self.radius)
        if not len(ends):
            return np.nan, np.nan, apex
        n = ends[0]
        t = miss[n] / (miss[n] - miss[n + 1])
        r_end, z_end, phi_end = ((1.0 - t) * values[n] + t * values[n + 1] for values in (r, z, phi))
        beta = np.arctan2(r_end, -z_end)
        return float(360.0 - 2.0 * np.degrees(beta)), float(np.degrees(beta - phi_end)), apex


def parted(curves: Curves, r, z, is_oil, start) -> tuple[np.ndarray, float]:
    """Find the profile that parts oil from water best, from a start; see `studies.validation.kit.interface_fit`."""
    return part(lambda unknown, chosen: curves.distances(r[chosen], z[chosen], unknown[:1], unknown[1:])[0],
                np.where(is_oil, 1.0, -1.0), start, np.array([0.3, 0.03]))


def fit(curves: Curves, r, z) -> tuple[np.ndarray, float]:
    """Fit a profile to points of an interface: the unknown of `Curves`, and the distance left, in spacings."""
    some = np.linspace(0, len(r) - 1, min(len(r), FIT_POINTS)).astype(int)
    r, z = r[some], z[some]
    low = z[np.argsort(r)[: max(3, len(r) // 20)]].mean() / curves.radius
    first = curves.distances(r, z, FIT_STARTS, [low] * len(FIT_STARTS))
    promising = np.argsort([np.median(np.abs(one)) for one in first])[:3]
    return min((_refined(curves, r, z, np.array([FIT_STARTS[k], low])) for k in promising), key=lambda one: one[1])


def _refined(curves: Curves, r, z, unknown: np.ndarray) -> tuple[np.ndarray, float]:
    """Improve curvature and height by least squares with Cauchy's weights; return also how far points are."""
    def distances(unknown):
        return curves.distances(r, z, unknown[:1], unknown[1:])[0]

    best = least_squares(distances, unknown, diff_step=FIT_DIFFERENCE, loss="cauchy", f_scale=ROBUST).x
    here = distances(best)
    return best, float(np.sqrt(np.average(here**2, weights=1.0 / (1.0 + (here / ROBUST) ** 2))))


def _late(result: Run, name: str) -> np.ndarray:
    """What was read in the last part of the run."""
    if result.failure:
        return np.array([np.nan])
    return result.history[name][result.history["time"] > (1.0 - LATE) * result.until]


def _rows(case: Parameters, exact: Profile, ideal: Reading, result: Run) -> list[Row]:
    spacing = result.solver.spacing
    common: dict[str, Any] = {"at": result.label, "wall_s": result.wall_s}
    mean = {name: float(_late(result, name).mean()) for name in result.history}
    half = _late(result, "arc")
    drift = abs(float(half[len(half) // 2:].mean() - half[: max(1, len(half) // 2)].mean()))
    capillary = max(case.oil_viscosity, case.water_viscosity) * mean["speed"] / case.tension
    apex = exact.apex / spacing

    def beside(quantity, value, reference, tolerance=None, unit="1"):
        return Row(quantity, value, unit, reference=reference, error=abs(value - reference), tolerance=tolerance,
                   **common)

    return [beside("arc of contact", mean["arc"], exact.arc, case.arc_tolerance, "deg"),
            beside("height on the axis / spacing", mean["apex"] / spacing, apex, 1.0),
            beside("contact angle", mean["angle"], case.contact_angle, None, "deg"),
            beside("covered share of the wall, against ideal labels", mean["coverage"], ideal.coverage),
            beside("covered arc of the wall, against ideal labels", covered_arc(mean["coverage"], case.dimension),
                   covered_arc(ideal.coverage, case.dimension), None, "deg"),
            beside("covered share of the wall", mean["coverage"], exact.coverage, COVERAGE_TOLERANCE),
            beside("covered share of the wall of ideal labels", ideal.coverage, exact.coverage),
            beside("arc of contact of ideal labels", ideal.arc, exact.arc, None, "deg"),
            beside("height on the axis of ideal labels / spacing", ideal.apex / spacing, apex),
            beside("arc of the level set", mean["contour_arc"], exact.arc, None, "deg"),
            beside("arc of the level set of ideal labels", ideal.contour_arc, exact.arc, None, "deg"),
            bounded("share of particles near the interface on the wrong side", mean["mixed"], MIXED_TOLERANCE,
                    **common),
            bounded("drift of the arc over the last tenth", drift, 1.0, "deg", **common),
            Row("viscosity x rms speed / tension at the end", capillary, **common), *result.rows()]


def _curves(case: Parameters, exact: Profile, ideal: Reading, result: Run, name: str) -> list[Curve]:
    shown = slice(None, None, max(1, len(result.history["time"]) // READINGS))
    steps = np.arange(len(result.history["time"]))[shown]
    arc, apex, coverage = (result.history[key][shown] for key in ("arc", "apex", "coverage"))
    curves = [Curve("oil_in_sphere_arc", name, steps, arc - exact.arc, "line"),
              Curve("oil_in_sphere_apex", name, steps, (apex - exact.apex) / result.solver.spacing, "line"),
              Curve("oil_in_sphere_coverage", name, steps, coverage - ideal.coverage, "line")]
    r, z = contour(case, result.solver)
    some = slice(None, None, max(1, len(r) // 150))
    return [*curves, Curve("oil_in_sphere_profile", name, r[some] / case.radius, z[some] / case.radius),
            Curve("oil_in_sphere_profile", f"exact {case.dimension}D {case.contact_angle:g} deg fill {case.fill:g}",
                  exact.r / case.radius, exact.z / case.radius, "reference")]


FAMILY = Family(__name__, Parameters, run, effects=("gravity", "viscosity_implicit", "interface_tension"),
                figures=FIGURES, headline=Headline("arc of contact", 0.5))
