"""Fields read and written as memory hold what kernels see in them."""
import numpy as np
import pytest

from sim.backend import host_memory, ti
from sim.backend.runtime import restart

pytestmark = pytest.mark.usefixtures("taichi")
FIELDS = {
    "number": lambda: ti.field(ti.i32, shape=()),
    "numbers": lambda: ti.field(ti.i32, shape=7),
    "grid": lambda: ti.field(ti.f64, shape=(3, 4, 5)),
    "vector": lambda: ti.Vector.field(3, ti.f64, shape=()),
    "vectors": lambda: ti.Vector.field(3, ti.f32, shape=5, layout=ti.Layout.SOA),
    "vectors side by side": lambda: ti.Vector.field(2, ti.f64, shape=(4, 3)),
    "tensors": lambda: ti.Matrix.field(2, 2, ti.f64, shape=6, layout=ti.Layout.SOA),
}


@pytest.fixture(scope="module")
def fields(taichi):
    """Return a field of every kind, with others between them in memory."""
    made = {}
    for name, make in FIELDS.items():
        made[name] = make()
        ti.field(ti.i32, shape=3)
    return made


def values_for(field) -> np.ndarray:
    """Return values that differ everywhere."""
    shape = host_memory._by_kernels[type(field)]["to_numpy"](field).shape
    return np.asarray(1.0 + np.arange(np.prod(shape, dtype=int)).reshape(shape), field.to_numpy().dtype)


@pytest.mark.parametrize("name", FIELDS)
def test_memory_is_what_kernels_see(fields, name):
    """Both ways, beside the copies by kernels that Taichi makes itself."""
    field, by_kernels = fields[name], host_memory._by_kernels[type(fields[name])]
    values = values_for(field)
    field.from_numpy(values)
    np.testing.assert_array_equal(by_kernels["to_numpy"](field), values, strict=True)
    by_kernels["from_numpy"](field, np.asarray(values + 1, values.dtype))
    np.testing.assert_array_equal(field.to_numpy(), values + 1)
    last = tuple(size - 1 for size in field.shape) or None
    assert np.array_equal(field[last], by_kernels["__getitem__"](field, last))
    field[last] = field[last] + 1
    assert np.array_equal(by_kernels["__getitem__"](field, last), values[last or ()] + 2)
    field.fill(3)
    assert (by_kernels["to_numpy"](field) == 3).all()


@pytest.mark.parametrize("name", FIELDS)
def test_arrays_of_another_shape_are_refused(fields, name):
    with pytest.raises(ValueError, match="the array has the shape"):
        fields[name].from_numpy(np.zeros((2, 2, 2, 2)))


def test_a_copy_is_no_view(fields):
    copy = fields["numbers"].to_numpy()
    before = copy.copy()
    fields["numbers"].fill(before[0] + 1)
    np.testing.assert_array_equal(copy, before)


def test_void_field_is_refused():
    field = ti.field(ti.f64, shape=3)
    field.fill(1.0)
    restart()
    with pytest.raises(RuntimeError, match="the field is void"):
        field.to_numpy()
