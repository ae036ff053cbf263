"""The cavity's signed distance on a regular grid: negative inside."""
import numpy as np

from sim.backend import data_oriented, real, real_numpy, ti


@data_oriented
class SignedDistance:
    """Signed distance to the surface of the cavity, linear between nodes.

    Node (i, j, k) has the flat index i*strides[0] + j*strides[1] + k*strides[2]; other node fields share the layout.

    Parameters
    ----------
    values : (nx, ny[, nz]) at the nodes, m, negative inside.
    origin : (dimension,) of node 0, m; cell : node distance, m.
    """

    def __init__(self, values: np.ndarray, origin, cell: float):
        self.shape = values.shape
        self.dimension = values.ndim
        self.size = values.size
        self.cell = float(cell)
        self.strides = [int(np.prod(values.shape[d + 1:])) for d in range(values.ndim)]
        self.origin_numpy = np.asarray(origin, dtype=float)
        self.origin = ti.Vector([float(v) for v in self.origin_numpy])
        self.values = ti.field(real(), shape=values.size)
        self.values_numpy = np.ascontiguousarray(values, dtype=real_numpy()).ravel()
        self.values.from_numpy(self.values_numpy)
        self.corners = [[(c >> d) & 1 for d in range(self.dimension)] for c in range(2**self.dimension)]
        self.corner_offsets = [int(np.dot(corner, self.strides)) for corner in self.corners]

    def at(self, points: np.ndarray) -> np.ndarray:
        """Distance at (n, dimension) points on the host, m."""
        t = np.clip((points - self.origin_numpy) / self.cell, 0.0, np.array(self.shape) - 1.001)
        base = np.floor(t).astype(int)
        part, flat = t - base, base @ np.array(self.strides)
        weights = [np.prod(np.where(corner, part, 1.0 - part), axis=1) for corner in self.corners]
        values = [self.values_numpy[flat + offset] for offset in self.corner_offsets]
        return sum(w * v for w, v in zip(weights, values, strict=True))

    @ti.func
    def interpolate(self, field: ti.template(), x):
        """Value of a node field at x; outside the grid that of the nearest border point."""
        base = 0
        part = x * 0.0
        for d in ti.static(range(self.dimension)):
            t = ti.min(ti.max((x[d] - self.origin[d]) / self.cell, 0.0), self.shape[d] - 1.001)
            whole = ti.cast(ti.floor(t), ti.i32)
            part[d] = t - whole
            base += whole * self.strides[d]
        total = x[0] * 0.0
        for c in ti.static(range(2**self.dimension)):
            w = x[0] * 0.0 + 1.0
            for d in ti.static(range(self.dimension)):
                if ti.static(self.corners[c][d] == 1):
                    w *= part[d]
                else:
                    w *= 1.0 - part[d]
            total += w * field[base + self.corner_offsets[c]]
        return total

    @ti.func
    def may_exceed(self, x, limit):
        """False where the node next to x is so deep that the distance at x is certainly less than `limit`, m.

        Between neighboring nodes a distance changes by a cell at most; three times that leaves room for its errors.
        """
        base = 0
        for d in ti.static(range(self.dimension)):
            t = ti.min(ti.max((x[d] - self.origin[d]) / self.cell, 0.0), self.shape[d] - 1.001)
            base += ti.cast(ti.floor(t), ti.i32) * self.strides[d]
        return self.values[base] + 3.0 * self.dimension**0.5 * self.cell > limit

    @ti.func
    def value(self, x):
        """Distance at x, m."""
        return self.interpolate(self.values, x)

    @ti.func
    def normal(self, x):
        """Unit vector that points out of the cavity."""
        g = x * 0.0
        for d in ti.static(range(self.dimension)):
            step = x * 0.0
            step[d] = self.cell
            g[d] = self.value(x + step) - self.value(x - step)
        return g / ti.max(g.norm(), 1e-12)
