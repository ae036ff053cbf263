"""How many cores this process may use, and keeping to one of them."""
import contextlib
import math
import os
import tempfile
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

# More are not taken unasked: kernels over some 100,000 particles are short, and each waits for its slowest thread.
USEFUL_THREADS = 16

_held: list[int] = []  # locks of the core that this process keeps to


def available_cores() -> int:
    """Return the cores that this process may use: those it is bound to, or fewer where its container grants fewer."""
    granted = granted_cores()
    bindable = hasattr(os, "sched_getaffinity")  # not on macOS
    bound = len(os.sched_getaffinity(0)) if bindable else os.cpu_count() or 1
    return bound if math.isinf(granted) else max(1, min(bound, math.ceil(granted)))


def useful_threads() -> int:
    """Return how many threads a solver gets that may use every core."""
    return min(available_cores(), USEFUL_THREADS)


def keep_to_one_core(folder: Path | None = None) -> int | None:
    """Bind this process, and those that it will start, to one core that no other process has taken so.

    A loop of Taichi is handed from the thread that calls it to a worker. Where both are on one core that takes 20
    microseconds; where the worker sleeps on another core, 50 to 100: as much as many a loop over 5,000 particles.
    The core on which the process runs is tried first, since what else runs on a computer is mostly on others.

    Parameters
    ----------
    folder : of the locks, one for each core, which are held until the process ends; that of temporary files.

    Returns
    -------
    The core; None where all are taken, or where processes cannot be bound or files not locked. Nothing depends on it.
    """
    if fcntl is None or not hasattr(os, "sched_setaffinity"):
        return None
    with contextlib.suppress(OSError):
        present = _present_core()
        folder = folder or Path(tempfile.gettempdir())
        for core in sorted(os.sched_getaffinity(0), key=lambda core: (core != present, core)):
            lock = _lock(folder / f"eye_oil_core_{core}")
            if lock is not None:
                _held.append(lock)
                os.sched_setaffinity(0, {core})
                return core
    return None


def _present_core() -> int:
    """The core on which this process runs."""
    return int(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[36])


def _lock(path: Path) -> int | None:
    """Take a lock that all users share; None where another process holds it, or its user does not share it."""
    lock = None
    try:
        if not path.exists():
            os.close(os.open(path, os.O_CREAT | os.O_RDONLY | os.O_NOFOLLOW, 0o644))
        lock = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)  # a pipe of that name would wait
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return lock
    except OSError:
        if lock is not None:
            os.close(lock)
        return None


def granted_cores(root: Path = Path("/")) -> float:
    """Return the share of time that the control groups of this process grant, in cores; infinite without a limit.

    Parameters
    ----------
    root : folder in which ``proc`` and ``sys`` are.
    """
    try:
        lines = (root / "proc/self/cgroup").read_text().splitlines()
    except OSError:
        return math.inf
    granted = math.inf
    for line in lines:
        _, controllers, place = line.split(":", 2)
        if controllers and "cpu" not in controllers.split(","):
            continue
        top = root / "sys/fs/cgroup" / ("cpu" if controllers else "")
        # In a container the place may be that on the host, which is not to be seen: its own group is then at the top.
        group = top / place.lstrip("/")
        for folder in (group, *group.parents):
            granted = min(granted, _granted_first(folder) if controllers else _granted(folder))
            if folder == top:
                break
    return granted


def _granted(group: Path) -> float:
    """Cores that a control group of version 2 grants."""
    try:
        quota, period = (group / "cpu.max").read_text().split()
        return math.inf if quota == "max" else int(quota) / int(period)
    except (OSError, ValueError, ZeroDivisionError):
        return math.inf


def _granted_first(group: Path) -> float:
    """Cores that a control group of version 1 grants."""
    try:
        quota, period = (int((group / f"cpu.cfs_{name}_us").read_text()) for name in ("quota", "period"))
        return quota / period if quota > 0 else math.inf
    except (OSError, ValueError, ZeroDivisionError):
        return math.inf
