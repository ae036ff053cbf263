"""Named arrays in an archive of NumPy (``.npz``), bit by bit, with a checksum at the end."""
import math
import os
import zipfile
from collections.abc import Mapping
from typing import Any

import numpy as np

from pipeline.base.checksum import LENGTH, DamagedFile, append_checksum, check


def write_arrays(path: str | os.PathLike, arrays: Mapping[str, np.ndarray]) -> None:
    """Write arrays to ``path``, uncompressed; equal arrays make equal files."""
    with open(path, "wb") as file:
        np.savez(file, **dict[str, Any](arrays))
    # The checksum takes the place of a comment of its length, which only has to be announced.
    with zipfile.ZipFile(path, "a") as archive:
        archive.comment = bytes(LENGTH)
    os.truncate(path, os.path.getsize(path) - LENGTH)
    append_checksum(path)


def read_arrays(path: str | os.PathLike) -> dict[str, np.ndarray]:
    """Read what :func:`write_arrays` has written; objects of Python, which could run code, are refused.

    Raises
    ------
    DamagedFile : the checksum of the file does not fit, or it is no such archive.
    """
    check(path)
    try:
        with np.load(path, allow_pickle=False) as archive:
            for member in archive.zip.infolist():
                _check_size(archive.zip, member, os.path.getsize(path))
            return {name: archive[name] for name in archive.files}
    except MemoryError:  # of a file whose arrays are no larger than itself
        raise
    # With a checksum that fits, only what was made on purpose comes here, and NumPy raises anything of it.
    except Exception as error:
        raise DamagedFile(path, " ".join(str(error).split()) or type(error).__name__) from error


def _check_size(archive: zipfile.ZipFile, member: zipfile.ZipInfo, most: int) -> None:
    """Raise ValueError where an array would be larger than the bytes that are there: NumPy allocates it first."""
    with archive.open(member) as file:
        read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
        shape, _, kind = read[np.lib.format.read_magic(file)](file)
        if min(shape, default=0) < 0 or math.prod(shape) * kind.itemsize > most:
            raise ValueError(f"{member.filename} is larger than the file")
