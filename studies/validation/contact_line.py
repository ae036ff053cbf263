"""How fast oil leaves a wall: the contact line of oil in a circle or sphere, from a level interface towards rest.

Oil and aqueous start level in a circle or sphere, and the aqueous climbs the wall until the interface has the contact
angle; or they start with the shape of rest of a smaller angle, and the aqueous leaves the wall. Where viscosity and
tension alone hold the line, Cox's theory (1986) tells its speed from the angle that the interface has seen from afar,
beyond the corner in which it bends (``sim.effects.parts.contact_line``):

    U = sigma/(mu ln(R/r_s)) (g(theta) - g(theta_e)), dg/dtheta = 1/f

with the length r_s = 1 nm on which molecules slip. So slow, the interface has the shape of rest for that angle (Young
and Laplace), which follows from the place of the line and the volumes: R d(beta)/dt = U(theta(beta)). A slip of 10 nm
would take the line a tenth further. No spacing resolves that corner: a solver needs a model of it, here its friction up
to a particle spacing (``sim.effects.parts.line_friction``).

The line is read as that of the shape of rest that is nearest to the interface in a strip along the wall, at the start
too, since labels of single particles part the volumes by up to half a spacing otherwise than asked for.
"""
import dataclasses
import functools

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator

from pipeline.studies.family import Family
from pipeline.studies.model import Curve, Figure, Outcome, compared
from sim.effects.parts.contact_line import SLIP, turning
from sim.parameters import parameter
from sim.settings import Liquid
from studies.validation.kit.tank import PackedParameters, Run, advance, build, cavity
from studies.validation.kit.young_laplace import Profile, distance_to, oil_at_rest

GRAVITY, TENSION = 9.81, 0.04  # m/s^2, N/m
AQUEOUS, OIL_DENSITY = Liquid("aqueous", 1005.0, 7e-4), 970.0
RADIUS = 0.011  # m
SHAPES, ANGLES = 12, 200  # shapes of rest computed, and angles at which the theory is tabulated from them
READ, POINTS = 45, 120  # shapes among which the line is read, and points along each
AT_WALL, NEAR = 0.5, 5.0  # distances from the wall between which the interface is read, in particle spacings
MOST = 400  # points of it that are looked at
MARGIN, LEAST_ANGLE = np.radians(10.0), np.radians(4.0)  # by which more shapes are read than the line passes through
START = 0.1  # of the time, in which the interface bends to the contact angle near the wall
FIGURES = (Figure("contact_line", "Oil leaves the wall", "time / s", "way of the contact line / mm"),)


@dataclasses.dataclass(frozen=True)
class Parameters(PackedParameters):
    """Oil in a circle or sphere, from level towards rest; resolutions count particles along the radius."""

    dimension: int = parameter(2, choices=(2, 3), meaning="a circle or a sphere")
    fill: float = parameter(0.85, minimum=0.5, maximum=0.95, meaning="share of it that is oil")
    contact_angle: float = parameter(18.2, unit="deg", minimum=5.0, maximum=45.0,
                                     meaning="contact angle through the aqueous")
    start_angle: float | None = parameter(None, unit="deg", minimum=5.0, maximum=45.0,
                                          meaning="contact angle of the shape of rest at the start; level without it")
    oil_viscosity: float = parameter(1.0, unit="Pa s", minimum=0.1, maximum=10.0, meaning="viscosity of the oil")
    holds: str = parameter("share", choices=("share", "corner"), meaning="what holds it, as in viscosity_implicit")
    duration: float = parameter(1.0, unit="s", exclusive_minimum=0.0, meaning="simulated time")
    resolutions: tuple[int, ...] = parameter((16, 32), minimum=8, meaning="particles along the radius, coarse to fine")
    tolerance: float = parameter(0.3, exclusive_minimum=0.0,
                                 meaning="allowed relative error of the way; a slip of 0.1 to 10 nm changes it by 10 %")


