"""The cavity's signed distance on a regular grid: negative inside."""
import numpy as np
import taichi as ti

from sim.runtime import real, real_numpy


@ti.data_oriented
class SignedDistance:
    """Signed distance to the surface of the cavity, linear between nodes.

    Parameters
    ----------
    values : (nx, ny[, nz]) at the nodes, m, negative inside; origin : (dimension,) of node 0, m; cell : node distance, m.
    """

    def __init__(self, values: np.ndarray, origin, cell: float):
        self.shape = values.shape
        self.dimension = values.ndim
        self.cell = float(cell)
        self.origin_numpy = np.asarray(origin, dtype=float)
        self.origin = ti.Vector(list(self.origin_numpy))
        self.values = ti.field(real(), shape=values.shape)
        self.values.from_numpy(np.ascontiguousarray(values, dtype=real_numpy()))
        self.corners = [tuple((c >> d) & 1 for d in range(self.dimension)) for c in range(2**self.dimension)]

    @ti.func
    def value(self, x):
        """Distance at x; outside the grid that of the nearest border point."""
        base = ti.Vector([0] * self.dimension)
        part = x * 0.0
        for d in ti.static(range(self.dimension)):
            t = ti.min(ti.max((x[d] - self.origin[d]) / self.cell, 0.0), self.shape[d] - 1.001)
            base[d] = ti.cast(ti.floor(t), ti.i32)
            part[d] = t - base[d]
        total = part[0] * 0.0
        for corner in ti.static(self.corners):
            w = part[0] * 0.0 + 1.0
            node = base
            for d in ti.static(range(self.dimension)):
                if ti.static(corner[d] == 1):
                    w *= part[d]
                    node[d] += 1
                else:
                    w *= 1.0 - part[d]
            total += w * self.values[node]
        return total

    @ti.func
    def normal(self, x):
        """Unit vector that points out of the cavity."""
        g = x * 0.0
        for d in ti.static(range(self.dimension)):
            step = x * 0.0
            step[d] = self.cell
            g[d] = self.value(x + step) - self.value(x - step)
        return g / ti.max(g.norm(), 1e-12)
