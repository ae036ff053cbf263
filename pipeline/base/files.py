"""Files that appear complete or not at all, whatever ends the process or the computer."""
import contextlib
import errno
import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

from pipeline.base.errors import UserError

DISK_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EFBIG)
TEMPORARY = re.compile(r"\..+\.(\d+)(\.\w+)?")  # names of temporary files, with the number of their process


@contextlib.contextmanager
def replacing(path: str | os.PathLike) -> Iterator[Path]:
    """Yield a temporary path in the folder of ``path`` (created if missing) and rename it to ``path`` at the end.

    The temporary name keeps the suffix, which many writers use to choose a format. When the block raises, ``path``
    stays as it was and the temporary file is removed.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    with _naming(path, temporary):
        try:
            yield temporary
            _to_disk(temporary)
            os.replace(temporary, path)
            _to_disk(path.parent)
        finally:
            temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def replacing_folder(path: str | Path) -> Iterator[Path]:
    """Yield a temporary empty folder beside ``path`` and rename it to ``path`` at the end.

    When the block raises, an old folder at ``path`` stays as it was and the temporary one is removed.
    """
    path = Path(os.path.abspath(path))
    if path.exists() and not path.is_dir():
        raise UserError(f"{path}: is a file, but a folder is to be written there")
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    shutil.rmtree(temporary, ignore_errors=True)
    try:
        with _naming(path, temporary):
            temporary.mkdir()
            yield temporary
            for written in (*temporary.rglob("*"), temporary):
                _to_disk(written)
            if path.exists():
                # A folder cannot be replaced in one step: set the old one aside first, so that the gap stays a moment.
                old = path.with_name(f".{path.name}.{os.getpid()}.old")
                os.replace(path, old)
                os.replace(temporary, path)
                shutil.rmtree(old)
            else:
                os.replace(temporary, path)
            _to_disk(path.parent)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


@contextlib.contextmanager
def _naming(path: Path, temporary: Path) -> Iterator[None]:
    """Let errors of the disk name ``path``: users do not know the temporary one, and a full disk names no file."""
    try:
        yield
    except OSError as error:
        name = error.filename
        if os.fspath(name).startswith(str(temporary)) if name else error.errno in DISK_ERRORS:
            error.filename = str(path)
        raise


def _to_disk(path: Path) -> None:
    """Wait until the disk holds a file, or the names in a folder.

    What gets its name before the disk has its content may be empty after a loss of power.
    """
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # disks of a network that cannot be asked
            raise
    finally:
        os.close(descriptor)


def remove_left_over(folder: str | Path) -> None:
    """Remove what killed processes left half written anywhere below ``folder``; that of living ones stays."""
    for path in list(Path(folder).rglob(".*")):
        match = TEMPORARY.fullmatch(path.name)
        if match and not _lives(int(match[1])):
            shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)


def _lives(process: int) -> bool:
    """Whether there is a process of a number, be it of another user."""
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return True


def write_text(path: str | Path, text: str) -> None:
    """Write ``text`` to ``path`` by rename; a file that already holds it is left untouched, with its date."""
    path = Path(path)
    if path.is_file() and path.read_bytes() == text.encode():
        return
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def size_of(path: Path) -> int:
    """Return the bytes of a file, or of all files in a folder; 0 where there is nothing."""
    files = [path] if path.is_file() else path.rglob("*")
    return sum(file.stat().st_size for file in files if file.is_file())