def run(case: Parameters) -> Outcome:
    """Compare the way of the contact line with Cox's at every resolution."""
    outcome = Outcome()
    name = f"{case.dimension}D"
    times, way = theory(case)
    for resolution in case.resolutions:
        result = _climb(case, resolution)
        outcome.remarks += result.remarks("contact line")
        found = 1e3 * result.values("way")
        tolerance = case.tolerance if resolution == max(case.resolutions) else None
        early = np.interp(START * case.duration, result.history["time"], found)
        outcome.rows += [
            compared("way of the contact line", float(found[-1]), float(1e3 * way[-1]), tolerance, "mm",
                     at=result.label, wall_s=result.wall_s),
            compared("way after the first tenth of the time", float(found[-1] - early),
                     float(1e3 * (way[-1] - np.interp(START * case.duration, times, way))), tolerance, "mm",
                     at=result.label, wall_s=result.wall_s),
            *result.rows()]
        if not result.failure:
            outcome.curves.append(Curve("contact_line", f"{name}, {result.label}, h/dx {case.support_ratio:g}",
                                        result.history["time"], found, "line"))
    outcome.curves.append(Curve("contact_line", f"{name}, Cox, slip 1 nm", times, 1e3 * way, "reference"))
    return outcome


def theory(case: Parameters, slip: float = SLIP) -> tuple[np.ndarray, np.ndarray]:
    """Return times, s, and the way of the line along the wall, m, (n,) each, by Cox's theory.

    slip : length on which liquid slips along the wall, m.
    """
    start, rest = first_angle(case), np.radians(case.contact_angle)
    angles, place = places(case.fill, min(start, rest), max(start, rest), case.dimension)
    gain = 1.0 / turning(angles, case.oil_viscosity / AQUEOUS.dynamic_viscosity)
    driven = np.concatenate([[0.0], np.cumsum(0.5 * (gain[1:] + gain[:-1]) * np.diff(angles))])
    driven -= np.interp(rest, angles, driven)
    speed = TENSION / AQUEOUS.dynamic_viscosity / np.log(RADIUS / slip) * driven
    times, first = np.linspace(0.0, case.duration, 101), float(np.interp(start, angles, place))
    # The further up the line is, the smaller the angle: from the lowest on places rise as the table goes backwards.
    found = solve_ivp(lambda _, beta: np.interp(beta, place[::-1], speed[::-1]) / RADIUS, (0.0, case.duration),
                      [first], t_eval=times, rtol=1e-8, atol=1e-10)
    return times, RADIUS * (found.y[0] - first)


@dataclasses.dataclass(frozen=True)
class Shapes:
    """Curves of shapes of rest, r and z, m, (2, n) each, and the polar angles of their lines, rad."""

    beta: np.ndarray
    curves: list[np.ndarray]


@functools.cache
def places(fill: float, smallest: float, largest: float, dimension: int) -> tuple[np.ndarray, np.ndarray]:
    """Return contact angles and the polar angle of the line of the shape of rest for each, rad, (n,) each."""
    few = np.linspace(smallest, largest, SHAPES)
    place = PchipInterpolator(few, [shape_at_rest(fill, angle, dimension).wall_angle for angle in few])
    angles = np.linspace(smallest, largest, ANGLES)
    return angles, place(angles)


def shape_at_rest(fill: float, angle: float, dimension: int) -> Profile:
    """The shape of rest with a contact angle, rad."""
    constant = (AQUEOUS.density - OIL_DENSITY) * GRAVITY / TENSION
    return oil_at_rest(fill, angle, constant, RADIUS, dimension)


def first_angle(case: Parameters) -> float:
    """Contact angle at the start, rad."""
    return level_start(case) if case.start_angle is None else float(np.radians(case.start_angle))


def level_start(case: Parameters) -> float:
    """Polar angle of the contact line of a level interface from the lowest point, rad; it is its contact angle too."""
    angles = np.linspace(0.0, np.pi, 20001)
    below = (angles - np.sin(angles) * np.cos(angles)) / np.pi
    if case.dimension == 3:
        below = (2.0 - 3.0 * np.cos(angles) + np.cos(angles) ** 3) / 4.0
    return float(np.interp(1.0 - case.fill, below, angles))


