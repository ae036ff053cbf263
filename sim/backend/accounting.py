"""Fields and kernels that the library holds for this process."""
import contextlib
import math
from collections.abc import Callable, Iterator

import numpy as np

from sim.backend.private import Field, FieldsBuilder, Func, compiled, runtime, to_numpy_type


def is_field(value: object) -> bool:
    """Return whether something is a field."""
    return isinstance(value, Field)


def size_of(field) -> int:
    """Memory of a field, bytes."""
    return math.prod(field.shape) * len(field.vars) * np.dtype(to_numpy_type(field.dtype)).itemsize


def allocated() -> int:
    """Memory of all fields of this process as they are laid out, bytes: their sizes, rounded up to 8 each."""
    runtime().materialize()
    return sum(root._cell_size_bytes for root in FieldsBuilder._finalized_roots())


def compiled_kernels() -> Iterator[tuple[object, object, tuple]]:
    """All kernels that this process has compiled: the function, the handle, and what the template arguments were.

    A fork may have forgotten these where the object is gone that a kernel was compiled for; there are none then.
    """
    for kernel in runtime().kernels:
        features = {instance: key for key, instance in kernel.mapper.mapping.items()}
        for (function, instance, _), handle in compiled(kernel).items():
            yield function, handle, features.get(instance, ())


@contextlib.contextmanager
def watched_functions(watch: Callable[[Callable], object]) -> Iterator[None]:
    """Tell `watch` every function that is compiled into a kernel while the context is open."""
    call = Func.__call__

    def watched(function, *arguments, **named):
        watch(function.func)
        return call(function, *arguments, **named)

    Func.__call__ = watched
    try:
        yield
    finally:
        Func.__call__ = call
