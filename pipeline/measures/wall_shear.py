"""Shear stress at the wall, read from the velocities of the particles near it.

Around every point of the wall the velocity along it is fitted by G d + C d^2 over the depth d, as the wall holds the
liquid; the stress is mu G, with the viscosity of the liquid nearest to the point. The square is what an unsteady flow
needs: at the wall it balances the acceleration. Equations: docs/methods/measures.md.
"""
import numpy as np
from scipy.spatial import cKDTree

from pipeline.cavity.signed_distance_grid import SignedDistance

REACH = 3.0  # particle spacings from the wall within which velocities count
FEWEST = 4  # particles that a fit of two numbers needs to mean anything


def wall_shear_stress(wall: np.ndarray, position: np.ndarray, velocity: np.ndarray, viscosity: np.ndarray,
                      distance: SignedDistance, particle_spacing: float) -> np.ndarray:
    """Stress that the liquid exerts along the wall, (m, D), Pa; NaN where fewer than four particles are near.

    Parameters
    ----------
    wall : (m, D), m, points within a spacing behind the wall or on it.
    position, velocity : (n, D), m and m/s, the fluid.
    viscosity : (n,), Pa s, of every particle.
    """
    normal = distance.normal(wall)
    surface = wall - distance.sample(wall)[:, None] * normal
    reach = REACH * particle_spacing
    pairs = cKDTree(surface).sparse_distance_matrix(cKDTree(position), reach, output_type="coo_matrix")
    point, particle, apart = pairs.row, pairs.col, pairs.data
    depth = np.maximum(-distance.sample(position), 0.0)[particle]
    weight = (1.0 - (apart / reach) ** 2) ** 2
    along = velocity[particle] - (velocity[particle] * normal[point]).sum(axis=1)[:, None] * normal[point]
    count = len(wall)

    def total(values: np.ndarray) -> np.ndarray:
        return np.bincount(point, values, count)

    s2, s3, s4 = (total(weight * depth**power) for power in (2, 3, 4))
    first, second = (np.stack([total(weight * depth**power * along[:, axis]) for axis in range(along.shape[1])], axis=1)
                     for power in (1, 2))
    determinant = s2 * s4 - s3**2
    known = (np.bincount(point, minlength=count) >= FEWEST) & (determinant > 1e-9 * s2 * s4)
    slope = np.full(wall.shape, np.nan)
    slope[known] = ((first * s4[:, None] - second * s3[:, None]) / np.where(known, determinant, 1.0)[:, None])[known]
    nearest = cKDTree(position).query(surface)[1]
    return viscosity[nearest][:, None] * slope  # (Q3)