def line_of(solver, shapes: Shapes) -> float:
    """Polar angle of the contact line from the lowest point, rad; nan without an interface.

    That of the shape of rest that is nearest to the interface within `NEAR` spacings of the wall, in the mean square.
    """
    tension = next(effect for effect in solver.effects if effect.name == "interface_tension")
    points = tension.sorted_point.to_numpy()[: tension.point_count[None]]
    depth = (RADIUS - np.linalg.norm(points, axis=1)) / solver.spacing
    near = points[(depth > AT_WALL) & (depth < NEAR)]
    if not len(near):
        return np.nan
    near = near[::1 + len(near) // MOST]
    r, z = np.linalg.norm(np.delete(near, 1, axis=1), axis=1), near[:, 1]
    far = 2.0 * solver.spacing
    square = [np.mean(np.clip(distance_to(r, z, *curve), -far, far) ** 2) for curve in shapes.curves]
    k = int(np.clip(np.argmin(square), 1, len(square) - 2))
    beta = shapes.beta[k - 1: k + 2]
    bent, slope, _ = np.polyfit(beta, square[k - 1: k + 2], 2)
    return float(np.clip(-0.5 * slope / bent, beta[2], beta[0]))


@functools.cache
def shapes_near_wall(fill: float, smallest: float, largest: float, dimension: int, width: float) -> Shapes:
    """Shapes of rest for contact angles between two, rad, within a distance of the wall, m, and straight on behind it.
    """
    few = np.linspace(smallest, largest, SHAPES)
    found = [shape_at_rest(fill, angle, dimension) for angle in few]
    place = PchipInterpolator(few, [shape.wall_angle for shape in found])
    part = np.linspace(0.0, 1.0, POINTS)
    across = PchipInterpolator(few, [np.stack([np.interp(part, np.linspace(0.0, 1.0, len(shape.r)), values)
                                               for values in (shape.r, shape.z)]) for shape in found])
    curves = []
    for angle in np.linspace(smallest, largest, READ):
        curve = across(angle)
        curve = curve[:, np.flatnonzero(np.hypot(*curve) > RADIUS - width)[0]:]
        end = curve[:, -1] - curve[:, -2]
        curves.append(np.column_stack([curve, curve[:, -1] + width * end / np.linalg.norm(end)]))
    return Shapes(place(np.linspace(smallest, largest, READ)), curves)


def _climb(case: Parameters, resolution: int) -> Run:
    spacing = RADIUS / resolution
    arrays = cavity("circle", RADIUS, spacing, start="packed", support_ratio=case.support_ratio,
                    dimension=case.dimension, seed=case.seed)
    if case.start_angle is None:
        first = level_start(case)

        def is_oil(x):
            return x[:, 1] > -RADIUS * np.cos(first)
    else:
        shape = shape_at_rest(case.fill, first_angle(case), case.dimension)
        first, is_oil = shape.wall_angle, shape.is_oil
    oil = Liquid("oil", OIL_DENSITY, case.oil_viscosity)
    solver = build(case, arrays, liquids=(AQUEOUS, oil), phase=is_oil,
                   effects={"gravity": {"magnitude": GRAVITY}, "viscosity_implicit": {"contact_line": case.holds},
                            "interface_tension": {"coefficient": TENSION,
                                                  "contact_angle": np.radians(case.contact_angle)}})
    solver.prepare_output()
    smallest = min(first_angle(case), np.radians(case.contact_angle))
    largest = max(level_start(case), np.radians(case.contact_angle)) + MARGIN
    shapes = shapes_near_wall(case.fill, max(smallest - MARGIN, LEAST_ANGLE), largest, case.dimension,
                              (NEAR + 1.0) * spacing)
    start = line_of(solver, shapes)
    return advance(solver, case.duration, f"R/dx={resolution}",
                   lambda solver: {"way": RADIUS * (line_of(solver, shapes) - start)})


FAMILY = Family(__name__, Parameters, run, effects=("gravity", "viscosity_implicit", "interface_tension"),
                figures=FIGURES)
