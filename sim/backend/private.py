"""Every name that is used of the library without its promise to keep it: what a new version may break.

Taichi and its forks agree in all but what is told apart here.
"""
import functools
import importlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from sim.backend import language  # noqa: F401  its settings come before the library
from sim.backend.choice import library

_IS_QUADRANTS = library().name == "quadrants"
_IS_FORGE = library().name == "taichi-forge"


def _module(name: str) -> Any:
    return importlib.import_module(f"{library().module}.{name}")


ast_context = _module("lang.ast.ast_transformer_utils")
exception = _module("lang.exception")
impl = _module("lang.impl")
kernel_impl = _module("lang.kernel_impl")
misc = _module("lang.misc")
primitive_types = _module("types.primitive_types")
template = _module("types").template
is_signed = _module("types.utils").is_signed
cook_dtype, python_scope, to_numpy_type = (
    getattr(_module("lang.util"), name) for name in ("cook_dtype", "python_scope", "to_numpy_type"))
Field = _module("lang.field").Field
ScalarField = _module("lang.field").ScalarField
Matrix, MatrixField, Vector = (getattr(_module("lang.matrix"), name) for name in ("Matrix", "MatrixField", "Vector"))
FieldsBuilder = _module("_snode.fields_builder").FieldsBuilder
Func, Kernel = kernel_impl.Func, kernel_impl.Kernel

current_config, default_config = impl.current_cfg, impl.default_cfg
runtime = impl.get_runtime  # another object after every start


def core() -> Path:
    """Return the file of the compiled library, of the format of the system."""
    return Path(getattr(_module("_lib.core"), f"{library().word.lower()}_python").__file__)


def on_cpu() -> bool:
    """Return whether the library runs on the CPU."""
    return current_config().arch in (misc.x64, misc.arm64)


def arguments_of(kernel) -> list:
    """Return the declared arguments of a kernel."""
    return kernel.arg_metas if _IS_QUADRANTS else kernel.arguments


def compiled(kernel) -> dict:
    """Return the handles of what a kernel was compiled to, by its function, the number of its templates, and more."""
    return kernel.materialized_kernels if _IS_QUADRANTS else kernel.compiled_kernels


def handle_of(kernel, key) -> Any:
    """Return the handle of a kernel that was launched, by its key in :func:`compiled`."""
    return compiled(kernel)[key]


def launch_of(kernel, key) -> Callable[[Any], Any]:
    """Return the function that launches, with a context, a kernel that was launched before."""
    program, handle = runtime().prog, handle_of(kernel, key)
    if _IS_FORGE:
        return functools.partial(program.compile_and_launch_kernel, program.config(), program.get_device_caps(), handle)
    code = (kernel.compiled_kernel_data_by_key[key] if _IS_QUADRANTS else
            program.compile_kernel(program.config(), program.get_device_caps(), handle))
    return functools.partial(program.launch_kernel, code)


def handle_in(arguments: tuple) -> Any:
    """Return the handle among the arguments of `Kernel.launch_kernel`."""
    return arguments[1 if _IS_QUADRANTS else 0]


def place_of_number(index: int) -> int | tuple[int]:
    """Return how a context of a launch calls its number of that index."""
    return index if _IS_QUADRANTS else (index,)
