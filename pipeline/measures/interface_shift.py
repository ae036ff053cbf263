"""How far an interface has moved, along its normal, from one state of the particles to another.

The volume fraction of the oil, smoothed over a support radius, falls across a flat interface by a known law, so that
every fraction is a distance to the interface. Both states are smoothed to the same fixed points: a point that lies on
the interface now tells how far away it was before. Equations: docs/methods/measures.md.
"""
import functools

import numpy as np
from scipy.spatial import cKDTree

from pipeline.cavity.signed_distance_grid import SignedDistance

APART = 0.7     # distance of the points, in particle spacings
NEAR = 0.5      # distance from the interface within which points lie on it, in particle spacings
OFF_WALL = 1.5  # particle spacings from the wall within which no points are: fractions are one-sided there
STEPS = 2000    # of the law


def smoothed_at(points: np.ndarray, position: np.ndarray, volume: np.ndarray, fraction: np.ndarray,
                support_radius: float) -> np.ndarray:
    """Mean of a fraction (n,) of particles around points (m, 3), weighted by volume and Wendland C2, (m,)."""
    pairs = cKDTree(points).sparse_distance_matrix(cKDTree(position), support_radius, output_type="coo_matrix")
    q = pairs.data / support_radius
    weight = volume[pairs.col] * (1.0 - q) ** 4 * (4.0 * q + 1.0)
    total = np.bincount(pairs.row, weight, len(points))
    return np.bincount(pairs.row, weight * fraction[pairs.col], len(points)) / np.where(total > 0.0, total, np.nan)


@functools.cache
def _law() -> tuple[np.ndarray, np.ndarray]:
    """Smoothed fraction at a distance in the oil of a flat interface, over the support radius: (fraction, distance).

    With s = |z| the integral of Wendland C2 over the plane z is in proportion to (1 - s)^5 (8 s^2 + 5 s + 1), and the
    fraction to its integral from -1 to the distance.
    """
    distance = np.linspace(-1.0, 1.0, STEPS + 1)
    s = np.abs(distance)
    density = (1.0 - s) ** 5 * (8.0 * s**2 + 5.0 * s + 1.0)
    fraction = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
    return fraction / fraction[-1], distance


def distance_of(fraction: np.ndarray, support_radius: float) -> np.ndarray:
    """Signed distance to the interface, m, positive in the oil, where the smoothed fraction is as given. (Q9)"""
    return support_radius * np.interp(fraction, *_law())


class InterfaceShift:
    """Shifts from one state on.

    Parameters
    ----------
    distance : signed distance to the wall.
    spacing, support_radius : of the particles, m.
    position, volume, fraction : of the particles before, (n, 3) m, (n,) m3 and (n,), the fraction of oil.
    """

    def __init__(self, distance: SignedDistance, spacing: float, support_radius: float, position: np.ndarray,
                 volume: np.ndarray, fraction: np.ndarray):
        self.spacing, self.support_radius = spacing, support_radius
        low, high = position.min(axis=0), position.max(axis=0)
        axes = [np.arange(a, b, APART * spacing) for a, b in zip(low, high, strict=True)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        self.points = points[distance.sample(points) < -OFF_WALL * spacing]
        self.before = self._away(self.points, position, volume, fraction)

    def _away(self, points: np.ndarray, position: np.ndarray, volume: np.ndarray, fraction: np.ndarray) -> np.ndarray:
        return distance_of(smoothed_at(points, position, volume, fraction, self.support_radius), self.support_radius)

    def of(self, position: np.ndarray, volume: np.ndarray, fraction: np.ndarray) -> np.ndarray:
        """Distances, m, by which the interface has moved at the points that are on it now: positive into the oil.

        No more than a support radius can be told.
        """
        near = np.ones(len(self.points), bool)
        for side in (fraction > 0.5, fraction <= 0.5):
            near &= cKDTree(position[side]).query(self.points, distance_upper_bound=self.support_radius)[0] < np.inf
        away = self._away(self.points[near], position, volume, fraction)
        on_it = np.abs(away) < NEAR * self.spacing
        return self.before[near][on_it] - away[on_it]
