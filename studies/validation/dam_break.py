"""The front of a collapsing column, against the experiments of Martin & Moyce (1952).

A column of width a and height 2a runs along the floor; Z = x/a over tau = t sqrt(2g/a). Computed fronts run 5 to 15 %
ahead of the experiment (release of the gate, friction of the floor), so the front is asked for within a band from 5 %
behind to 15 % ahead, and its speed once it is steady (tau > 5) to be that of the experiment, where Z grows by 1.7 per
tau; a front without friction would end at 2.

With `air` the rest of the box is full of a second liquid of that density over that of water: the cavity is closed and
nothing may throw the light liquid about. What is heavier than air (1:800) also brakes the front more.

The tip of the layer, thinner than a particle, breaks up into single particles that fly ahead as spray. The front is
that of the water: the farthest particle that has two others within 1.5 spacings. The farthest particle of all is
reported beside it.

How the tip breaks up is chaos: starts that differ by a millionth of a spacing end with fronts 5 to 10 % apart. So the
column collapses several times, and the front is the mean: that of 16 runs, which scatter by 6 %, is known to 1.5 %.
"""
import dataclasses
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from pipeline.studies.family import Family
from pipeline.studies.model import Curve, Figure, Outcome, Row, bounded, compared, observed_order
from sim.parameters import parameter
from sim.settings import Liquid
from studies.validation.kit.tank import Run, TankParameters, advance, build, cavity, field, motion

WIDTH = 0.05715  # m, 2.25 in
DENSITY = 1000.0  # kg/m^3
GRAVITY = 9.81
BOX = (17, 3)  # sides of the box in widths
BAND = (0.95, 1.15)
STEADY = (5.0, 9.25)  # tau
EARLY = (2.0, 5.0)
AVERAGED = 0.1  # tau to either side of an instant of the experiment: the front advances particle by particle
TOUCH = 1.5  # particles within this many spacings hang together
PERTURBATION = 1e-6  # spacings by which the starts of repeated runs differ
PER_TIME = np.sqrt(2.0 * GRAVITY / WIDTH)  # tau over t, 1/s
TAU = np.arange(0.0, STEADY[1], 0.01)  # where the fronts of several runs are averaged
FRICTIONLESS = 2.0  # dZ/dtau of shallow water on a dry floor (Ritter), 2 sqrt(g 2a)
# Martin & Moyce (1952), n^2 = 2: (tau, Z) of the columns 2.25 in and 1.125 in wide.
WIDE = np.array([
    (0.832, 1.217), (1.219, 1.474), (1.997, 2.292), (2.547, 2.995), (3.345, 4.134), (4.034, 4.944), (4.418, 5.881),
    (5.091, 6.980), (5.685, 7.945), (6.306, 8.966), (6.822, 9.986), (7.439, 10.963), (8.031, 11.977), (8.633, 13.005),
    (9.237, 13.970)])
NARROW = np.array([
    (0.849, 1.245), (1.212, 1.443), (1.602, 1.884), (2.283, 2.689), (2.950, 3.728), (3.598, 4.528), (3.905, 4.999),
    (4.592, 5.841), (4.961, 6.271), (5.316, 6.717)])
FIGURES = (
    Figure("dam_break_front", "Front of a collapsing column, finest resolution", "time sqrt(2g/a)",
           "front / width of the column"),
    Figure("dam_break_energy", "Mechanical energy, finest resolution", "time sqrt(2g/a)",
           "(kinetic + potential energy) / start"),
)


@dataclasses.dataclass(frozen=True)
class Parameters(TankParameters):
    """A column of water behind a gate that is gone at once; resolutions count particles along its width."""

    tolerance: float = parameter(0.05, exclusive_minimum=0.0, meaning="allowed relative error of the front's speed")
    air: float = parameter(0.0, minimum=0.0, maximum=1.0,
                           meaning="density of what is around the column over that of water; 0: nothing is around it")
    repeats: int = parameter(16, minimum=1, meaning="runs at every resolution, over which the front is averaged")


