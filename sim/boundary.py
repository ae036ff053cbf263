"""Wall particles: static, in layers outside the surface of the cavity, sorted once; and the last stop at the wall.

Equations: docs/methods/walls.md.
"""
import numpy as np

from sim.backend import data_oriented, real, real_numpy, ti
from sim.reductions import blocks, first, last, partial_results, total_of

WALL_CLEARANCE = 0.1  # smallest distance of a particle to the wall's surface, in particle spacings


@data_oriented
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
        self.extent = float(np.ptp(position, axis=0).max()) if self.count else 0.0  # largest side of their box, m
        size = max(self.count, 1)
        self.position = ti.Vector.field(dimension, real(), shape=size, layout=ti.Layout.SOA)
        self.volume = ti.field(real(), shape=size)
        self.depth = ti.field(real(), shape=size)
        if self.count:
            self.position.from_numpy(position.astype(real_numpy()))
            self.volume.from_numpy(volume.astype(real_numpy()))
            self.depth.from_numpy(depth.astype(real_numpy()))


@data_oriented
class WallStop:
    """Last resort at the wall: a particle that the pressure has not stopped is set back and its approach is taken.

    Parameters
    ----------
    distance : signed distance of the cavity.
    particle_spacing : m.
    count : number of liquid particles.
    contact : integer field, set to 1 where the wall stopped the particle in this step.
    """

    def __init__(self, distance, particle_spacing: float, count, contact):
        self.distance, self.count, self.contact = distance, count, contact
        self.clearance = WALL_CLEARANCE * particle_spacing
        self.contacts = ti.field(ti.i32, shape=())
        self.partial = partial_results(1)

    @ti.func
    def stopped(self, i, x, v):
        """Position and velocity of particle i after the wall."""
        overlap = -1.0
        if self.distance.may_exceed(x, -self.clearance):
            overlap = self.distance.value(x) + self.clearance
        self.contact[i] = ti.cast(overlap > 0.0, ti.i32)
        if overlap > 0.0:
            normal = self.distance.normal(x)
            x -= overlap * normal  # (L5)
            v -= ti.max(v.dot(normal), 0.0) * normal
        return x, v

    @ti.kernel
    def _sum(self):
        n = self.count[None]
        for block in range(blocks(n)):
            total = 0
            for i in range(first(block, n), last(block, n)):
                total += self.contact[i]
            self.partial[0, block] = total
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.contacts[None] = ti.cast(total_of(self.partial, 0, n), ti.i32)

    def total(self) -> int:
        """Number of particles that the wall stopped in this step."""
        self._sum()
        return self.contacts[None]
