
from sim.backend import ti

"""Sums and extreme values over particles whose last digit does not depend on the number of threads.

Particles are taken in blocks; one thread works through one block in order, and the partial results of the blocks are
put together in order as well. The size of a block follows from the number of particles alone:

    for block in range(blocks(n)):
        total = ti.cast(0.0, ti.f64)
        for i in range(first(block, n), last(block, n)):
            total += ...
        self.partial[0, block] = total
    ti.loop_config(serialize=True)
    for _ in range(1):
        ... = total_of(self.partial, 0, n)

The loop over blocks has to stand in the kernel itself: Taichi makes only those loops parallel. And it gives a thread of
the CPU `TASK` turns of a loop at a time, whatever it is asked for, so that a few hundred blocks are worked through by
one thread: what costs time for each entry belongs into a loop over the entries before.
"""

TASK = 512  # turns of a loop that Taichi gives to a thread of the CPU at a time
SMALLEST_BLOCK = 64  # entries of a block: enough blocks for the threads with a few thousand particles
MOST_BLOCKS = 4096  # partial results that one thread puts together


def partial_results(columns: int):
    """Return the field (columns, blocks) of the partial results of several reductions, double precision."""
    return ti.field(ti.f64, shape=(columns, MOST_BLOCKS))


@ti.func
def block_size(n):
    """Entries per block."""
    return ti.max(SMALLEST_BLOCK, (n + MOST_BLOCKS - 1) // MOST_BLOCKS)


@ti.func
def blocks(n):
    """Number of blocks of n entries."""
    size = block_size(n)
    return (n + size - 1) // size


@ti.func
def first(block, n):
    """First entry of a block."""
    return block * block_size(n)


@ti.func
def last(block, n):
    """Entry after the last one of a block."""
    return ti.min(n, (block + 1) * block_size(n))


@ti.func
def total_of(partial: ti.template(), column, n):
    """Sum of the partial sums of n entries."""
    total = ti.cast(0.0, ti.f64)
    for block in range(blocks(n)):
        total += partial[column, block]
    return total


@ti.func
def running_total(partial: ti.template(), column, n):
    """Replace the partial sums of n entries by the sums of those before; return the sum of all."""
    total = ti.cast(0.0, ti.f64)
    for block in range(blocks(n)):
        before = total
        total += partial[column, block]
        partial[column, block] = before
    return total


@ti.func
def largest_of(partial: ti.template(), column, n):
    """Largest of the partial maxima of n entries; that of no entries is 0."""
    largest = ti.cast(0.0, ti.f64)
    if n > 0:
        largest = partial[column, 0]
    for block in range(1, blocks(n)):
        largest = ti.max(largest, partial[column, block])
    return largest


@ti.func
def least_of(partial: ti.template(), column, n):
    """Smallest of the partial minima of n entries; that of no entries is 0."""
    least = ti.cast(0.0, ti.f64)
    if n > 0:
        least = partial[column, 0]
    for block in range(1, blocks(n)):
        least = ti.min(least, partial[column, block])
    return least
