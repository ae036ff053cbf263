"""Wall particles on surfaces parallel to the wall of the cavity, evenly spread by repulsion along the surface.

Equations: docs/methods/walls.md.
"""
import numpy as np
from scipy.spatial import cKDTree
from skimage.measure import marching_cubes

from pipeline.base.threads import library_threads
from pipeline.cavity.signed_distance_grid import SignedDistance

NEIGHBORS = 9           # nearest points that repel; on an even surface 6 touch
REACH = 1.3             # range of the repulsion in spacings; the distance in a hexagonal layer is 1.07
STEP = 0.5              # displacement per unit of repulsion in spacings; twice as much makes the points oscillate
SWEEPS = 60             # repulsion steps; twice as many raise the smallest spacing by 0.02 spacings


def wall_layers(distance: SignedDistance, particle_spacing: float, layers: int) -> dict[str, np.ndarray]:
    """Layers of wall particles at dx/2, 3dx/2, 5dx/2 ... outside the cavity.

    Each layer holds area / dx^2 particles, and its particles share the exact volume of their shell, which reaches half
    a spacing to both sides: no further weights are needed.

    Parameters
    ----------
    distance : signed distance in 3D that reaches beyond the outermost layer.
    particle_spacing : dx, m.
    layers : number of layers.

    Returns
    -------
    dict with wall_position (m, 3) in m, wall_volume (m,) in m3 and wall_distance (m,) in m (depth outside the cavity).
    """
    positions, volumes, depths = [], [], []
    for layer in range(layers):
        depth = (layer + 0.5) * particle_spacing
        points = even_points(distance, depth, particle_spacing)
        shell = (distance.volume_below(depth + 0.5 * particle_spacing)
                 - distance.volume_below(depth - 0.5 * particle_spacing))
        positions.append(points)
        volumes.append(np.full(len(points), shell / len(points)))  # (L2)
        depths.append(np.full(len(points), depth))
    return {"wall_position": np.concatenate(positions), "wall_volume": np.concatenate(volumes),
            "wall_distance": np.concatenate(depths)}


def even_points(distance: SignedDistance, level: float, spacing: float) -> np.ndarray:
    """Evenly spread points (n, 3) in m on the surface of signed distance ``level``, one per spacing^2 of its area."""
    points = equal_area_points(distance, level, spacing)
    for sweep in range(SWEEPS):
        if sweep % 4 == 0:
            _, neighbors = cKDTree(points).query(points, k=min(NEIGHBORS + 1, len(points)), workers=library_threads())
        separation = points[:, None] - points[neighbors[:, 1:]]
        length = np.maximum(np.linalg.norm(separation, axis=-1), 1e-6 * spacing)
        strength = STEP * np.clip(1.0 - length / (REACH * spacing), 0.0, None) ** 2  # (L3)
        push = (separation * (strength / length)[..., None]).sum(axis=1) * spacing
        size = np.linalg.norm(push, axis=1, keepdims=True)
        push *= np.minimum(1.0, 0.2 * spacing / np.maximum(size, 1e-12 * spacing))     # no point jumps over another
        points = distance.project(points + push, level, iterations=1)
    return distance.project(points, level)


def equal_area_points(distance: SignedDistance, level: float, spacing: float) -> np.ndarray:
    """One point per spacing^2 of the surface of signed distance ``level``, with the same area around each.

    The triangles of the surface are put in the order of a space-filling curve; a point is taken at each equal step
    of the area along it. So no region starts with too many points, which repulsion would take long to even out.
    """
    vertices, faces, _, _ = marching_cubes(distance.values, level)
    corners = (distance.origin + distance.cell * vertices)[faces]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    centers = corners.mean(axis=1)
    order = np.argsort(curve_position(centers), kind="stable")
    along = np.cumsum(area[order])
    count = max(1, round(along[-1] / spacing**2))
    chosen = np.searchsorted(along, (np.arange(count) + 0.5) * along[-1] / count)
    return distance.project(centers[order][chosen], level)


def curve_position(points: np.ndarray, bits: int = 10) -> np.ndarray:
    """Place (n,) of points (n, 3) along a Morton curve through their bounding box, 2^bits cells a side."""
    cells = ((points - points.min(axis=0)) / np.ptp(points, axis=0).max() * (2**bits - 1)).astype(np.int64)
    place = np.zeros(len(points), np.int64)
    for bit in reversed(range(bits)):
        for axis in range(3):
            place = 2 * place + (cells[:, axis] >> bit & 1)
    return place
