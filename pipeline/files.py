"""Files and folders that appear by rename: a killed job never leaves a half file that looks whole."""
import contextlib
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from pipeline.errors import UserError


@contextlib.contextmanager
def written_by_rename(path: str | os.PathLike) -> Iterator[Path]:
    """Give a temporary path beside ``path``; rename it to ``path`` when the block ends without an error.

    The temporary name keeps the suffix, because writers choose their format by it.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.stem}.partial{os.getpid()}{path.suffix}")
    try:
        yield partial
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


@contextlib.contextmanager
def folder_by_rename(path: str | os.PathLike) -> Iterator[Path]:
    """Give a temporary empty folder that takes the place of ``path`` when the block ends without an error."""
    path = Path(os.path.abspath(path))
    if path.exists() and not path.is_dir():
        raise UserError(f"{path}: is a file, but a folder is to be written there")
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.partial{os.getpid()}")
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir()
    try:
        yield partial
        if path.exists():
            # A folder cannot be replaced in one step: set the old one aside first, so that the gap stays a moment.
            old = path.with_name(f".{path.name}.old{os.getpid()}")
            os.replace(path, old)
            os.replace(partial, path)
            shutil.rmtree(old)
        else:
            os.replace(partial, path)
    finally:
        shutil.rmtree(partial, ignore_errors=True)
