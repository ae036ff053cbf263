"""Uniform grid, stable counting sort and neighbor rows with cached gradients.

Liquid particles are sorted by cell in every step (x fastest), walls once. Then the liquid neighbors and the wall
neighbors of every liquid particle, and the liquid neighbors of every wall particle, are counted, the rows laid out, and
index, V_j grad_i W_ij and V_j W_ij written. Later passes stream these rows and never touch the grid again.
"""
import itertools

import numpy as np

from sim.backend import data_oriented, real, real_numpy, ti
from sim.boundary import Walls
from sim.fields import ParticleStore
from sim.neighbor_rows import COUNTING_SLACK, HEAD_ROOM, NeighborRows, entries_at_rest
from sim.reductions import blocks, first, last, partial_results, running_total

REACH = (4, 1, 1)  # cells on each side, along each axis, that can hold neighbors: long rows of candidates fill the
# vector registers, so that 9 of 20 to 35 take half the time of 25 of 5 to 10, though they hold more
MARKS = 63  # candidates in a row of cells that marks have room for
LANES = 8  # numbers of a vector register; more or fewer give the same neighbors
EACH = -1  # instead of marks: look at each candidate


def corners(wall_position: np.ndarray, periods) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corner, (dimension,), m, of the box around the walls and the periodic axes."""
    half = 0.5 * np.array(periods or (0.0,) * wall_position.shape[1])
    points = np.concatenate([wall_position, [-half, half]]) if np.any(half) else wall_position
    return points.min(axis=0), points.max(axis=0)


@data_oriented
class NeighborSearch:
    """Neighbors within the support radius.

    Parameters
    ----------
    particles : store with carried fields `id`, `position` and `volume`.
    wall_arrays : position (m, dimension), volume (m,) and depth (m,) of the wall particles, any order.
    kernel : smoothing kernel.
    lower, upper : (dimension,) corners of the box that contains every wall and liquid particle, m.
    particle_spacing : m; head_room : neighbors that must fit, over those at rest density.
    periods : length after which an axis repeats, m, 0 where it does not; empty where none does.

    Raises
    ------
    ValueError
        When a period is shorter than two support radii: a particle would meet another one twice.
    """

    def __init__(self, particles: ParticleStore, wall_arrays, kernel, lower, upper, particle_spacing: float,
                 head_room: float = HEAD_ROOM, periods=()):
        self.particles = particles
        self.id, self.position = particles.arrays["id"], particles.arrays["position"]
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
        reach = np.array(REACH[:self.dimension])
        self.cell = tuple(float(size) for size in h * (1.0 + 1e-6) / reach)
        self.origin_numpy = np.asarray(lower) - (reach + 0.5) * self.cell
        self.origin = ti.Vector([float(v) for v in self.origin_numpy])
        self.shape = tuple(int(n) for n in np.ceil((np.asarray(upper) - self.origin_numpy) / self.cell) + reach + 1)
        self.strides = [1]
        for n in self.shape[:-1]:
            self.strides.append(self.strides[-1] * n)
        self.cells = int(np.prod(self.shape))
        self.cell_start = ti.field(ti.i32, shape=self.cells + 1)
        self.cell_fill = ti.field(ti.i32, shape=self.cells + 1)
        self.cell_of = ti.field(ti.i32, shape=particles.capacity)
        steps = [range(-cells, cells + 1) for cells in REACH]
        offsets = [dy * self.strides[1] + (dz * self.strides[2] if self.dimension == 3 else 0)
                   for dz in (steps[2] if self.dimension == 3 else (0,)) for dy in steps[1]]
        self.row_count = len(offsets)
        self.row_offset = ti.field(ti.i32, shape=self.row_count)
        self.row_offset.from_numpy(np.array(offsets, dtype=np.int32))
        # For every particle and row of cells, a bit for each candidate that is a neighbor: counting, which the vector
        # registers do, finds them, so that writing need not look at the several times as many candidates again.
        self.marks = ti.field(ti.i64, shape=(particles.capacity, self.image_count * self.row_count))

        position, volume, depth = wall_arrays
        order, start = self._sort_walls(position)
        self.wall_order = order
        self.walls = Walls(position[order], volume[order], depth[order])
        self.wall_cell_start = ti.field(ti.i32, shape=self.cells + 1)
        self.wall_cell_start.from_numpy(start)
        self.sees_wall = ti.field(ti.i32, shape=self.cells)  # 1 for cells around which there is any wall particle
        self.sees_wall.from_numpy(self._cells_that_see(start, offsets))

        self.partial = partial_results(1)
        entries, wall_entries = (int(head_room * n) + 1000 for n in entries_at_rest(
            particles.capacity, depth, h / particle_spacing, particle_spacing, self.dimension))
        self.pairs = NeighborRows(particles.capacity, entries, self.dimension)
        self.wall_pairs = NeighborRows(particles.capacity, wall_entries, self.dimension)
        self.wall_rows = NeighborRows(self.walls.count, wall_entries, self.dimension)

    def _sort_walls(self, position: np.ndarray):
        cell = np.floor((position - self.origin_numpy) / self.cell).astype(np.int64) @ np.array(self.strides)
        order = np.argsort(cell, kind="stable")
        start = np.searchsorted(cell[order], np.arange(self.cells + 1)).astype(np.int32)
        return order, start

    def _cells_that_see(self, start: np.ndarray, offsets: list[int]) -> np.ndarray:
        """1 for the cells that have walls within reach, where `start` has the first wall particle of every cell."""
        cell = np.arange(self.cells)[:, None] + np.array(offsets)
        last, first = (np.clip(cell + step, 0, self.cells) for step in (REACH[0] + 1, -REACH[0]))
        return np.any(start[last] > start[first], axis=1).astype(np.int32)

    @ti.func
    def _cell_index(self, x):
        """Linear index of the cell of x, clamped to the cells that have neighbors on every side."""
        index = 0
        for d in ti.static(range(self.dimension)):
            c = ti.cast(ti.floor((x[d] - self.origin[d]) / self.cell[d]), ti.i32)
            index += ti.min(ti.max(c, REACH[d]), self.shape[d] - 1 - REACH[d]) * self.strides[d]
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
    def _counting_sort(self):
        """Order of the particles by cell, within a cell by id.

        It depends neither on the number of threads nor on what was before: a run that is restarted has the same.
        """
        n = self.particles.count[None]
        for c in range(self.cells + 1):
            self.cell_fill[c] = 0
        for i in range(n):
            c = self._cell_index(self.position[i])
            self.cell_of[i] = c
            ti.atomic_add(self.cell_fill[c], 1)
        for block in range(blocks(self.cells)):
            total = 0
            for c in range(first(block, self.cells), last(block, self.cells)):
                total += self.cell_fill[c]
            self.partial[0, block] = total
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.cell_start[self.cells] = ti.cast(running_total(self.partial, 0, self.cells), ti.i32)
        for block in range(blocks(self.cells)):
            place = ti.cast(self.partial[0, block], ti.i32)
            for c in range(first(block, self.cells), last(block, self.cells)):
                self.cell_start[c] = place
                place += self.cell_fill[c]
                self.cell_fill[c] = 0
        for i in range(n):
            c = self.cell_of[i]
            self.particles.order[self.cell_start[c] + ti.atomic_add(self.cell_fill[c], 1)] = i
        # The threads have filled a cell in any order.
        for c in range(self.cells):
            for k in range(self.cell_start[c] + 1, self.cell_start[c + 1]):
                i = self.particles.order[k]
                place = k
                while place > self.cell_start[c] and self.id[self.particles.order[place - 1]] > self.id[i]:
                    self.particles.order[place] = self.particles.order[place - 1]
                    place -= 1
                self.particles.order[place] = i

    @ti.func
    def _counted(self, x, position: ti.template(), begin, end):
        """Number of particles begin .. end - 1 within the support radius of x."""
        n = 0
        limit = (1.0 + COUNTING_SLACK) * self.kernel.support_radius**2
        for j in range(begin, end):
            n += ti.cast((x - position[j]).norm_sqr() < limit, ti.i32)
        return n

    @ti.func
    def _row(self, c, k, cell_start: ti.template()):
        """First candidate, and the one after the last, in row k of the cells around cell c."""
        middle = c + self.row_offset[k]
        return cell_start[middle - REACH[0]], cell_start[middle + REACH[0] + 1]

    @ti.func
    def _marked(self, x, position: ti.template(), begin, end):
        """Marks and number of the candidates begin .. end - 1 within the support radius of x."""
        n, marks = 0, ti.cast(0, ti.i64)
        limit = (1.0 + COUNTING_SLACK) * self.kernel.support_radius**2
        if end - begin > MARKS:
            n, marks = self._counted(x, position, begin, end), ti.cast(EACH, ti.i64)
        else:
            # Whole vectors; candidates after the last get no mark. One by one each takes as long as a vector.
            stop = ti.min(begin + (end - begin + LANES - 1) // LANES * LANES, position.shape[0])
            for j in range(begin, stop):
                marks |= ti.cast((x - position[j]).norm_sqr() < limit, ti.i64) << ti.cast(j - begin, ti.i64)
            marks &= (ti.cast(1, ti.i64) << ti.cast(end - begin, ti.i64)) - 1
            n = ti.cast(ti.math.popcnt(marks), ti.i32)
        return n, marks

    @ti.kernel
    def _count(self):
        for i in range(self.particles.count[None]):
            n = -1  # a particle is no neighbor of its own
            m = 0
            for s in range(self.image_count):
                x = self.position[i] + self.image[s]
                if self._near(x):
                    c = self._cell_index(x)
                    for k in range(self.row_count):
                        begin, end = self._row(c, k, self.cell_start)
                        found, marks = self._marked(x, self.position, begin, end)
                        n += found
                        self.marks[i, s * self.row_count + k] = marks
                    for k in range(ti.select(self.sees_wall[c] == 1, self.row_count, 0)):
                        begin, end = self._row(c, k, self.wall_cell_start)
                        m += self._counted(x, self.walls.position, begin, end)
            self.pairs.count[i] = ti.max(n, 0)  # -1 where the position is no number
            self.wall_pairs.count[i] = m
        for b in range(self.walls.count):
            n = 0
            for s in range(self.image_count):
                x = self.walls.position[b] + self.image[s]
                if self._near(x):
                    c = self._cell_index(x)
                    for k in range(self.row_count):
                        begin, end = self._row(c, k, self.cell_start)
                        n += self._counted(x, self.position, begin, end)
            self.wall_rows.count[b] = n

    @ti.func
    def _write(self, x, j, slot: ti.template(), rows: ti.template(), row, x_j, volume_j):
        d = x - x_j
        r2 = d.norm_sqr()
        if r2 < self.kernel.support_radius**2:
            k = rows.entry(row, slot)
            rows.index[k] = j
            rows.gradient[k] = d
            rows.weight[k] = volume_j
            slot += 1

    @ti.func
    def _weigh(self, rows: ti.template(), row, number):
        """Make gradients of the distances and weights of the volumes that `_write` has left in a row.

        In a loop of its own, whose reads and writes follow one another in memory, it is done in vectors.
        """
        begin = rows.entry(row, 0)
        for k in range(begin, begin + number):
            d, volume_j = rows.gradient[k], rows.weight[k]
            r = d.norm()
            rows.gradient[k] = (volume_j * self.kernel.gradient_factor(r)) * d
            rows.weight[k] = volume_j * self.kernel.value(r)

    @ti.func
    def _write_marked(self, x, marks, begin, end, rows: ti.template(), row, own, position: ti.template(),
                      volume: ti.template(), slot: ti.template()):
        """Write those of the candidates begin .. end - 1 that have marks, but for `own`."""
        if marks == EACH:
            for j in range(begin, end):
                if j != own:
                    self._write(x, j, slot, rows, row, position[j], volume[j])
        else:
            left = marks
            while left != 0:
                following = left & (left - 1)
                j = begin + ti.cast(ti.math.popcnt((left ^ following) - 1), ti.i32)
                if j != own:
                    self._write(x, j, slot, rows, row, position[j], volume[j])
                left = following

    @ti.func
    def _write_row(self, x, begin, end, rows: ti.template(), row, position: ti.template(), volume: ti.template(),
                   slot: ti.template()):
        """Find and write the neighbors among the candidates begin .. end - 1."""
        _, marks = self._marked(x, position, begin, end)
        self._write_marked(x, marks, begin, end, rows, row, -1, position, volume, slot)

    @ti.kernel
    def _fill(self):
        for i in range(self.particles.count[None]):
            n = 0
            m = 0
            walls = self.wall_pairs.count[i] > 0
            for s in range(self.image_count):
                x = self.position[i] + self.image[s]
                if self._near(x):
                    c = self._cell_index(x)
                    for k in range(self.row_count):
                        begin, end = self._row(c, k, self.cell_start)
                        self._write_marked(x, self.marks[i, s * self.row_count + k], begin, end, self.pairs, i, i,
                                           self.position, self.volume, n)
                        if walls:
                            begin, end = self._row(c, k, self.wall_cell_start)
                            self._write_row(x, begin, end, self.wall_pairs, i, self.walls.position, self.walls.volume,
                                            m)
            self._weigh(self.pairs, i, n)
            self._weigh(self.wall_pairs, i, m)
            self.pairs.count[i] = n
            self.wall_pairs.count[i] = m
        for b in range(self.walls.count):
            n = 0
            for s in range(ti.select(self.wall_rows.count[b] > 0, self.image_count, 0)):
                x = self.walls.position[b] + self.image[s]
                if self._near(x):
                    c = self._cell_index(x)
                    for k in range(self.row_count):
                        begin, end = self._row(c, k, self.cell_start)
                        self._write_row(x, begin, end, self.wall_rows, b, self.position, self.volume, n)
            self._weigh(self.wall_rows, b, n)
            self.wall_rows.count[b] = n

    @ti.kernel
    def _lay_out(self):
        """Give all rows their places, from their counts."""
        n = self.particles.count[None]
        for block in range(ti.max(blocks(n), blocks(self.walls.count))):
            self.pairs.count_block(block, n)
            self.wall_pairs.count_block(block, n)
            self.wall_rows.count_block(block, self.walls.count)
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.pairs.add_blocks(n)
            self.wall_pairs.add_blocks(n)
            self.wall_rows.add_blocks(self.walls.count)
        for block in range(ti.max(blocks(n), blocks(self.walls.count))):
            self.pairs.place_block(block, n)
            self.wall_pairs.place_block(block, n)
            self.wall_rows.place_block(block, self.walls.count)

    def sort(self) -> None:
        """Sort the liquid particles by cell."""
        if any(self.periods):
            self._wrap()
        self._counting_sort()
        self.particles.reorder()

    def build(self) -> None:
        """Write the neighbor rows of the current positions.

        Raises
        ------
        OutOfRoom
            When they do not fit: particles pile up far beyond rest density.
        """
        self._count()
        self._lay_out()
        for rows, what in ((self.pairs, "pairs of particles"), (self.wall_pairs, "pairs of a particle and the wall"),
                           (self.wall_rows, "pairs of the wall and a particle")):
            rows.check(what)
        self._fill()
