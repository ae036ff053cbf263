"""Which segments a run has: all that its duration asks for, or fewer where it ends at rest."""
import json
from collections.abc import Callable, Iterable
from pathlib import Path

from pipeline.base.errors import UserError
from pipeline.base.sequences import with_all
from pipeline.scenes.model import Scene


def segments_until_rest(scene: Scene, file_of: Callable[[str], Path]) -> list[str]:
    """Return the names of the segments that a scene has: all, or those after which it is at rest if it ends there.

    Parameters
    ----------
    file_of : returns the file that the rest stage has written after a segment. One that is not there yet ends nothing.
    """
    names = scene.segment_names
    for number, name in enumerate(names if scene.output.until_rest else ()):
        path = file_of(name)
        if path.is_file() and read_rest(path):
            return names[:number + 1]
    return names


def segments_made(scene: Scene, folder: Path) -> list[str]:
    """Return the names of the segments of the run in a folder."""
    return segments_until_rest(scene, lambda name: segment_path(folder, "rest", name, ".json"))


def segment_path(folder: Path, kind: str, name: str, suffix: str = "") -> Path:
    """Return the folder of a kind (frames, surfaces, images) that a segment has in that of a run, or its file."""
    return folder / kind / f"segment_{name}{suffix}"


def check_segments(scene: Scene, paths: Iterable[Path], again: str) -> None:
    """Refuse folders ``segment_000`` ... of a scene that lack files of frames, the last one too.

    Parameters
    ----------
    paths : files of frames in these folders; of others nothing is known.
    again : what makes missing ones anew.

    Raises
    ------
    UserError : a file is missing.
    """
    folders: dict[Path, list[Path]] = {}
    for path in paths:
        folders.setdefault(path.parent, []).append(path)
    for folder, found in folders.items():
        name = folder.name.removeprefix("segment_")
        if folder.name != name and name in scene.segment_names:
            with_all(found, scene.frames_of_segment(int(name)), again)


def read_rest(path: Path) -> bool:
    """Return what a file of the rest stage says.

    Raises
    ------
    UserError : the file is damaged.
    """
    try:
        return bool(json.loads(path.read_text(encoding="utf-8"))["at_rest"])
    except (ValueError, KeyError, TypeError) as error:
        raise UserError(f"{path}: is damaged ({error}); remove it and run the same command again") from error
