"""The liquid particles at the start: a cubic lattice cut to the shape of the cavity."""

import numpy as np
from numpy.typing import ArrayLike

from pipeline.cavity.signed_distance_grid import SignedDistance, node_positions

CLEARANCE = 0.35        # smallest depth at the start in spacings; packing then settles the particles near the wall


def deepest_points(distance: SignedDistance, lower: ArrayLike, upper: ArrayLike, count: int,
                   spacing: float) -> np.ndarray:
    """Exactly ``count`` points (count, D) in m of a lattice in a cavity.

    A lattice that covers the box is cut by taking the deepest points, so the number matches the volume and the
    density inside is right from the start. Points nearer to the wall than ``CLEARANCE`` are pushed inward.

    Parameters
    ----------
    distance : signed distance of the cavity.
    lower, upper : (D,) corners of the box around the cavity, m.
    count : number of points, round(cavity volume / spacing^D).
    spacing : distance between lattice points, m.
    """
    low, high = np.asarray(lower, float), np.asarray(upper, float)
    cells = np.ceil((high - low) / spacing).astype(int) + 2
    start = 0.5 * (low + high) - 0.5 * (cells - 1) * spacing
    lattice = node_positions(start, cells, spacing).reshape(-1, len(low))
    depth = distance.sample(lattice)
    chosen = np.argsort(depth, kind="stable")[:count]
    points, depth = lattice[chosen], depth[chosen]
    near = depth > -CLEARANCE * spacing
    points[near] = distance.project(points[near], -CLEARANCE * spacing)
    return points
