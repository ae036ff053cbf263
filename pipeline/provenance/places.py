"""Where a run that is to be checked lies: in a folder, or in a ZIP archive of one."""
import contextlib
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import IO, Protocol

from pipeline.base.errors import UserError
from pipeline.runs.contents import CRATE


class Place(Protocol):
    """The files of a run, by their paths relative to its folder."""

    name: str

    def sizes(self) -> dict[PurePosixPath, int]:
        """Return all files with their sizes, bytes."""

    def open(self, path: PurePosixPath) -> contextlib.AbstractContextManager[IO[bytes]]:
        """Open a file to read it."""

    def folder(self) -> contextlib.AbstractContextManager[Path]:
        """Give a folder with the small files that tell which segments the run has."""


class Folder:
    """A folder, wherever it was moved."""

    def __init__(self, path: Path):
        self.name, self._path = str(path), path

    def sizes(self) -> dict[PurePosixPath, int]:
        """Return all files with their sizes, bytes."""
        return {PurePosixPath(path.relative_to(self._path).as_posix()): path.stat().st_size
                for path in self._path.rglob("*") if path.is_file()}

    def open(self, path: PurePosixPath) -> IO[bytes]:
        """Open a file to read it."""
        return (self._path / path).open("rb")

    def folder(self) -> contextlib.AbstractContextManager[Path]:
        """Give the folder itself."""
        return contextlib.nullcontext(self._path)


class Archive:
    """A ZIP archive, with the run at its top or in a folder of it."""

    def __init__(self, path: Path):
        try:
            self._archive = zipfile.ZipFile(path)
        except zipfile.BadZipFile as error:
            raise UserError(f"{path}: is neither a folder nor a ZIP archive ({error})") from error
        tops = [PurePosixPath(name).parent for name in self._archive.namelist()
                if PurePosixPath(name).name in (CRATE, "scene.json")]
        self.name, self._top = str(path), min(tops, key=lambda top: len(top.parts), default=PurePosixPath())

    def sizes(self) -> dict[PurePosixPath, int]:
        """Return all files with their sizes, bytes."""
        return {PurePosixPath(one.filename).relative_to(self._top): one.file_size for one in self._archive.infolist()
                if not one.is_dir() and PurePosixPath(one.filename).is_relative_to(self._top)}

    def open(self, path: PurePosixPath) -> IO[bytes]:
        """Open a file to read it."""
        return self._archive.open(str(self._top / path))

    @contextlib.contextmanager
    def folder(self) -> Iterator[Path]:
        """Give a folder with the scene and the files of the rest stage."""
        with tempfile.TemporaryDirectory(prefix="run_") as folder:
            for path in self.sizes():
                if str(path) == "scene.json" or path.parts[0] == "rest":
                    with self.open(path) as file:
                        target = Path(folder, path.parts[0] if len(path.parts) > 1 else "", path.name)
                        target.parent.mkdir(exist_ok=True)
                        target.write_bytes(file.read())
            yield Path(folder)


def place_of(path: Path) -> Place:
    """Return what holds a run.

    Raises
    ------
    UserError : there is no such folder and no such archive.
    """
    if path.is_dir():
        return Folder(path)
    if not path.is_file():
        raise UserError(f"{path}: no such folder or ZIP archive; name outputs/<scene>/<level>, or a copy of it")
    return Archive(path)
