"""A checksum at the end of a file, by which a byte that has changed since it was written is found and named.

It is the SHA-256 of all that is before it, in a form that XML as well as a zip archive allow at their end. The whole
file is checked before any of it is believed: readers of damaged files crash, or ask for all of the memory.
"""
import hashlib
import os
from pathlib import Path

from pipeline.base.errors import UserError

BEGIN, END = b"\n<!-- sha256 ", b" -->\n"
LENGTH = len(BEGIN) + 2 * hashlib.sha256().digest_size + len(END)  # bytes
BLOCK = 2**20  # bytes that are read at a time


class DamagedFile(UserError):
    """A file that is not what was written."""

    def __init__(self, path: str | os.PathLike, how: str):
        super().__init__(f"{path}: is damaged ({how}); delete it, and run again what writes it")


def append_checksum(path: str | os.PathLike) -> None:
    """Append the checksum of a file to it."""
    checksum = _checksum(Path(path), os.path.getsize(path))
    with open(path, "ab") as file:
        file.write(BEGIN + checksum + END)


def check(path: str | os.PathLike) -> None:
    """Compare a file with the checksum at its end.

    Raises
    ------
    DamagedFile : they differ, or there is none, since the file was cut short or written by something else.
    """
    size = os.path.getsize(path) - LENGTH
    with open(path, "rb") as file:
        file.seek(max(size, 0))
        found = file.read()
    if size < 0 or not (found.startswith(BEGIN) and found.endswith(END)):
        raise DamagedFile(path, "it does not end in its checksum, as it was cut short or is of an earlier version")
    if found != BEGIN + _checksum(Path(path), size) + END:
        raise DamagedFile(path, "it differs from its checksum, so a byte of it has changed")


def checksum_at_end(path: str | os.PathLike) -> str:
    """Return the checksum that a file ends in, without a look at what is before it."""
    with open(path, "rb") as file:
        file.seek(-LENGTH, os.SEEK_END)
        return file.read().removeprefix(BEGIN).removesuffix(END).decode(errors="replace")


def _checksum(path: Path, size: int) -> bytes:
    """The SHA-256 of the first bytes of a file, in hexadecimal digits."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while size > 0 and (block := file.read(min(size, BLOCK))):
            digest.update(block)
            size -= len(block)
    return digest.hexdigest().encode()
