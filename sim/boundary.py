"""Wall particles: static, in layers outside the surface of the cavity, sorted once."""
import numpy as np
import taichi as ti

from sim.runtime import real, real_numpy


@ti.data_oriented
class Walls:
    """Wall particles.

    Parameters
    ----------
    position : (m, dimension), m; volume : (m,), m^3 (m^2 in 2D): exact shell volume over number (no scaling needed
        with two or more layers).
    depth : (m,), distance to the surface of the cavity, m.
    """

    def __init__(self, position: np.ndarray, volume: np.ndarray, depth: np.ndarray):
        dimension = position.shape[1]
        self.count = len(position)
        size = max(self.count, 1)
        self.position = ti.Vector.field(dimension, real(), shape=size, layout=ti.Layout.SOA)
        self.volume = ti.field(real(), shape=size)
        self.depth = ti.field(real(), shape=size)
        if self.count:
            self.position.from_numpy(position.astype(real_numpy()))
            self.volume.from_numpy(volume.astype(real_numpy()))
            self.depth.from_numpy(depth.astype(real_numpy()))
