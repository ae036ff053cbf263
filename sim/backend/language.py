"""The language of kernels: `ti`, whichever library it is of, and the words of it that this project uses.

A fork can take Taichi's place where it has these words (`tests/solver/backend/test_language.py`).
"""
import importlib
from typing import TYPE_CHECKING

from sim.backend.choice import library

if TYPE_CHECKING:
    import taichi as ti  # for editors and mypy, whatever is chosen
else:
    library().silence()
    ti = importlib.import_module(library().module)

WORDS = frozenset((
    "kernel", "func", "template", "static", "loop_config", "ndrange", "grouped",
    "field", "Vector", "Vector.field", "Vector.zero", "Vector.unit",
    "Matrix", "Matrix.field", "Matrix.zero", "Matrix.identity", "Layout.SOA",
    "i32", "i64", "f32", "f64", "types.ndarray", "types.vector", "types.matrix",
    "cast", "select", "min", "max", "abs", "floor", "ceil", "round", "sqrt", "pow", "exp", "sin", "atomic_add",
    "math.clamp", "math.popcnt",
))
