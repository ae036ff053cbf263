"""Neighbor rows: who is near whom, with the cached kernel values. The only place that knows how they lie in memory.

The loop over the neighbors of i is the same everywhere:

    for slot in range(rows.count[i]):
        k = rows.entry(i, slot)
        ... rows.index[k], rows.gradient[k], rows.weight[k]

Rows lie one behind the other without gaps, every component of a gradient in an array of its own: a pass over all pairs
then streams through memory once and fills the vector registers of a processor without picking components apart (a
product with the pressure matrix takes three quarters of the time that it takes with the components side by side).
"""
import math

import numpy as np

from sim.backend import data_oriented, real, real_numpy, ti
from sim.errors import OutOfRoom
from sim.reductions import first, last, partial_results, running_total

HEAD_ROOM = 1.4  # entries allocated, over those of particles at rest density
COUNTING_SLACK = 1e-5  # of the squared support radius: rows are counted and written by different loops


def entries_at_rest(rows: int, wall_depth: np.ndarray, support_ratio: float, particle_spacing: float,
                    dimension: int) -> tuple[float, float]:
    """Return the entries of liquid-liquid rows and of liquid-wall rows where the liquid is at rest density everywhere.

    Parameters
    ----------
    rows : liquid particles.
    wall_depth : (m,), depth of the wall particles behind the surface, m; all of them are wetted.
    support_ratio : support radius over particle spacing.
    """
    h, depth = support_ratio, np.clip(np.asarray(wall_depth) / particle_spacing, 0.0, support_ratio)
    if dimension == 2:
        ball, cap = math.pi * h**2, h**2 * np.arccos(depth / h) - depth * np.sqrt(h**2 - depth**2)
    else:
        ball, cap = 4.0 / 3.0 * math.pi * h**3, math.pi / 3.0 * (h - depth) ** 2 * (2.0 * h + depth)
    return rows * ball, float(cap.sum())


@data_oriented
class NeighborRows:
    """The neighbors of `rows` particles.

    Parameters
    ----------
    rows : number of particles. entries : neighbors of all of them together that fit.

    Attributes
    ----------
    count : (rows,), neighbors of every particle.
    index, gradient, weight : (entries,), who; V_j grad_i W_ij, 1/m; V_j W_ij.
    member, member_count : the particles that may have any neighbor, in order: near a wall they are few.
    """

    def __init__(self, rows: int, entries: int, dimension: int):
        if entries >= 2**31:
            raise OverflowError(f"{entries} neighbors are more than rows can hold ({2**31 - 1})")
        self.rows, self.entries = rows, max(entries, 1)
        self.count = ti.field(ti.i32, shape=max(rows, 1))
        self.start = ti.field(ti.i32, shape=max(rows, 1))
        self.index = ti.field(ti.i32, shape=self.entries)
        self.gradient = ti.Vector.field(dimension, real(), shape=self.entries, layout=ti.Layout.SOA)
        self.weight = ti.field(real(), shape=self.entries)
        self.member = ti.field(ti.i32, shape=max(rows, 1))
        self.needed, self.member_count = (ti.field(ti.i32, shape=()) for _ in range(2))
        self.partial = partial_results(2)

    @ti.func
    def entry(self, i, s):
        """Place of the neighbor s of particle i in `index`, `gradient` and `weight`."""
        return self.start[i] + s

    def per_entry(self, components: int = 0, kind=None):
        """Return a field with a number, or a vector of so many components, for every entry."""
        if components:
            return ti.Vector.field(components, real(), shape=self.entries, layout=ti.Layout.SOA)
        return ti.field(kind or real(), shape=self.entries)

    # Rows get their places, from the counts of the first n of them, in three loops over blocks. These have to stand in
    # a kernel (`sim.reductions`), which several rows share.

    @ti.func
    def count_block(self, block, n):
        """Sum up the neighbors, and the particles that have any, of a block of rows; the first of the three."""
        total = 0
        members = 0
        for i in range(first(block, n), last(block, n)):
            total += self.count[i]
            members += ti.cast(self.count[i] > 0, ti.i32)
        self.partial[0, block] = total
        self.partial[1, block] = members

    @ti.func
    def add_blocks(self, n):
        """Add up what the blocks have; the second, done by one thread."""
        self.needed[None] = ti.cast(ti.min(running_total(self.partial, 0, n), 2.0e9), ti.i32)
        self.member_count[None] = ti.cast(running_total(self.partial, 1, n), ti.i32)

    @ti.func
    def place_block(self, block, n):
        """Give a block of rows its places; the third."""
        place = ti.cast(self.partial[0, block], ti.i32)
        member = ti.cast(self.partial[1, block], ti.i32)
        for i in range(first(block, n), last(block, n)):
            self.start[i] = place
            place += self.count[i]
            if self.count[i] > 0:
                self.member[member] = i
                member += 1

    def check(self, what: str) -> None:
        """Raise OutOfRoom where the rows that were laid out do not fit."""
        if self.needed[None] > self.entries:
            raise OutOfRoom(f"there are {self.needed[None]} {what} where {self.entries} fit: particles pile up")

    def bytes(self) -> int:
        """Memory of the rows."""
        item = np.dtype(real_numpy()).itemsize
        return 12 * self.rows + self.entries * (4 + item * (self.gradient.n + 1))
