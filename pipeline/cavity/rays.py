"""Where rays from the center of the globe meet the wall."""
import numpy as np
from scipy.spatial import cKDTree

NEAREST = 8     # triangles tried for a ray


def interpolation(wall: np.ndarray, faces: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners (k, 3) int of the triangles that rays from the origin meet, and the weights (k, 3) of the corners.

    Parameters
    ----------
    wall, faces : (n, 3) in m and (m, 3) int, the triangles.
    direction : (k, 3), of rays that leave the cavity once.
    """
    corners = wall[faces]
    middle = corners.mean(axis=1)
    tree = cKDTree(middle / np.linalg.norm(middle, axis=1, keepdims=True))
    near = tree.query(direction, k=NEAREST)[1]
    weights = np.linalg.solve(np.moveaxis(corners[near], -1, -2),
                              np.broadcast_to(direction[:, None, :, None], (*near.shape, 3, 1)))[..., 0]
    weights /= weights.sum(axis=-1, keepdims=True)
    best = weights.min(axis=-1).argmax(axis=1)
    row = np.arange(len(direction))
    return faces[near[row, best]], weights[row, best]
