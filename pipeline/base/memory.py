"""How much memory a process may have, and the one sentence in which a stage ends that gets too little of it.

A lack of memory has many faces: NumPy raises MemoryError, the loader of libraries ImportError, Taichi and threads
RuntimeError, and others end the process by a signal. `sentence_of` knows those that are raised, `sentence_of_signal`
those that leave an exit code only.
"""
import math
import os
import resource
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from types import FrameType, TracebackType
from typing import NoReturn

CGROUPS = Path("/sys/fs/cgroup")
INTERRUPTED = "error: interrupted; the same command goes on from here"
FAILED = 1  # exit code: the computer failed
LIBRARIES = 4.0 * 2**30  # address space, bytes, with which every stage starts: Taichi reserves 1 GiB at once, VTK 0.6
IMPORTS = 700.0 * 2**20  # that without which the libraries of some stage cannot even be loaded: measured 661 MiB
# What libraries say when they get no memory; of the loader, of Python's threads, of C++, of Taichi, of NumPy, of CUDA.
WORDS = ("failed to map segment", "cannot allocate memory", "can't start new thread", "bad_alloc",
         "virtual memory allocation", "unable to allocate", "out of memory", "out_of_memory")
CRASHES = (signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS, signal.SIGILL, signal.SIGFPE, signal.SIGTRAP)


def memory_of_computer() -> float:
    """Return the memory, bytes, that a process may have: of the computer, its control groups, or ``ulimit -v``."""
    limits = [float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")), address_space()]
    try:
        groups = [line.split(":", 2)[1:] for line in Path("/proc/self/cgroup").read_text().splitlines()]
    except OSError:
        groups = []
    for controllers, path in groups:  # version 2 has no names of controllers
        if controllers in ("", "memory"):
            top, name = (CGROUPS / "memory", "memory.limit_in_bytes") if controllers else (CGROUPS, "memory.max")
            folder = top / path.lstrip("/")
            limits += [_number(one / name) for one in (folder, *folder.parents) if one.is_relative_to(top)]
    return min(limits)


def address_space() -> float:
    """Return the address space, bytes, that this process may have (``ulimit -v``); infinite without a limit."""
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return math.inf if limit == resource.RLIM_INFINITY else float(limit)


def _number(path: Path) -> float:
    try:
        return float(path.read_text())  # "max" where there is no limit
    except (OSError, ValueError):
        return math.inf


def in_words(size: float) -> str:
    """Return bytes as people read them.

    >>> in_words(1.5 * 2**30), in_words(1000 * 2**20)
    ('1.5 GiB', '1000 MiB')
    """
    unit = max(0, min(4, math.floor(math.log(size, 1024.0)) - 2))
    shown = size / 1024.0 ** (unit + 2)
    return f"{shown:.{3 if shown < 999.5 else 4}g} {('MiB', 'GiB', 'TiB', 'PiB', 'EiB')[unit]}"


def sentence_of(error: BaseException, stage: str) -> str:
    """Return what to tell of an error that a lack of memory has caused, with a way out; empty for other errors."""
    for one in _chain(error):
        lines = [line.strip() for line in str(one).splitlines() if line.strip()]
        told = [line for line in lines if any(word in line.lower() for word in WORDS)]
        # Where there is too little for the libraries, Python itself has other words as well.
        lost = isinstance(one, (ImportError, SystemError)) and address_space() < LIBRARIES
        if told or lost or isinstance(one, MemoryError):
            reason = (told or lines or [""])[0].rstrip(".")
            return f"not enough memory to run {stage}{f' ({reason})' if reason else ''}: {_way_out()}"
    return ""


def sentence_of_signal(number: int, stage: str) -> str:
    """Return what to tell of a stage that a signal has ended; empty for those that people send to end it."""
    if number == signal.SIGKILL:
        return f"not enough memory to run {stage}, unless somebody has killed it (signal 9): {_way_out()}"
    if number in CRASHES:
        name = signal.Signals(number).name
        if address_space() < math.inf:
            return f"not enough memory to run {stage}, a library crashed ({name}): {_way_out()}"
        return f"{stage} crashed ({name}): if memory was full, take a coarser accuracy level, else tell the authors"
    return ""


def end_in_sentence(sentence: str) -> NoReturn:
    """Print a sentence as an error and leave at once: libraries that got no memory crash when they are shut down."""
    print(f"error: {sentence}", file=sys.stderr, flush=True)
    if sys.stdout is not None:
        sys.stdout.flush()
    os._exit(FAILED)


def refuse_too_little() -> None:
    """Leave where the libraries of `python -m pipeline.<stage>` cannot be loaded for lack of address space.

    Without a piece of it, here and there, they and Python itself crash, or hang (3.13), before any error can be told.
    """
    if address_space() < IMPORTS:
        module = sys.orig_argv[sys.orig_argv.index("-m") + 1]
        end_in_sentence(f"not enough memory to run {module.rpartition('.')[2]}: {_way_out()}")


def tell_of_imports(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Hook for errors that nobody has caught (``sys.excepthook``): also while the libraries of a stage are imported.

    Ctrl-C is one of them; the process then ends by that signal.
    """
    if issubclass(kind, KeyboardInterrupt):
        print(INTERRUPTED, file=sys.stderr, flush=True)
        return
    if sentence := sentence_of(error, Path(sys.argv[0]).stem):
        end_in_sentence(sentence)
    sys.__excepthook__(kind, error, trace)


def end_at_once(number: int, frame: FrameType | None) -> None:
    """Handler of Ctrl-C while libraries are imported: say so, and end by the signal.

    As an exception it would come up within the C code by which a library starts, which may lose it or crash.
    """
    os.write(2, f"{INTERRUPTED}\n".encode())
    signal.signal(number, signal.SIG_DFL)
    os.kill(os.getpid(), number)


def _way_out() -> str:
    """Return what is allowed, and what can be done about it."""
    limit = address_space()
    if limit < LIBRARIES:
        return (f"ulimit -v allows {in_words(limit)} of address space, but must allow at least {in_words(LIBRARIES)} "
                "(ulimit -v unlimited)")
    what = f"ulimit -v allows {in_words(limit)}" if limit < math.inf else (
        f"a process may have the {in_words(memory_of_computer())} of this computer, less what others use")
    return f"{what}; take a coarser accuracy level, fewer jobs at once (-j1), or more memory"


def _chain(error: BaseException | None) -> Iterator[BaseException]:
    """Yield an error and what it followed from."""
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__
