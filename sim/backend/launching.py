"""Kernels of objects, launched without what the library does anew at every launch.

Taichi 1.7.4 looks for the kernel of the arguments, makes a context and asks for the compiled code whenever a kernel
is launched, and every attribute of an object with kernels is looked up by a function in Python. That was 17 of
127 ms of processor time of a step of 5,000 particles. Here an object remembers, for each of its kernels and the fields
given to it, the compiled code and the context; a launch sets the numbers and starts.
"""
import contextlib
import dataclasses
import operator
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

from sim.backend.language import ti
from sim.backend.private import (
    Kernel,
    arguments_of,
    cook_dtype,
    handle_in,
    handle_of,
    is_signed,
    launch_of,
    on_cpu,
    place_of_number,
    primitive_types,
    runtime,
    template,
)

_VALUES = (bool, int, float, str)  # templates that are compiled in; others are fields and objects
_MADE = "_launchers"


@dataclasses.dataclass(slots=True)
class _Compiled:
    """A kernel for certain templates; they are kept alive, so that no other object takes their place in memory."""

    runtime: Any  # the start of the library that it belongs to
    handle: Any
    start: Callable[[Any], Any]  # of a context
    context: Any  # None where each launch needs one of its own
    templates: tuple


_counter: Counter | None = None


@contextlib.contextmanager
def counted_launches() -> Iterator[Counter]:
    """Count how often every compiled kernel is launched, by its handle, while the context is open."""
    global _counter
    launch, before, launches = Kernel.launch_kernel, _counter, Counter()

    def counted(kernel, *arguments, **named):
        launches[handle_in(arguments)] += 1
        return launch(kernel, *arguments, **named)

    Kernel.launch_kernel, _counter = counted, launches
    try:
        yield launches
    finally:
        Kernel.launch_kernel, _counter = launch, before


def _setter(annotation) -> tuple[str, Callable] | None:
    """Method of a context that sets a number, and what makes a number of an argument; None for other arguments."""
    if id(annotation) in primitive_types.real_type_ids:
        return "set_arg_float", float
    if id(annotation) in primitive_types.integer_type_ids:
        return "set_arg_int" if is_signed(cook_dtype(annotation)) else "set_arg_uint", operator.index
    return None


def _launcher(kernel, owner) -> Callable[..., Any]:
    """Return the function that launches a kernel of an object."""
    annotations = [argument.annotation for argument in arguments_of(kernel)[1:]]  # without the object
    templates = [place for place, one in enumerate(annotations) if isinstance(one, template)]
    numbers = [(place, _setter(one)) for place, one in enumerate(annotations) if place not in templates]
    if kernel.return_type is not None or not all(setter for _, setter in numbers):
        return lambda *arguments, **named: kernel(owner, *arguments, **named)
    setters = [(place, place_of_number(index), *setter) for index, (place, setter) in enumerate(numbers) if setter]
    known: dict[tuple, _Compiled] = {}

    def launch(*arguments, **named):
        if named or len(arguments) != len(annotations):
            kernel(owner, *arguments, **named)
            return
        given = tuple([arguments[place] for place in templates])
        key = tuple([one if isinstance(one, _VALUES) else id(one) for one in given])
        found = known.get(key)
        if found is None or found.runtime is not runtime():
            kernel(owner, *arguments)
            known[key] = _compiled(kernel, owner, arguments, given)
            return
        context = found.context or found.handle.make_launch_context()
        for place, index, setter, number_of in setters:
            getattr(context, setter)(index, number_of(arguments[place]))
        if _counter is not None:
            _counter[found.handle] += 1
        found.start(context)

    return launch


def _compiled(kernel, owner, arguments: tuple, templates: tuple) -> _Compiled:
    """What a kernel became that was just launched."""
    key = kernel.ensure_compiled(owner, *arguments)
    handle = handle_of(kernel, key)
    context = handle.make_launch_context() if on_cpu() else None  # on a GPU a launch leaves its own addresses in it
    return _Compiled(runtime(), handle, launch_of(kernel, key), context, templates)


class _KernelOfObjects:
    """A kernel as an attribute of a class: of an object it is a function that launches it, made once."""

    def __init__(self, kernel):
        self.kernel = kernel
        self.__doc__ = kernel.func.__doc__

    def __get__(self, owner, kind=None):
        if owner is None:
            return self
        made = owner.__dict__.setdefault(_MADE, {})  # by kernel, since a class may replace one of its base
        if self not in made:
            made[self] = _launcher(self.kernel, owner)
        return made[self]


def data_oriented(kind: type) -> type:
    """Let a class have kernels, as ``ti.data_oriented`` does."""
    kernels = {name: value._primal for name, value in vars(kind).items() if getattr(value, "_is_classkernel", False)}
    kind = ti.data_oriented(kind)
    if "__getattribute__" in vars(kind):  # by which Taichi looks for kernels
        del kind.__getattribute__
    for name, kernel in kernels.items():
        setattr(kind, name, _KernelOfObjects(kernel))
    return kind
