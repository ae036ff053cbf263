"""The library that compiles kernels: Taichi, or a fork of it. Nothing else of the project imports it.

Files with kernels import the language, and what goes with it, by one line::

    from sim.backend import data_oriented, real, ti

====================  ==================================================================================
`choice`              which library it is
`language`            `ti`, and the words of it that kernels may be written in
`errors`              what it raises where a kernel is wrong
`private`             every name that is used without the library's promise to keep it
`runtime`             start and end
`devices`             on which of the devices of this computer it runs (`device_trial` tries one)
`launching`           classes with kernels
`host_memory`         fields without kernels that copy them
`accounting`          fields and kernels that there are
`compiling`           less time before a kernel is compiled
`unrolling`           less time to compile it
====================  ==================================================================================
"""
import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sim.backend.language import ti
    from sim.backend.launching import data_oriented
    from sim.backend.runtime import device, real, real_numpy, sync

# Imported when they are first asked for: who only wants to know the devices does not wait for the library.
_PLACES = {"ti": "language", "data_oriented": "launching", "device": "runtime", "real": "runtime",
           "real_numpy": "runtime", "sync": "runtime"}
__all__ = ["data_oriented", "device", "real", "real_numpy", "sync", "ti"]


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_PLACES[name]}"), name)
