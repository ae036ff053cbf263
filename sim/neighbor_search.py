"""Uniform grid, stable counting sort and neighbor rows with cached gradients.

Liquid particles are sorted by cell in every step (x fastest), walls once. One kernel then writes, for every liquid
particle, its liquid neighbors and its wall neighbors, and a second one the liquid neighbors of every wall particle:
index, V_j grad_i W_ij and V_j W_ij. Later passes stream these rows and never touch the grid again.
Rows have a fixed width; an overflow is an error, never a lost neighbor.
"""
import itertools

import numpy as np
import taichi as ti

from sim.boundary import Walls
from sim.fields import ParticleStore
from sim.runtime import real, real_numpy

REACH = 2  # cells on each side that can hold neighbors


def corners(wall_position: np.ndarray, periods) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corner, (dimension,), m, of the box around the walls and the periodic axes."""
    half = 0.5 * np.array(periods or (0.0,) * wall_position.shape[1])
    points = np.concatenate([wall_position, [-half, half]]) if np.any(half) else wall_position
    return points.min(axis=0), points.max(axis=0)


def row_widths(support_ratio: float, dimension: int, crowding: float) -> tuple[int, int, int]:
    """Neighbors that fit into the rows of liquid-liquid, liquid-wall and wall-liquid pairs.

    Parameters
    ----------
    support_ratio : support radius over particle spacing; crowding : particles per rest volume that must fit.
    """
    ball = {2: np.pi * support_ratio**2, 3: 4.0 / 3.0 * np.pi * support_ratio**3}[dimension]
    width = int(crowding * ball) + 8
    # In the corner of a box 7/8 of a ball is wall, on a round wall about half.
    return width, int((0.6, 0.8)[dimension - 2] * width), int(0.75 * width)


@ti.data_oriented
class Rows:
    """Neighbor rows of fixed width: entries of row i are i*width .. i*width + count[i] - 1."""

    def __init__(self, rows: int, width: int, dimension: int):
        self.width = width
        self.rows = rows
        size = max(rows, 1) * width
        self.count = ti.field(ti.i32, shape=max(rows, 1))
        self.index = ti.field(ti.i32, shape=size)
        self.gradient = ti.Vector.field(dimension, real(), shape=size, layout=ti.Layout.SOA)  # V_j grad_i W_ij, 1/m
        self.weight = ti.field(real(), shape=size)  # V_j W_ij
        self.longest = ti.field(ti.i32, shape=())

    def bytes(self) -> int:
        """Memory of the rows."""
        item = 4 if real() == ti.f32 else 8
        return self.rows * self.width * (4 + item * (self.gradient.n + 1))


@ti.data_oriented
class NeighborSearch:
    """Neighbors within the support radius.

    Parameters
    ----------
    particles : store with carried fields `position` and `volume`.
    wall_arrays : position (m, dimension), volume (m,) and depth (m,) of the wall particles, any order.
    kernel : smoothing kernel.
    lower, upper : (dimension,) corners of the box that contains every wall and liquid particle, m.
    particle_spacing : m; crowding : particles per rest volume that must fit; both set the width of the rows.
    periods : length after which an axis repeats, m, 0 where it does not; empty where none does.

    Raises
    ------
    ValueError
        When a period is shorter than two support radii: a particle would meet another one twice.
    """

    def __init__(self, particles: ParticleStore, wall_arrays, kernel, lower, upper, particle_spacing: float,
                 crowding: float = 1.25, periods=()):
        self.particles = particles
        self.position = particles.arrays["position"]
        self.volume = particles.arrays["volume"]
        self.kernel = kernel
        self.dimension = particles.dimension
        h = kernel.support_radius
        self.periods = tuple(float(period) for period in periods) or (0.0,) * self.dimension
        if any(0.0 < period < 2.0 * h for period in self.periods):
            raise ValueError(f"periods are {self.periods} m, but must be 0 or at least two support radii, {2.0 * h} m")
        # A particle near the end of a periodic axis looks for neighbors from its place beyond the other end too.
        images = np.array(list(itertools.product(
            *[(0.0, -period, period) if period else (0.0,) for period in self.periods])))
        self.image_count = len(images)
        self.image = ti.Vector.field(self.dimension, real(), shape=len(images))
        self.image.from_numpy(images.astype(real_numpy()))
        # Cells of half the support: 5^d of them hold 40 % fewer candidates than 3^d cells of the whole support.
        self.cell = 0.5 * h * (1.0 + 1e-6)
        self.origin_numpy = np.asarray(lower) - (REACH + 0.5) * self.cell
        self.origin = ti.Vector([float(v) for v in self.origin_numpy])
        self.shape = tuple(int(n) for n in np.ceil((np.asarray(upper) - self.origin_numpy) / self.cell) + REACH + 1)
        self.strides = [1]
        for n in self.shape[:-1]:
            self.strides.append(self.strides[-1] * n)
        self.cells = int(np.prod(self.shape))
        self.cell_start = ti.field(ti.i32, shape=self.cells + 1)
        self.cell_fill = ti.field(ti.i32, shape=self.cells + 1)
        self.cell_of = ti.field(ti.i32, shape=particles.capacity)
        steps = range(-REACH, REACH + 1)
        offsets = [dy * self.strides[1] + (dz * self.strides[2] if self.dimension == 3 else 0)
                   for dz in (steps if self.dimension == 3 else (0,)) for dy in steps]
        self.row_count = len(offsets)
        self.row_offset = ti.field(ti.i32, shape=self.row_count)
        self.row_offset.from_numpy(np.array(offsets, dtype=np.int32))

        position, volume, depth = wall_arrays
        order, start = self._sort_walls(position)
        self.wall_order = order
        self.walls = Walls(position[order], volume[order], depth[order])
        self.wall_cell_start = ti.field(ti.i32, shape=self.cells + 1)
        self.wall_cell_start.from_numpy(start)

        widths = row_widths(h / particle_spacing, self.dimension, crowding)
        self.pairs = Rows(particles.capacity, widths[0], self.dimension)
        self.wall_pairs = Rows(particles.capacity, widths[1], self.dimension)
        self.wall_rows = Rows(self.walls.count, widths[2], self.dimension)

    def _sort_walls(self, position: np.ndarray):
        cell = np.floor((position - self.origin_numpy) / self.cell).astype(np.int64) @ np.array(self.strides)
        order = np.argsort(cell, kind="stable")
        start = np.searchsorted(cell[order], np.arange(self.cells + 1)).astype(np.int32)
        return order, start

    @ti.func
    def _cell_index(self, x):
        """Linear index of the cell of x, clamped to the cells that have neighbors on every side."""
        index = 0
        for d in ti.static(range(self.dimension)):
            c = ti.cast(ti.floor((x[d] - self.origin[d]) / self.cell), ti.i32)
            index += ti.min(ti.max(c, REACH), self.shape[d] - 1 - REACH) * self.strides[d]
        return index

    @ti.func
    def separation(self, x_i, x_j):
        """x_i - x_j, along periodic axes to the nearest image, m."""
        d = x_i - x_j
        for axis in ti.static(range(self.dimension)):
            if ti.static(self.periods[axis] > 0.0):
                d[axis] -= self.periods[axis] * ti.round(d[axis] / self.periods[axis])
        return d

    @ti.func
    def _near(self, x):
        """True where x is within a support radius of the periods."""
        near = True
        for axis in ti.static(range(self.dimension)):
            if ti.static(self.periods[axis] > 0.0):
                near = near and ti.abs(x[axis]) <= 0.5 * self.periods[axis] + self.kernel.support_radius
        return near

    @ti.kernel
    def _wrap(self):
        for i in range(self.particles.count[None]):
            for axis in ti.static(range(self.dimension)):
                if ti.static(self.periods[axis] > 0.0):
                    self.position[i][axis] -= self.periods[axis] * ti.round(
                        self.position[i][axis] / self.periods[axis])

    @ti.kernel
    def _assign(self):
        for i in range(self.particles.count[None]):
            self.cell_of[i] = self._cell_index(self.position[i])

    @ti.kernel
    def _counting_sort(self):
        # Serial and stable: the order, and with it every later sum, does not depend on the number of threads.
        n = self.particles.count[None]
        ti.loop_config(serialize=True)
        for c in range(self.cells + 1):
            self.cell_fill[c] = 0
        ti.loop_config(serialize=True)
        for i in range(n):
            self.cell_fill[self.cell_of[i]] += 1
        total = 0
        ti.loop_config(serialize=True)
        for _ in range(1):
            for c in range(self.cells + 1):
                k = self.cell_fill[c]
                self.cell_start[c] = total
                self.cell_fill[c] = total
                total += k
        ti.loop_config(serialize=True)
        for i in range(n):
            c = self.cell_of[i]
            self.particles.order[self.cell_fill[c]] = i
            self.cell_fill[c] += 1

    @ti.func
    def _scan(self, x, j, slot: ti.template(), pairs: ti.template(), row, x_j, volume_j):
        d = x - x_j
        r2 = d.norm_sqr()
        if r2 < self.kernel.support_radius**2:
            if slot < pairs.width:
                r = ti.sqrt(r2)
                k = row * pairs.width + slot
                pairs.index[k] = j
                pairs.gradient[k] = (volume_j * self.kernel.gradient_factor(r)) * d
                pairs.weight[k] = volume_j * self.kernel.value(r)
            slot += 1

    @ti.kernel
    def _build(self):
        for i in range(self.particles.count[None]):
            n = 0
            m = 0
            for s in range(self.image_count):
                x = self.position[i] + self.image[s]
                if self._near(x):
                    c = self._cell_index(x)
                    for k in range(self.row_count):
                        first = c + self.row_offset[k]
                        for j in range(self.cell_start[first - REACH], self.cell_start[first + REACH + 1]):
                            if j != i:
                                self._scan(x, j, n, self.pairs, i, self.position[j], self.volume[j])
                        for b in range(self.wall_cell_start[first - REACH], self.wall_cell_start[first + REACH + 1]):
                            self._scan(x, b, m, self.wall_pairs, i, self.walls.position[b], self.walls.volume[b])
            self.pairs.count[i] = n
            self.wall_pairs.count[i] = m
        for b in range(self.walls.count):
            n = 0
            for s in range(self.image_count):
                x = self.walls.position[b] + self.image[s]
                if self._near(x):
                    c = self._cell_index(x)
                    for k in range(self.row_count):
                        first = c + self.row_offset[k]
                        for j in range(self.cell_start[first - REACH], self.cell_start[first + REACH + 1]):
                            self._scan(x, j, n, self.wall_rows, b, self.position[j], self.volume[j])
            self.wall_rows.count[b] = n

    @ti.kernel
    def _longest(self):
        ti.loop_config(serialize=True)
        for _ in range(1):
            a = 0
            b = 0
            c = 0
            for i in range(self.particles.count[None]):
                a = ti.max(a, self.pairs.count[i])
                b = ti.max(b, self.wall_pairs.count[i])
            for i in range(self.walls.count):
                c = ti.max(c, self.wall_rows.count[i])
            self.pairs.longest[None] = a
            self.wall_pairs.longest[None] = b
            self.wall_rows.longest[None] = c

    def sort(self) -> None:
        """Sort the liquid particles by cell."""
        if any(self.periods):
            self._wrap()
        self._assign()
        self._counting_sort()
        self.particles.reorder()

    def build(self) -> None:
        """Write the neighbor rows of the current positions.

        Raises
        ------
        OverflowError
            When a row is full: particles pile up far beyond rest density.
        """
        self._build()
        self._longest()
        for name in ("pairs", "wall_pairs", "wall_rows"):
            rows = getattr(self, name)
            if rows.longest[None] > rows.width:
                raise OverflowError(
                    f"{self._most_crowded(name)} has {rows.longest[None]} neighbors where {rows.width} fit ({name}): "
                    "particles pile up; use a smaller time step")

    def _most_crowded(self, name: str) -> str:
        """The particle with the longest of some rows, in words."""
        rows = getattr(self, name)
        row = int(np.argmax(rows.count.to_numpy()))
        position = (self.walls.position if name == "wall_rows" else self.position)[row]
        place = ", ".join(f"{value:.4g}" for value in position.to_numpy())
        number = "a wall particle" if name == "wall_rows" else f"particle {self.particles.arrays['id'][row]}"
        return f"{number} at ({place}) m"
