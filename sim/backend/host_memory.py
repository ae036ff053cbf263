"""Fields on the CPU, read and written as the memory that they are.

The library compiles a kernel for every field that is copied from or to NumPy, and one for every entry that is read or
written: more kernels than the solver has itself, at some 50 ms each. Here one kernel finds where a tree of fields lies.
"""
import ctypes
import math
import weakref

import numpy as np

from sim.backend.language import ti
from sim.backend.private import Matrix, MatrixField, ScalarField, Vector, python_scope, runtime, to_numpy_type

# Addresses of trees of fields, by number, for each start of Taichi.
_trees: weakref.WeakKeyDictionary = weakref.WeakKeyDictionary()
_KINDS = (ScalarField, MatrixField)
_NAMES = ("to_numpy", "from_numpy", "fill", "__getitem__", "__setitem__")
_by_kernels = {kind: {name: getattr(kind, name) for name in _NAMES} for kind in _KINDS}


@ti.kernel
def _address(field: ti.template()) -> ti.u64:
    return ti.get_addr(field, ti.static([0] * len(field.shape)))


def _place(component) -> int:
    """Address of the first entry of a component of a field."""
    node, offset = component.ptr.snode(), 0
    tree = node.get_snode_tree_id()
    while node is not None:
        offset += node.offset_bytes_in_parent_cell
        node = node.parent
    known = _trees.setdefault(runtime(), {})
    if tree not in known:
        known[tree] = int(_address(ScalarField(component))) - offset
    return known[tree] + offset


def _component(field, component) -> np.ndarray:
    """Memory of a component of a field, as an array of the field's shape."""
    kind = np.dtype(to_numpy_type(field.dtype))
    entry = component.ptr.snode().parent.cell_size_bytes
    strides = entry * np.cumprod((1, *field.shape[:0:-1]), dtype=np.int64)[::-1]
    extent = entry * (math.prod(field.shape) - 1) + kind.itemsize
    memory = (ctypes.c_char * extent).from_address(_place(component))
    return np.ndarray(field.shape, kind, memory, strides=strides[: len(field.shape)])


def _memory(field) -> list[np.ndarray]:
    """Memory of the components of a field, those of a matrix row by row.

    Raises
    ------
    RuntimeError
        When the library was started anew after the field was made: its memory is gone.
    """
    present = runtime()
    if not hasattr(field, "_memory"):
        present.materialize()
        field._memory = present, [_component(field, component) for component in field.vars]
    if field._memory[0] is not present:
        raise RuntimeError("the field is void: the library was started anew after it was made")
    return field._memory[1]


def _rows(field) -> tuple[int, ...]:
    """Shape of an entry, as the library gives it to NumPy."""
    if isinstance(field, ScalarField):
        return ()
    return (field.n,) if field.m == 1 else (field.n, field.m)


def _to_numpy(field, keep_dims: bool = False, dtype=None) -> np.ndarray:
    components = _memory(field)
    values = np.empty((*field.shape, len(components)), dtype or components[0].dtype)
    for k, component in enumerate(components):
        values[..., k] = component
    return values.reshape(field.shape + ((field.n, field.m) if keep_dims else _rows(field)))


def _from_numpy(field, values: np.ndarray) -> None:
    expected = field.shape + _rows(field)
    if np.shape(values) != expected:
        raise ValueError(f"the array has the shape {np.shape(values)}, but the field {expected}")
    components = _memory(field)
    values = np.reshape(values, (*field.shape, len(components)))
    for k, component in enumerate(components):
        component[...] = values[..., k]


def _fill(field, value) -> None:
    components = _memory(field)
    for component, one in zip(components, np.broadcast_to(value, (len(components),)), strict=True):
        component[...] = one


def _get(field, key):
    found = [component[() if key is None else key].item() for component in _memory(field)]
    if isinstance(field, ScalarField):
        return found[0]
    return Vector(found) if field.m == 1 else Matrix(np.reshape(found, (field.n, field.m)).tolist())


def _set(field, key, value) -> None:
    components = _memory(field)
    values = value.to_numpy() if isinstance(value, Matrix) else np.asarray(value)
    for component, one in zip(components, values.reshape(len(components)), strict=True):
        component[() if key is None else key] = one


def use(wanted: bool) -> None:
    """Let fields be read and written as memory, or by kernels again, as a GPU needs."""
    as_memory = dict(zip(_NAMES, (_to_numpy, _from_numpy, _fill, _get, _set), strict=True))
    for kind in _KINDS:
        for name, by_kernel in _by_kernels[kind].items():
            setattr(kind, name, python_scope(as_memory[name]) if wanted else by_kernel)
