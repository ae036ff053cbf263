"""Kernels of objects give what Taichi's own launches give, whatever is given to them and after a new start."""
import gc
import re
import weakref
from pathlib import Path

import numpy as np
import pytest
from helpers.cases import thorough

from sim.backend import ti
from sim.backend.errors import KernelSyntaxError, KernelTypeError
from sim.backend.launching import counted_launches, data_oriented
from sim.backend.runtime import restart

ROOT = Path(__file__).parents[3]
pytestmark = pytest.mark.usefixtures("taichi")


@data_oriented
class Sums:
    """Fields to which kernels add."""

    def __init__(self):
        self.first, self.second = (ti.field(ti.f64, shape=3) for _ in range(2))

    @ti.kernel
    def add(self, values: ti.template(), factor: float, twice: ti.template(), number: ti.i32):
        for i in values:
            values[i] += factor * number
            if ti.static(twice):
                values[i] += factor * number

    @ti.kernel
    def add_array(self, more: ti.types.ndarray()):
        for i in self.first:
            self.first[i] += more[i]

    @ti.kernel
    def largest(self) -> ti.f64:
        found = self.first[0]
        ti.loop_config(serialize=True)
        for i in range(3):
            found = ti.max(found, self.first[i])
        return found


class MoreSums(Sums):
    """One that inherits its kernels."""


@data_oriented
class OtherSums(Sums):
    """One that replaces a kernel by another, and can still use the one of its base."""

    @ti.kernel
    def add(self, values: ti.template(), factor: float, twice: ti.template(), number: ti.i32):
        for i in values:
            values[i] -= factor * number

    def add_both(self, *arguments) -> None:
        super().add(*arguments)
        self.add(*arguments)


@pytest.mark.parametrize("kind", [thorough(Sums), MoreSums])
def test_every_launch_has_its_own_numbers_and_fields(kind):
    sums, other = kind(), kind()
    for number in (1, 2, 3):
        sums.add(sums.first, 0.5, False, number)
        sums.add(sums.second, 2, True, np.int32(number))
        other.add(other.first, np.float64(10.0), False, number)
    sums.add_array(np.array([0.0, 1.0, 2.0]))
    sums.add_array(np.array([0.0, 1.0, 2.0]))
    assert sums.first.to_numpy().tolist() == [3.0, 5.0, 7.0]
    assert sums.second.to_numpy().tolist() == [24.0] * 3
    assert other.first.to_numpy().tolist() == [60.0] * 3
    assert sums.largest() == 7.0


def test_a_class_may_replace_a_kernel():
    sums = OtherSums()
    for _ in range(2):
        sums.add_both(sums.first, 1.0, True, 1)
    assert sums.first.to_numpy().tolist() == [2.0] * 3


def test_arguments_may_be_named():
    sums = Sums()
    for _ in range(2):
        sums.add(sums.first, 0.5, twice=False, number=4)
    assert sums.first[0] == 4.0


def test_wrong_arguments_are_refused_at_every_launch():
    sums = Sums()
    for _ in range(2):
        with pytest.raises((KernelTypeError, TypeError)):
            sums.add(sums.first, 0.5, False, 1.5)
        sums.add(sums.first, 0.5, False, 1)
        with pytest.raises(KernelSyntaxError, match="number"):
            sums.add(sums.first, 0.5, False)
    assert sums.first[0] == 1.0


def test_every_launch_is_counted():
    sums = Sums()
    sums.add(sums.first, 1.0, False, 1)
    with counted_launches() as launches:
        for _ in range(3):
            sums.add(sums.first, 1.0, False, 1)
        sums.add(sums.second, 1.0, False, 1)
    sums.add(sums.first, 1.0, False, 1)
    assert sorted(launches.values()) == [1, 3]


def test_kernels_are_found_again_after_a_new_start_of_taichi():
    sums = Sums()
    sums.add(sums.first, 1.0, False, 1)
    restart()
    sums.first, sums.second = (ti.field(ti.f64, shape=3) for _ in range(2))
    for _ in range(2):
        sums.add(sums.first, 1.0, False, 2)
    assert sums.first.to_numpy().tolist() == [4.0] * 3


def test_all_classes_with_kernels_launch_them_so():
    own = (path for room in ("sim", "pipeline", "studies") for path in (ROOT / room).rglob("*.py"))
    assert [path for path in own if re.search(r"^ *@ti\.data_oriented", path.read_text(), re.MULTILINE)] == []


def test_an_object_that_nobody_holds_is_gone():
    sums = Sums()
    for _ in range(2):
        sums.add(sums.first, 1.0, False, 1)
    left = weakref.ref(sums)
    del sums
    gc.collect()
    assert left() is None
