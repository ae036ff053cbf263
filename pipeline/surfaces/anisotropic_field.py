"""Volume fractions with kernels stretched along the surface on which particles lie [yu2013].

The kernel of a particle is an ellipsoid: its axes are those of the covariance of the particles of the same phase around
it, its volume that of the round kernel. Its center is drawn toward theirs, but less what those beside it are drawn: the
surface gets even and does not shrink. Both liquids are from one partition of unity.
Equations: docs/methods/surfaces.md.
"""
import numpy as np

from pipeline.surfaces.fraction_field import SUPPORT, FractionField, Vector, bins_around
from sim.backend import ti

NEIGHBORHOOD = 3.0      # radius in which the particles around one are looked at, in spacings
DRAWN = 0.9             # share of the way from a particle to the center of those around it
STRETCH = 4.0           # of the longest axis over any other, at most
FEWEST = {2: 8, 3: 25}  # particles around one, below which its kernel is round, by dimension
ROUND = 2.2             # support of a kernel that is not stretched, in spacings


class AnisotropicField(FractionField):
    """Samples fractions as ``FractionField`` does.

    Parameters
    ----------
    walls : (w, D) m, wall particles: they count as neighbors of all phases, so that no center leaves the wall.
    """

    def __init__(self, particle_spacing: float, lower: np.ndarray, upper: np.ndarray, liquids: int,
                 walls: np.ndarray | None = None):
        super().__init__(particle_spacing, lower, upper, liquids)
        self.walls = np.zeros((0, self.dimension)) if walls is None else walls
        # Of an ellipsoid with one short axis, the longest that it can get.
        self.reach = ROUND * STRETCH ** (1.0 / self.dimension)

    def load(self, position: np.ndarray, volume: np.ndarray, fraction: np.ndarray, phase: np.ndarray) -> None:
        """Take over the particles: (n, D) m, (n,) m**3 (m**2 in 2D), (n, liquids), (n,)."""
        moved, shape = self._shapes(position, np.asarray(phase))
        super().load(moved, volume, fraction, phase)
        order, _ = self._sorted(self._scaled(moved))
        self._shape = np.ascontiguousarray(shape[order], np.float32)
        self._weight *= np.float32((SUPPORT / ROUND) ** self.dimension)

    def _shapes(self, position: np.ndarray, phase: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Centers (n, D), m, and matrices (n, 3, 3) that turn an offset in spacings into one in supports (U6)."""
        count, dimension = position.shape
        everything = np.concatenate([position, self.walls])
        kind = np.concatenate([phase, np.full(len(self.walls), -1)])
        scaled = self._scaled(everything)
        order, start = self._sorted(scaled)
        sums = np.zeros((len(everything), 11), np.float32)
        _moments(np.ascontiguousarray(scaled[order], np.float32), kind[order].astype(np.int32), start, *self.bins, sums)
        moments = np.empty_like(sums)
        moments[order] = sums
        moments = moments[:count].astype(float)
        mean = moments[:, 1:1 + dimension] / moments[:, :1]
        second = moments[:, [[4, 5, 6], [5, 7, 8], [6, 8, 9]]][:, :dimension, :dimension] / moments[:, :1, None]
        covariance = second - mean[:, :, None] * mean[:, None]
        stretch, axes = np.linalg.eigh(covariance)
        stretch = np.sqrt(np.maximum(stretch, 1e-12))
        stretch = np.maximum(stretch, stretch.max(axis=1, keepdims=True) / STRETCH)
        stretch /= np.exp(np.log(stretch).mean(axis=1, keepdims=True))
        alone = moments[:, 10] < FEWEST[dimension]
        stretch[alone] = 1.0
        shape = np.tile(np.eye(3) / ROUND, (count, 1, 1))
        shape[:, :dimension, :dimension] = np.einsum("nik,nk,njk->nij", axes, 1.0 / (ROUND * stretch), axes)
        drawn = np.zeros((len(everything), 3), np.float32)
        drawn[:count, :dimension] = np.where(alone[:, None], 0.0, DRAWN * mean)
        beside = np.zeros_like(drawn)
        _mean_drawn(np.ascontiguousarray(scaled[order], np.float32), drawn[order], kind[order].astype(np.int32), start,
                    *self.bins, beside)
        drawn[order] -= beside
        return position + self.particle_spacing * drawn[:count, :dimension].astype(float), shape


@ti.kernel
def _moments(
    position: ti.types.ndarray(dtype=Vector, ndim=1),
    phase: ti.types.ndarray(dtype=ti.i32, ndim=1),
    start: ti.types.ndarray(dtype=ti.i32, ndim=1),
    bins_x: ti.i32, bins_y: ti.i32, bins_z: ti.i32,
    sums: ti.types.ndarray(dtype=ti.f32, ndim=2),
):
    """Weights, first and second moments (n, 11) of the particles of one phase around each of them, and their count."""
    for i in range(position.shape[0]):
        point = position[i]
        total = ti.Vector.zero(ti.f32, 11)
        low, high = bins_around(point, NEIGHBORHOOD, bins_x, bins_y, bins_z)
        if phase[i] >= 0 and low.z <= high.z:
            for bin_x, bin_y in ti.ndrange((low.x, high.x + 1), (low.y, high.y + 1)):
                column = (bin_x * bins_y + bin_y) * bins_z
                for j in range(start[column + low.z], start[column + high.z + 1]):
                    if phase[j] == phase[i] or phase[j] < 0:
                        away = position[j] - point
                        q = away.norm() / NEIGHBORHOOD
                        if q < 1.0:
                            w = 1.0 - q * q * q
                            x, y, z = away.x, away.y, away.z
                            total += ti.Vector([w, w * x, w * y, w * z, w * x * x, w * x * y, w * x * z, w * y * y,
                                                w * y * z, w * z * z, 1.0])
        for k in ti.static(range(11)):
            sums[i, k] = total[k]


@ti.kernel
def _mean_drawn(
    position: ti.types.ndarray(dtype=Vector, ndim=1),
    drawn: ti.types.ndarray(dtype=Vector, ndim=1),
    phase: ti.types.ndarray(dtype=ti.i32, ndim=1),
    start: ti.types.ndarray(dtype=ti.i32, ndim=1),
    bins_x: ti.i32, bins_y: ti.i32, bins_z: ti.i32,
    mean: ti.types.ndarray(dtype=Vector, ndim=1),
):
    """How far the particles of one phase around each of them are drawn; those that are drawn more count more."""
    for i in range(position.shape[0]):
        point = position[i]
        total, weights = point * 0.0, 0.0
        low, high = bins_around(point, NEIGHBORHOOD, bins_x, bins_y, bins_z)
        if phase[i] >= 0 and low.z <= high.z:
            for bin_x, bin_y in ti.ndrange((low.x, high.x + 1), (low.y, high.y + 1)):
                column = (bin_x * bins_y + bin_y) * bins_z
                for j in range(start[column + low.z], start[column + high.z + 1]):
                    q = (position[j] - point).norm() / NEIGHBORHOOD
                    if phase[j] == phase[i] and q < 1.0:
                        w = (1.0 - q * q * q) * drawn[j].norm()
                        total += w * drawn[j]
                        weights += w
        mean[i] = total / ti.max(weights, 1e-12)
