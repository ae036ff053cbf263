"""The nodes of a section, a plane through the origin; there a spline of the coarse nodes is a product of matrices."""
import numpy as np
from scipy.sparse import csr_matrix

from pipeline.surfaces.bricks import cubic_weights
from pipeline.surfaces.cavity_grid import CavityGrid

BAND = 2.0              # cells outside the wall, up to which fractions are known


class SectionPlane:
    """Nodes of a plane, the same in every frame.

    Parameters
    ----------
    grid : of the cavity.
    normal : axis that the plane stands on, through the origin.
    least : number of cells along the longer side, at least.

    Attributes
    ----------
    cell, shape : m, numbers (2,) of nodes.
    points, distance : (n, 3) and (n,) m, of all nodes, and signed to the wall.
    fine : (n, 3) the same points in fine cells of the grid, from its origin.
    corner : (3, n) lowest nodes of the coarse cells that they lie in.
    band : (n,) bool, nodes in the cavity and close to its wall.
    """

    def __init__(self, grid: CavityGrid, normal: int, least: int):
        self.normal, extent = normal, np.delete(grid.extent, normal)
        self.cell = grid.cell / max(1, int(np.ceil(least * grid.cell / extent.max())))
        self.shape = tuple(int(n) for n in np.floor(extent / self.cell + 1e-9) + 1)
        axes = [np.arange(n) * self.cell for n in self.shape]
        axes.insert(normal, -grid.origin[[normal]])
        self.points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3) + grid.origin
        self.distance = grid.distance_at(self.points)
        self.band = self.distance < BAND * self.cell
        self.fine = (self.points - grid.origin) / grid.cell
        places = [axis / grid.coarse_cell for axis in axes]
        lowest = [np.minimum(place.astype(int), count - 2) for place, count in zip(places, grid.shape, strict=True)]
        self.corner = np.stack(np.meshgrid(*lowest, indexing="ij")).reshape(3, -1)
        self._weights = [_weights(*one) for one in zip(places, lowest, grid.shape, strict=True)]

    def spline(self, coefficients: np.ndarray) -> np.ndarray:
        """Values (n,) at the nodes of a spline with coefficients (nx, ny, nz) at the coarse nodes."""
        values = coefficients
        for weights in self._weights:       # of the first axis, which becomes the last one
            values = (weights @ values.reshape(len(values), -1)).reshape(-1, *values.shape[1:])
            values = np.moveaxis(values, 0, -1)
        return values.ravel()


def _weights(places: np.ndarray, lowest: np.ndarray, count: int) -> csr_matrix:
    """Weights (n, count), float32, of coefficients along an axis at places (n,); those at its ends go on beyond it."""
    around = np.clip(lowest[:, None] + np.arange(-1, 3), 0, count - 1)
    weights = cubic_weights(places - lowest).astype(np.float32)
    return csr_matrix((weights.ravel(), around.ravel(), np.arange(0, weights.size + 1, 4)), (len(places), count))
