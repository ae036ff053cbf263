"""Sums, largest and least values over blocks, for any number of entries."""
import numpy as np
import pytest

from sim.backend import data_oriented, ti
from sim.reductions import (
    MOST_BLOCKS,
    SMALLEST_BLOCK,
    blocks,
    first,
    largest_of,
    last,
    least_of,
    partial_results,
    running_total,
    total_of,
)

pytestmark = pytest.mark.usefixtures("taichi")
MOST = 3 * MOST_BLOCKS * SMALLEST_BLOCK


@data_oriented
class Reduced:
    """All reductions of one array."""

    def __init__(self):
        self.values = ti.field(ti.f64, shape=MOST)
        self.partial = partial_results(4)
        self.found = ti.field(ti.f64, shape=4)
        self.before = ti.field(ti.f64, shape=MOST)

    @ti.kernel
    def reduce(self, n: int):
        for block in range(blocks(n)):
            total = ti.cast(0.0, ti.f64)
            largest, least = self.values[first(block, n)], self.values[first(block, n)]
            for i in range(first(block, n), last(block, n)):
                total += self.values[i]
                largest = ti.max(largest, self.values[i])
                least = ti.min(least, self.values[i])
            for column in ti.static((0, 3)):
                self.partial[column, block] = total
            self.partial[1, block] = largest
            self.partial[2, block] = least
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.found[0] = total_of(self.partial, 0, n)
            self.found[1] = largest_of(self.partial, 1, n)
            self.found[2] = least_of(self.partial, 2, n)
            self.found[3] = running_total(self.partial, 3, n)
        for block in range(blocks(n)):
            before = self.partial[3, block]
            for i in range(first(block, n), last(block, n)):
                self.before[i] = before
                before += self.values[i]


@pytest.fixture(scope="module")
def reduced():
    return Reduced()


@pytest.mark.parametrize("n", [0, 1, SMALLEST_BLOCK, SMALLEST_BLOCK + 1, 5057, MOST])
def test_every_entry_counts_once(reduced, n):
    """Whole numbers, so that sums are exact in any order; what lies beyond the last entry does not count."""
    values = np.random.default_rng(n).integers(-1000, 1000, MOST).astype(float)
    reduced.values.from_numpy(values)
    reduced.reduce(n)
    total, largest, least, running = reduced.found.to_numpy()
    assert total == running == values[:n].sum()
    assert (largest, least) == ((values[:n].max(), values[:n].min()) if n else (0.0, 0.0))
    np.testing.assert_array_equal(reduced.before.to_numpy()[:n], np.r_[0.0, np.cumsum(values[:n])][:n])
