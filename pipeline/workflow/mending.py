"""What a run finds in its folder that would mislead it: files with flipped bytes, dates in the future, no locks."""
import errno
import fcntl
import os
import time
from collections.abc import Iterable
from pathlib import Path

from pipeline.base.checksum import DamagedFile, check

CHECKED = (".npz", ".vtu", ".vtp", ".vti")  # files that end in a checksum
DAMAGED = "damaged"  # folder of a run, for what is set aside
NO_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS)


def hold(folder: Path) -> int:
    """Lock a folder until this process ends, however it ends, and return its descriptor.

    Raises
    ------
    BlockingIOError : another process holds it.
    """
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno not in NO_LOCKS:
            raise
        print(f"warning: {folder}: this disk has no locks, so that nothing keeps a second snakemake out; start one at "
              "a time", flush=True)
    return descriptor


def end_future(folder: Path) -> None:
    """Date all files of a run that are dated in the future to the present.

    A clock that was put back leaves such files. They would stay newer than what is made of them, and all of that would
    be made again in every run, until the clock has caught up.
    """
    now = time.time()
    for path in folder.rglob("*"):
        if path.is_file() and path.stat().st_mtime > now + 1.0:
            os.utime(path)


def logs_below(outputs: Path) -> list[Path]:
    """Return all logs: of the software, of comparisons, of scenes at a level, and of studies at a level."""
    return sorted(log for folder in ("", "*/", "*/*/", "studies/*/*/") for log in outputs.glob(f"{folder}logs/*.log"))


def changes(logs: Iterable[Path]) -> dict[Path, tuple[int, int]]:
    """Return what changes when one writes to files, whatever the clock does: date (ns) and size of each."""
    return {log: (log.stat().st_mtime_ns, log.stat().st_size) for log in logs}


def set_aside_damaged(run: Path, sentences: Iterable[str]) -> list[str]:
    """Move files of a run whose checksum does not fit out of the way, so that Snakemake makes them again.

    Parameters
    ----------
    run : folder of a scene at one level.
    sentences : errors of stages, `<file>: <what is wrong>`; only the files that they name are looked at.

    Returns
    -------
    A sentence for everything that was moved: a file, or the folder of the segment that holds it.
    """
    moved = []
    for path in sorted({Path(sentence.partition(": ")[0]) for sentence in sentences}):
        if path.suffix not in CHECKED or not path.is_relative_to(run) or not path.is_file():
            continue
        try:
            check(path)
        except DamagedFile:
            made = path.parent if path.parent.name.startswith("segment_") else path
            target = run / DAMAGED / made.relative_to(run)
            while target.exists():
                target = target.with_name(f"{target.name}.again")
            target.parent.mkdir(parents=True, exist_ok=True)
            os.replace(made, target)
            moved.append(f"{made}: is set aside as {target}, since {path.name} is damaged; give the same command again "
                         "to make it anew")
    return moved
