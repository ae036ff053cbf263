"""Half of the time before it compiles, Taichi 1.7.4 takes for what nobody reads, and for reading the same again.

Marks below every expression and broken lines are for messages of errors; and the source of a function is found and read
anew wherever it is called. Its forks remember both.
"""
import ast
import functools
import inspect
import linecache
import textwrap
from types import FunctionType, SimpleNamespace

from sim.backend.choice import library
from sim.backend.private import ast_context, kernel_impl


def _place(context, node: ast.expr) -> str:
    """Where a part of a kernel is, for messages of errors."""
    return (f'File "{context.file}", line {node.lineno + context.lineno_offset}, in {context.func.func.__name__}:\n'
            f"{context.src[node.lineno - 1]}\n")


@functools.cache
def _source(function: FunctionType) -> tuple[list[str], int]:
    """Lines of the source of a function, with its decorators, and the number of the first."""
    first = function.__code__.co_firstlineno
    return inspect.getblock(linecache.getlines(function.__code__.co_filename)[first - 1:]), first


def remember_sources() -> None:
    """Let the library read the source of every function once, and tell of errors in fewer words."""
    if library().name != "taichi":
        return
    ast_context.ASTTransformerContext.get_pos_info = _place
    kernel_impl.getsourcelines, kernel_impl.getsourcefile = _source, lambda function: function.__code__.co_filename
    kernel_impl.textwrap = SimpleNamespace(fill=functools.cache(textwrap.fill), dedent=textwrap.dedent)
