"""The stages of the pipeline: scene, eye, voxelize, simulate, reconstruct, render, movie, metrics.

As a library: ``pipeline.run``, ``pipeline.open_run``, ``pipeline.plan_fill``, ``pipeline.oil_at_rest``.
"""
import importlib
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pipeline.base.errors import UserError
    from pipeline.library.oil_at_rest import oil_at_rest
    from pipeline.library.run import open_run, run
    from pipeline.planning.plan import plan_fill

# `python -m pipeline.<stage>`: its libraries may find no memory before the stage itself is reached.
if sys.argv[:1] == ["-m"]:
    import atexit
    import signal

    from pipeline.base.memory import end_at_once, refuse_too_little, tell_of_imports

    sys.excepthook = tell_of_imports
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, end_at_once)
    # All has been written then: what Python still has to free is nothing to be interrupted, and would end in silence.
    atexit.register(signal.signal, signal.SIGINT, signal.SIG_IGN)
    refuse_too_little()

    from pipeline.base.surroundings import refuse_missing_backend, shut_out_foreign_settings

    shut_out_foreign_settings()
    refuse_missing_backend()

# Imported when first asked for: a stage that needs none of this starts sooner.
_LIBRARY = {"run": "pipeline.library.run", "open_run": "pipeline.library.run",
            "oil_at_rest": "pipeline.library.oil_at_rest", "plan_fill": "pipeline.planning.plan",
            "UserError": "pipeline.base.errors"}
__all__ = ["UserError", "oil_at_rest", "open_run", "plan_fill", "run"]


def __getattr__(name: str) -> Any:
    if name not in _LIBRARY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_LIBRARY[name]), name)
