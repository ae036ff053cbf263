"""How fast oil leaves a wall: the contact line of oil in a circle or sphere, from a level interface towards rest.

Oil of 1 Pa s and aqueous start level in a circle or sphere, and the aqueous climbs the wall until the interface has
the contact angle. Where viscosity and tension alone hold the line, Cox's theory (1986) tells its speed from the angle
that the interface has seen from afar, beyond the corner in which it bends (``sim.effects.parts.contact_line``):

    U = sigma/(mu ln(R/r_s)) (g(theta) - g(theta_e)), dg/dtheta = 1/f

with the length r_s = 1 nm on which molecules slip. So slow, the interface has the shape of rest for that angle (Young
and Laplace), which follows from the place of the line and the volumes: R d(beta)/dt = U(theta(beta)). A slip of 10 nm
would take the line a tenth further. No spacing resolves that corner: a solver needs a model of it, here the weaker hold
of the wall next to the line (``sim.effects.parts.liquid_viscosity``), whose one number was chosen in the circle, at the
angle and fill that are the defaults, with 32 and 64 spacings along the radius.
"""
import dataclasses
import functools

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator, RegularGridInterpolator

from pipeline.study_kit.model import Curve, Figure, Outcome, compared
from pipeline.study_kit.tank import PackedParameters, Run, advance, build, cavity
from pipeline.study_kit.young_laplace import oil_at_rest
from sim.effects.parts.contact_line import SLIP, turning
from sim.parameters import parameter
from sim.settings import Liquid

EFFECTS = ("gravity", "viscosity_implicit", "interface_tension")
GRAVITY, TENSION = 9.81, 0.04  # m/s^2, N/m
AQUEOUS, OIL = Liquid("aqueous", 1005.0, 7e-4), Liquid("oil", 970.0, 1.0)
RADIUS = 0.011  # m
SHAPES, ANGLES = 12, 200  # shapes of rest computed, and angles at which the theory is tabulated from them
NEAR_WALL = 0.25  # distance from the wall at which the line is read, in particle spacings
START = 0.1  # of the time, in which the line leaps by up to a spacing, for its angle is at once that of rest
SIDES, MERIDIANS = 1500, 16  # points along each side of the wall, between which it is read, and sides of a sphere
FIGURES = (Figure("contact_line", "Oil leaves the wall", "time / s", "way of the contact line / mm"),)


@dataclasses.dataclass(frozen=True)
class Parameters(PackedParameters):
    """Oil in a circle or sphere, from level towards rest; resolutions count particles along the radius."""

    dimension: int = parameter(2, choices=(2, 3), meaning="a circle or a sphere")
    fill: float = parameter(0.85, minimum=0.5, maximum=0.95, meaning="share of it that is oil")
    contact_angle: float = parameter(18.2, unit="deg", minimum=5.0, maximum=45.0,
                                     meaning="contact angle through the aqueous")
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
    level = level_start(case)
    angles, place = places(case.fill, np.radians(case.contact_angle), level, case.dimension)
    gain = 1.0 / turning(angles, OIL.dynamic_viscosity / AQUEOUS.dynamic_viscosity)
    driven = np.concatenate([[0.0], np.cumsum(0.5 * (gain[1:] + gain[:-1]) * np.diff(angles))])
    speed = TENSION / AQUEOUS.dynamic_viscosity / np.log(RADIUS / slip) * driven
    times = np.linspace(0.0, case.duration, 101)
    # The further up the line is, the smaller the angle: from level on places rise as the table goes backwards.
    found = solve_ivp(lambda _, beta: np.interp(beta, place[::-1], speed[::-1]) / RADIUS, (0.0, case.duration),
                      [level], t_eval=times, rtol=1e-8, atol=1e-10)
    return times, RADIUS * (found.y[0] - level)


@functools.cache
def places(fill: float, smallest: float, largest: float, dimension: int) -> tuple[np.ndarray, np.ndarray]:
    """Return contact angles and the polar angle of the line of the shape of rest for each, rad, (n,) each."""
    constant = (AQUEOUS.density - OIL.density) * GRAVITY / TENSION
    few = np.linspace(smallest, largest, SHAPES)
    place = PchipInterpolator(few, [oil_at_rest(fill, angle, constant, RADIUS, dimension).wall_angle for angle in few])
    angles = np.linspace(smallest, largest, ANGLES)
    return angles, place(angles)


def level_start(case: Parameters) -> float:
    """Polar angle of the contact line of a level interface from the lowest point, rad; it is its contact angle too."""
    angles = np.linspace(0.0, np.pi, 20001)
    below = (angles - np.sin(angles) * np.cos(angles)) / np.pi
    if case.dimension == 3:
        below = (2.0 - 3.0 * np.cos(angles) + np.cos(angles) ** 3) / 4.0
    return float(np.interp(1.0 - case.fill, below, angles))


def line_of(solver) -> float:
    """Polar angle of the contact line from the lowest point, mean of all sides, rad; nan where one has none."""
    level_set = next(effect for effect in solver.effects if effect.name == "interface_tension").level_set
    grid = level_set.grid
    axes = [grid.origin_numpy[d] + grid.cell * np.arange(grid.shape[d]) for d in range(solver.dimension)]
    phi = RegularGridInterpolator(axes, level_set.phi.to_numpy().reshape(grid.shape))
    radius, beta = RADIUS - NEAR_WALL * solver.spacing, np.linspace(0.0, np.pi, SIDES)
    around = 2.0 * np.pi * (np.arange(MERIDIANS) + 0.5) / MERIDIANS
    sides = [(-1.0,), (1.0,)] if solver.dimension == 2 else np.stack([np.cos(around), np.sin(around)], axis=1)
    found = []
    for side in sides:
        x = radius * np.outer(np.sin(beta), side)
        values = phi(np.insert(x, 1, -radius * np.cos(beta), axis=1))
        crossings = np.flatnonzero((values[:-1] <= 0.0) & (values[1:] > 0.0))
        if not len(crossings):
            return np.nan
        k = crossings[-1]
        found.append(beta[k] + (beta[k + 1] - beta[k]) * values[k] / (values[k] - values[k + 1]))
    return float(np.mean(found))


def _climb(case: Parameters, resolution: int) -> Run:
    spacing = RADIUS / resolution
    arrays = cavity("circle", RADIUS, spacing, start="packed", support_ratio=case.support_ratio,
                    dimension=case.dimension, seed=case.seed)
    level = level_start(case)
    solver = build(case, arrays, liquids=(AQUEOUS, OIL), phase=lambda x: x[:, 1] > -RADIUS * np.cos(level),
                   effects={"gravity": {"magnitude": GRAVITY}, "viscosity_implicit": {},
                            "interface_tension": {"coefficient": TENSION,
                                                  "contact_angle": np.radians(case.contact_angle)}})
    solver.prepare_output()
    return advance(solver, case.duration, f"R/dx={resolution}",
                   lambda solver: {"way": RADIUS * (line_of(solver) - level)})
