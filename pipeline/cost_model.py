"""What a run costs: seconds, memory and disk as functions of what there is to do, fitted to what was measured.

The time of a part of the solver (a row of its timings) in one step is

    t = a + b N + c E + n (d + e N + f E)

with N particles, E neighbor entries and n iterations (or sub-steps), no coefficient below zero. Interface tension has
in place of the iterations a term with the interface, N^((D-1)/D), and one with the interface seen from every particle.
Other stages take a start and, for every frame, a part that depends on the number of particles and one that does not.
"""
import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from scipy.optimize import nnls

SURFACE_PARTS = ("interface_tension",)
ONE_DIMENSION = 1.8  # entries per particle differ by less in one dimension, and by a factor of three between 2D and 3D
KINDS = ("wall", "cpu")  # seconds on the clock, seconds of all cores


@dataclasses.dataclass(frozen=True)
class Work:
    """What a part of the solver has to do in one step.

    Attributes
    ----------
    particles, entries : numbers of liquid particles and of neighbor entries. dimension : of space.
    rounds : iterations or sub-steps.
    """

    particles: float
    entries: float
    dimension: int
    rounds: float = 0.0

    def features(self, part: str) -> np.ndarray:
        """Return what the coefficients of a part multiply, (6,)."""
        once = np.array([1.0, self.particles, self.entries])
        if _has_surface(part):
            interface = self.particles ** ((self.dimension - 1.0) / self.dimension)
            return np.concatenate([once, [interface, self.particles * interface, 0.0]])
        return np.concatenate([once, self.rounds * once])


def _has_surface(part: str) -> bool:
    return part.rpartition("/")[2] in SURFACE_PARTS


def neighbor_entries(particles: float, wall_area: float, dimension: int, support_ratio: float) -> float:
    """Return the neighbor entries of a liquid: of its particles (liquid and wall) and of the wall's particles.

    Parameters
    ----------
    wall_area : wetted area (length in two dimensions) of the wall in particle spacings.
    support_ratio : support radius over particle spacing, r. A particle has as many neighbors as there are spacings^D in
        a ball of that radius, and a unit of wall sees pi r^4/4 (2 r^3/3) of them: the integral over the distance to the
        wall of what of the ball lies beyond it.
    """
    if dimension == 2:
        return particles * (math.pi * support_ratio**2 - 1.0) + wall_area * 2.0 / 3.0 * support_ratio**3
    ball = 4.0 / 3.0 * math.pi * support_ratio**3
    return particles * (ball - 1.0) + wall_area * math.pi / 4.0 * support_ratio**4


@dataclasses.dataclass(frozen=True)
class Sample:
    """Seconds that one part of the solver took in one step."""

    part: str
    work: Work
    wall: float
    cpu: float


def fit(samples: Iterable[Sample]) -> dict[str, dict[str, list[float]]]:
    """Return the coefficients of every part: part -> "wall" or "cpu" -> (6,), none below zero.

    Relative errors are made small (non-negative least squares): a part of 1 ms counts as much as one of 1 s. A part
    that was timed in one dimension only does not tell what goes with particles from what goes with their neighbors: all
    of it is then counted per neighbor.
    """
    parts: dict[str, list[Sample]] = {}
    for sample in samples:
        parts.setdefault(sample.part, []).append(sample)
    return {part: {kind: _coefficients(part, rows, kind) for kind in KINDS} for part, rows in parts.items()}


def _coefficients(part: str, rows: Sequence[Sample], kind: str) -> list[float]:
    seconds = np.maximum([getattr(row, kind) for row in rows], 1e-7)
    matrix = np.array([row.work.features(part) for row in rows]) / seconds[:, None]
    neighbors = [row.work.entries / row.work.particles for row in rows]
    if 0.0 < max(neighbors) < ONE_DIMENSION * min(neighbors) and not _has_surface(part):
        matrix[:, [1, 4]] = 0.0
    scale = np.maximum(np.abs(matrix).max(axis=0), 1e-300)
    return (nnls(matrix / scale, np.ones(len(rows)))[0] / scale).tolist()


def seconds(coefficients: Mapping[str, Mapping[str, Sequence[float]]], part: str, work: Work, kind: str) -> float:
    """Return the seconds of a part in one step; KeyError where it was not measured."""
    return float(work.features(part) @ np.asarray(coefficients[part][kind]))


def typical(samples: Sequence[Sample], groups: int = 4) -> list[Sample]:
    """Return the medians of samples of one part in one run, in groups of like numbers of iterations.

    A median does not see the steps in which the computer did something else.
    """
    order = sorted(samples, key=lambda sample: sample.work.rounds)
    found = []
    for group in np.array_split(np.arange(len(order)), min(groups, len(order))):
        members = [order[k] for k in group]
        rounds = float(np.mean([one.work.rounds for one in members]))
        found.append(Sample(members[0].part, dataclasses.replace(members[0].work, rounds=rounds),
                            float(np.median([one.wall for one in members])),
                            float(np.median([one.cpu for one in members]))))
    return found


@dataclasses.dataclass(frozen=True)
class StageRun:
    """One measured run of a stage: frames that it worked on, particles in each, and what it took."""

    frames: int
    particles: float
    values: Mapping[str, float]


def fit_stage(runs: Sequence[StageRun], kind: str) -> list[float]:
    """Return start, cost per frame, and cost per frame and particle of a stage, none below zero."""
    matrix = np.array([[1.0, run.frames, run.frames * run.particles] for run in runs])
    values = np.array([run.values[kind] for run in runs])
    scale = np.maximum(np.abs(matrix).max(axis=0), 1e-300)
    return (nnls(matrix / scale / values[:, None], np.ones(len(runs)))[0] / scale).tolist()


def stage_cost(coefficients: Sequence[float], frames: int, particles: float) -> float:
    """Return what a stage costs with that many frames and particles in each."""
    return float(np.dot(coefficients, [1.0, frames, frames * particles]))