def run(case: Parameters) -> Outcome:
    """Measure the front's speed and how far it leaves the band, at every resolution."""
    outcome, errors = Outcome(), []
    for index, resolution in enumerate(case.resolutions):
        results = [_collapse(case, resolution, repeat) for repeat in range(case.repeats)]
        outcome.remarks += [remark for result in results for remark in result.remarks(_name(case))]
        courses = [_course(result) for result in results if not result.failure]
        # A mean of what is left would hide that some runs have failed.
        course = np.mean(courses, axis=0) if len(courses) == case.repeats else None
        common: dict[str, Any] = {"at": results[0].label, "wall_s": sum(result.wall_s for result in results)}
        early, speed, outside, spray = [np.nan] * 4 if course is None else _measured(*course)
        single = [front_speed(TAU, front, STEADY) for front, _ in courses]
        row = compared("speed of the front / sqrt(2 g a), tau > 5", speed, front_speed(WIDE[:, 0], WIDE[:, 1], STEADY),
                       case.tolerance if index > 0 else None, **common)
        errors.append(row.error)
        outcome.rows += [row, compared("the same beside the limit without friction", speed, FRICTIONLESS, None,
                                       **common),
                         Row("standard deviation of this speed between single runs",
                             float(np.std(single, ddof=1)) if len(single) > 1 else np.nan, **common),
                         compared("speed of the farthest particle / sqrt(2 g a), tau > 5", spray, FRICTIONLESS, None,
                                  **common),
                         compared("speed of the front / sqrt(2 g a), tau 2 to 5", early,
                                       front_speed(WIDE[:, 0], WIDE[:, 1], EARLY), None, **common),
                         bounded("largest departure from the band / experiment", outside,
                                 1e-12 if index > 0 else None, **common),
                         *min(results, key=lambda result: result.solver.time).rows()]
    outcome.rows.append(Row("observed order of the front's speed",
                            observed_order([1.0 / n for n in case.resolutions], errors)))
    if course is not None:
        history = results[0].history
        energy = history["kinetic_energy"] + history["potential_energy"]
        outcome.curves += [Curve("dam_break_front", _name(case), TAU, course[0], "line"),
                           Curve("dam_break_energy", _name(case), history["time"] * PER_TIME, energy / energy[0],
                                 "line")]
    outcome.curves += [Curve("dam_break_front", "Martin & Moyce, 2.25 in", WIDE[:, 0], WIDE[:, 1], "reference"),
                       Curve("dam_break_front", "Martin & Moyce, 1.125 in", NARROW[:, 0], NARROW[:, 1], "reference")]
    return outcome


def _name(case: Parameters) -> str:
    return case.scheme + (f", air 1:{case.air:g}" if case.air else "")


def _course(result: Run) -> np.ndarray:
    """Front of the water and farthest particle, in widths, at every ``TAU``."""
    tau = result.history["time"] * PER_TIME
    return np.array([np.interp(TAU, tau, result.history[name]) for name in ("front", "farthest")])


def _measured(front: np.ndarray, farthest: np.ndarray) -> tuple[float, float, float, float]:
    return (front_speed(TAU, front, EARLY), front_speed(TAU, front, STEADY), outside_band(TAU, front),
            front_speed(TAU, farthest, STEADY))


def water_front(position: np.ndarray, spacing: float) -> float:
    """Farthest x, m, of a particle that has two others within 1.5 spacings; (n, d) positions, m."""
    pairs = cKDTree(position).query_pairs(TOUCH * spacing, output_type="ndarray")
    return float(position[np.bincount(pairs.ravel(), minlength=len(position)) >= 2, 0].max())


def front_speed(tau: np.ndarray, front: np.ndarray, window: tuple[float, float]) -> float:
    """Slope dZ/dtau within a window of tau, by least squares."""
    inside = (tau >= window[0] - 0.01) & (tau <= window[1])
    return float(np.polyfit(tau[inside], front[inside], 1)[0])


def outside_band(tau: np.ndarray, front: np.ndarray) -> float:
    """Largest share by which the front is behind or ahead of the band around the experiment; 0 inside it."""
    times, fronts = WIDE[WIDE[:, 0] > 1.0].T  # the gate still opens before
    ratio = np.array([front[np.abs(tau - time) < AVERAGED].mean() for time in times]) / fronts
    return float(np.maximum(np.maximum(BAND[0] - ratio, ratio - BAND[1]), 0.0).max())


def _collapse(case: Parameters, resolution: int, repeat: int) -> Run:
    spacing = WIDTH / resolution
    size = tuple(side * WIDTH for side in BOX)
    arrays = cavity("box", size, spacing, support_ratio=case.support_ratio)
    if repeat:
        apart = np.random.default_rng(repeat).uniform(-1.0, 1.0, arrays["fluid_position"].shape)
        arrays["fluid_position"] = arrays["fluid_position"] + PERTURBATION * spacing * apart
    left, floor = -0.5 * size[0], -0.5 * size[1]

    def column(x: np.ndarray) -> np.ndarray:
        return (x[:, 0] < left + WIDTH) & (x[:, 1] < floor + 2.0 * WIDTH)

    def watch(solver) -> dict[str, float]:
        position, mass = field(solver, "position"), field(solver, "mass")
        water = position[solver.particles.to_numpy("phase") == 0]
        return motion(solver) | {"front": (water_front(water, spacing) + 0.5 * spacing - left) / WIDTH,
                                 "farthest": (water[:, 0].max() + 0.5 * spacing - left) / WIDTH,
                                 "potential_energy": float(GRAVITY * mass @ (position[:, 1] - floor))}

    liquids = [Liquid("water", DENSITY, 1e-3)]
    if case.air:
        liquids.append(Liquid("air", case.air * DENSITY, 1.8e-5))
    solver = build(case, arrays, liquids=liquids,
                   effects={"gravity": {"magnitude": GRAVITY}, "viscosity": {"wall": "free_slip"}},
                   filled=None if case.air else column, phase=lambda x: ~column(x),
                   maximum_time_step=case.largest_step * np.sqrt(spacing / GRAVITY))
    return advance(solver, STEADY[1] / PER_TIME, f"n={resolution}", watch)


FAMILY = Family(__name__, Parameters, run, effects=("gravity", "viscosity"), figures=FIGURES)
