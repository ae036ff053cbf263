"""Start of the library, once per process."""
import contextlib
import os
from typing import Any

import numpy as np

from sim.backend import host_memory
from sim.backend.choice import library
from sim.backend.compiling import remember_sources
from sim.backend.devices import AUTO, best_device
from sim.backend.language import ti
from sim.backend.private import current_config, default_config, runtime
from sim.backend.unrolling import leave_loops_rolled
from sim.cores import available_cores, keep_to_one_core, useful_threads

_started: dict[str, Any] = {}
_packed_field = ti.field
remember_sources()


class NoDevice(RuntimeError):
    """The library finds no such device on this computer."""


def initialize(precision: str = "f32", threads: int = 0, device: str = "cpu", *, keep_to_core: bool = False) -> None:
    """Start the library; a second call with the same arguments does nothing.

    Parameters
    ----------
    precision : "f32" or "f64", the type of every real field and literal.
    threads : number of worker threads; 0 for as many as it runs with already, else as many as are useful here;
        without meaning on a GPU.
    device : one of ``sim.backend.devices.DEVICES``; "auto" for that on which it runs already, else the best one here.
    keep_to_core : with one thread, keep the process to one core (``sim.cores.keep_to_one_core``); for processes that do
        nothing beside.

    Raises
    ------
    RuntimeError
        When it already runs with other arguments: one process has one precision, thread count and device.
    NoDevice
        Where the library would fall back to the CPU.
    """
    wanted: dict[str, Any] = {"precision": precision, "threads": threads or _started.get("threads") or useful_threads(),
              "device": _started.get("device") or best_device() if device == AUTO else device}
    if _started:
        if _started != wanted:
            raise RuntimeError(f"{library().title} already runs with {_started}, asked for {wanted}: use a process of "
                               "its own")
        return
    if keep_to_core and wanted["threads"] == 1 and wanted["device"] == "cpu":
        keep_to_one_core()
    options = leave_loops_rolled() if wanted["device"] == "cpu" else ""
    library().forget_settings()
    # Taichi would send its version, the system and a number of this user to its makers.
    os.environ[library().variable("skip_version_check")] = "ON"
    before, arch = _own_threads(), getattr(ti, wanted["device"])
    with contextlib.redirect_stdout(None):  # its greeting does not belong into the output of a stage
        ti.init(
            arch=arch, default_fp=ti.f32 if precision == "f32" else ti.f64, default_ip=ti.i32,
            cpu_max_num_threads=wanted["threads"], offline_cache=True, log_level=ti.ERROR, **dict(library().options),
            **_compiled_kernels(options),
        )
    if current_config().arch != arch:
        ti.reset()
        raise NoDevice(f"{library().title} finds no device {wanted['device']}")
    ti.field = _packed_field if wanted["device"] in ("cpu", "cuda") else _field_apart
    host_memory.use(wanted["device"] == "cpu")
    _started.update(wanted)
    if wanted["device"] == "cpu":
        _bind(sorted(_own_threads() - before)[-wanted["threads"]:])


def _compiled_kernels(options: str) -> dict[str, str]:
    """Argument of the start that keeps kernels of other options of LLVM apart, unless the user has named a folder."""
    folder = default_config().offline_cache_file_path
    fork = "" if library().module in folder else library().name  # one may have kept the folder of Taichi
    apart = [folder, *filter(None, (fork, options))]
    if len(apart) == 1 or library().variable("offline_cache_file_path") in os.environ:
        return {}
    return {"offline_cache_file_path": "-".join(apart)}


def _field_apart(dtype, shape: int | tuple[int, ...] = (), **more):
    """A field as `ti.field` makes it; one in double precision has a memory of its own.

    For Vulkan and Metal, Taichi 1.7.4 lays fields side by side without gaps, and one of 8 bytes that begins 4 bytes off
    silently overlaps the field before it (https://github.com/taichi-dev/taichi/issues/8803).
    """
    if dtype != ti.f64:
        return _packed_field(dtype, shape=shape, **more)
    field, memory = _packed_field(dtype, **more), ti.FieldsBuilder()
    sides = (shape,) if isinstance(shape, int) else shape
    (memory.dense(ti.axes(*range(len(sides))), sides) if sides else memory).place(field)
    memory.finalize()
    return field


def _own_threads() -> set[int]:
    """Numbers of the threads of this process, where the system (Linux) tells them."""
    try:
        return {int(name) for name in os.listdir("/proc/self/task")}
    except OSError:
        return set()


def _bind(workers: list[int]) -> None:
    """Give every worker a core of its own where they take all cores: else two may wait for one, at every kernel.

    The workers are the last threads that the library starts. Where cores are left to others, the system places them.
    """
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
    if 1 < len(workers) == len(cores) == available_cores():
        for worker, core in zip(workers, cores, strict=True):
            with contextlib.suppress(OSError):  # it is faster, but nothing depends on it
                os.sched_setaffinity(worker, {core})


def shut_down() -> None:
    """Free all fields of this process; solvers made before are void, and the library may be started anew."""
    ti.reset()
    _started.clear()


def restart(**changes: object) -> None:
    """Free all fields of this process and start the library again as it was, but for changed arguments of `initialize`.

    Solvers made before are void.
    """
    arguments = _started | changes
    shut_down()
    initialize(**arguments)


def sync() -> None:
    """Wait until all kernels that were launched have ended; fields that were declared get their memory."""
    ti.sync()


def present_start() -> object:
    """Return an object that is another one after every start of the library."""
    return runtime()


def has_fields() -> bool:
    """Return whether fields have got their memory since the start."""
    return runtime().materialized


def device() -> str:
    """Device of this process."""
    return str(_started["device"])


def real():
    """Type of the language of the real fields of this process."""
    return ti.f32 if _started["precision"] == "f32" else ti.f64


def real_numpy():
    """NumPy type of the real fields of this process."""
    return np.float32 if _started["precision"] == "f32" else np.float64
