"""Files of frames in a row: what was deleted or added in the middle of a run is told, and never passed over."""
import itertools
import re
from collections.abc import Iterable
from pathlib import Path

from pipeline.base.errors import UserError

# What makes missing files anew.
FRAMES_AGAIN, SURFACES_AGAIN, PICTURES_AGAIN = (f"run the {stage} stage again" for stage in (
    "simulate", "reconstruct", "render"))
_NAME = re.compile(r"frame_(\d{5,})")
MOST_NAMED = 3  # frames of many that are missing


def number_of(path: Path) -> int:
    """Return the number of a frame from the name of its file.

    Raises
    ------
    UserError : the name is none of a frame.
    """
    match = _NAME.fullmatch(path.stem)
    if not match:
        raise UserError(f"{path}: is none of the run's files, which are named frame_00000{path.suffix} and so on; "
                        "move it elsewhere")
    return int(match[1])


def in_sequence(paths: Iterable[Path], again: str) -> list[Path]:
    """Return files of frames in the order of their numbers, which follow one another.

    Parameters
    ----------
    again : what makes missing ones anew, such as "run the render stage again".

    Raises
    ------
    UserError : one is missing between two others, is there twice, or is none of a frame.
    """
    found = sorted(paths, key=number_of)
    for one, following in itertools.pairwise(found):
        if number_of(one) == number_of(following):
            raise UserError(f"{following}: is there twice, as {one} too; move one of them elsewhere")
    if found:
        numbers = {number_of(path) for path in found}
        _refuse(set(range(min(numbers), max(numbers))) - numbers, found, again)
    return found


def with_all(paths: Iterable[Path], expected: Iterable[int], again: str) -> None:
    """Raise UserError where files of frames lack expected ones; all are of one folder."""
    found = list(paths)
    _refuse(set(expected) - {number_of(path) for path in found}, found, again)


def without_others(frames: Iterable[Path], made: Iterable[Path], again: str) -> None:
    """Raise UserError where something was made of a frame that is not there."""
    names = {path.stem for path in frames}
    for path in sorted(made):
        if path.stem not in names:
            raise UserError(f"{path}: is of a frame that is missing among the others, {path.stem}; {again}")


def _refuse(missing: set[int], found: list[Path], again: str) -> None:
    if missing:
        names = [f"frame_{number:05d}" for number in sorted(missing)]
        more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
        number = min(missing)
        folder = max((path for path in found if number_of(path) < number), key=number_of, default=found[0]).parent
        raise UserError(f"{folder}: {', '.join(names[:MOST_NAMED])}{more} {'is' if len(names) == 1 else 'are'} missing "
                        f"among the others; remove the folder and {again}")
