"""Volume fraction of every liquid at any point, from the particles around it (Taichi, on the CPU).

At a point the particles within 2.5 spacings are averaged with weights ``volume * W``, W a Wendland C2 kernel. A plane
is the plane z = 0 of space. Every point gathers its own sum in a fixed order, so the result does not depend on the
number of threads. The sums are kept apart by the phase of the particles: their total is the smooth fraction whose level
1/2 is the interface, the sum of one phase is the fraction on that side of a sharp interface.
Equations: docs/methods/surfaces.md.
"""
import numpy as np
from scipy.sparse import coo_matrix

from sim.backend import ti

SUPPORT = 2.5  # in particle spacings; smaller is rougher, larger wipes out films and drops
NORMALIZATION = {2: 7.0 / np.pi, 3: 10.5 / np.pi}       # of Wendland C2 with support 1, by dimension
FILTER_CUT = 1e-3       # of its largest weight, where the filter ends
Vector = ti.types.vector(3, ti.f32)
Matrix = ti.types.matrix(3, 3, ti.f32)
ROUND_KERNELS = np.zeros((1, 3, 3), np.float32)         # in place of shapes, not read


class FractionField:
    """Samples the fractions of one frame after another.

    Parameters
    ----------
    particle_spacing : m.
    lower, upper : (D,) m, box that holds every particle that matters; others are moved to its border bins.
    liquids : number of liquids.

    Attributes
    ----------
    reach : distance up to which a particle counts, in spacings.
    """

    reach = SUPPORT
    _shape: np.ndarray | None = None  # (n, 3, 3) where kernels are stretched: from an offset in spacings to supports

    def __init__(self, particle_spacing: float, lower: np.ndarray, upper: np.ndarray, liquids: int):
        self.particle_spacing = particle_spacing
        self.dimension = len(lower)
        self.lower = in_space(np.asarray(lower, np.float64))
        upper = in_space(np.asarray(upper, np.float64))
        self.bins = tuple(int(count) for count in np.ceil((upper - self.lower) / particle_spacing) + 1)
        self.liquids = liquids

    def load(self, position: np.ndarray, volume: np.ndarray, fraction: np.ndarray, phase: np.ndarray) -> None:
        """Take over the particles: (n, D) m, (n,) m**3 (m**2 in 2D), (n, liquids), (n,)."""
        scaled = self._scaled(position)
        order, self._start = self._sorted(scaled)
        self._position = np.ascontiguousarray(scaled[order], np.float32)
        relative = np.asarray(volume)[order] / self.particle_spacing**self.dimension
        self._weight = np.ascontiguousarray(relative * NORMALIZATION[self.dimension] / SUPPORT**self.dimension,
                                            np.float32)
        self._fraction = np.ascontiguousarray(np.asarray(fraction)[order], np.float32)
        self._phase = np.ascontiguousarray(np.asarray(phase)[order], np.int32)

    def _scaled(self, points: np.ndarray) -> np.ndarray:
        """Points (n, 3) in spacings from the corner of the box."""
        return (in_space(np.asarray(points, np.float64)) - self.lower) / self.particle_spacing

    def _sorted(self, scaled: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Order (n,) by bins of one spacing, and where each of these starts."""
        bins = np.clip(np.floor(scaled).astype(np.int32), 0, np.array(self.bins, np.int32) - 1)
        flat = np.ravel_multi_index(tuple(bins.T), self.bins)
        # A sparse matrix of bins and particles is ordered by counting, which takes a third of the time of sorting.
        table = coo_matrix((np.ones(len(flat), bool), (flat, np.arange(len(flat)))),
                           shape=(int(np.prod(self.bins)), len(flat))).tocsr()
        return table.indices, table.indptr.astype(np.int32)

    def sample(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Sums at points (m, D) in m.

        Returns
        -------
        weight : (m, liquids) float32, sum of volume * W over the particles of each phase: 1 in an even filling, 0 where
            none is near.
        share : (m, liquids, liquids) float32, ``share[:, p, l]`` is the part of ``weight[:, p]`` that is liquid l.
        """
        count = len(points)
        weight = np.zeros((count, self.liquids), np.float32)
        share = np.zeros((count, self.liquids, self.liquids), np.float32)
        if count and len(self._position):
            stretched = self._shape is not None
            _gather(self._scaled(points).astype(np.float32), self._position,
                    self._shape if stretched else ROUND_KERNELS, self._weight, self._fraction, self._phase, self._start,
                    *self.bins, self.reach, stretched, self.liquids, weight, share)
        return weight, share


def in_space(points: np.ndarray) -> np.ndarray:
    """Points (..., 3) in space: those of a plane, (..., 2), get z = 0."""
    return points if points.shape[-1] == 3 else np.concatenate([points, np.zeros_like(points[..., :1])], axis=-1)


def smooth_fraction(weight: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Fractions (m, liquids) over the particles of all phases (U1); NaN where no particle is near."""
    total = weight.sum(axis=1)
    with np.errstate(invalid="ignore"):
        return share.sum(axis=1) / np.where(total > 0, total, np.nan)[:, None]


def sided_fraction(weight: np.ndarray, share: np.ndarray, side: np.ndarray) -> np.ndarray:
    """Fractions (m, liquids) over the particles of phase ``side`` (m,) alone, sharp at the interface.

    Where no particle of that phase is near, the fraction over all phases stands in.
    """
    rows = np.arange(len(side))
    own = weight[rows, side]
    with np.errstate(invalid="ignore"):
        sided = share[rows, side] / np.where(own > 0, own, np.nan)[:, None]
    return np.where(own[:, None] > 0, sided, smooth_fraction(weight, share))


def wendland(q: np.ndarray) -> np.ndarray:
    """Wendland's C2 kernel without its norm, at distances q in supports."""
    return np.clip(1.0 - q, 0.0, None) ** 4 * (4.0 * q + 1.0)


def smoothing_filter(length: float, cell: float) -> np.ndarray:
    """Weights along one axis that turn samples into coefficients of a cubic spline, smoothed over a length (U2).

    The waves of a surface that are longer than some 2 pi lengths stay, so that it does not shrink as with a Gaussian;
    the length is independent of the cell. Applied to the fractions and not to the mesh it can neither open the mesh,
    nor part the liquids, nor move the wall.

    Parameters
    ----------
    length, cell : of smoothing and of the samples, in the same unit; without smoothing the spline meets the samples.
    """
    count = 1024
    wave = 2.0 * np.pi * np.fft.fftfreq(count)      # per cell
    passed = np.exp(-(wave * length / cell) ** 4) / ((2.0 + np.cos(wave)) / 3.0)
    weights = np.fft.fftshift(np.fft.ifft(passed).real)
    width = np.abs(np.flatnonzero(np.abs(weights) > FILTER_CUT * weights.max()) - count // 2).max()
    weights = weights[count // 2 - width:count // 2 + width + 1]
    return weights / weights.sum()


@ti.func
def bins_around(point, reach, bins_x, bins_y, bins_z):
    """The first and the last bin within reach of a point, along every axis."""
    low = ti.max(ti.cast(ti.floor(point - reach), ti.i32), 0)
    high = ti.min(ti.cast(ti.floor(point + reach), ti.i32), ti.Vector([bins_x, bins_y, bins_z]) - 1)
    return low, high


@ti.kernel
def _gather(
    points: ti.types.ndarray(dtype=Vector, ndim=1),
    position: ti.types.ndarray(dtype=Vector, ndim=1),
    shape: ti.types.ndarray(dtype=Matrix, ndim=1),
    volume: ti.types.ndarray(dtype=ti.f32, ndim=1),
    fraction: ti.types.ndarray(dtype=ti.f32, ndim=2),
    phase: ti.types.ndarray(dtype=ti.i32, ndim=1),
    start: ti.types.ndarray(dtype=ti.i32, ndim=1),
    bins_x: ti.i32, bins_y: ti.i32, bins_z: ti.i32,
    reach: ti.f32,
    stretched: ti.template(),
    liquids: ti.template(),
    weight: ti.types.ndarray(dtype=ti.f32, ndim=2),
    share: ti.types.ndarray(dtype=ti.f32, ndim=3),
):
    for m in range(points.shape[0]):
        point = points[m]
        # Sums of this point alone, in local variables: no atomic additions, one order.
        total = ti.Vector.zero(ti.f32, liquids)
        parts = ti.Matrix.zero(ti.f32, liquids, liquids)
        low, high = bins_around(point, reach, bins_x, bins_y, bins_z)
        if low.z <= high.z:
            for bin_x, bin_y in ti.ndrange((low.x, high.x + 1), (low.y, high.y + 1)):
                # Bins along z are neighbors in memory: one run of particles for each column of bins.
                column = (bin_x * bins_y + bin_y) * bins_z
                for j in range(start[column + low.z], start[column + high.z + 1]):
                    away = point - position[j]
                    support = SUPPORT
                    if ti.static(stretched):
                        away, support = shape[j] @ away, 1.0
                    # Without a branch, which would be taken by half of the particles: beyond the support w is 0.
                    q = ti.min(ti.sqrt(away.norm_sqr()) / support, 1.0)
                    s = (1.0 - q) * (1.0 - q)
                    w = volume[j] * s * s * (4.0 * q + 1.0)
                    for p in ti.static(range(liquids)):
                        of_phase = ti.select(phase[j] == p, w, 0.0)
                        total[p] += of_phase
                        for liquid in ti.static(range(liquids)):
                            parts[p, liquid] += of_phase * fraction[j, liquid]
        for p in ti.static(range(liquids)):
            weight[m, p] = total[p]
            for liquid in ti.static(range(liquids)):
                share[m, p, liquid] = parts[p, liquid]
