"""Which of the files in the folder of a run are its results, by their names alone."""
import re
from collections.abc import Iterable
from pathlib import PurePosixPath

CRATE = "ro-crate-metadata.json"
APART = ("damaged", "logs")  # what was set aside, and what stages have said
_FRAME = re.compile(r"frame_\d{5,}")
_SEGMENT = re.compile(r"segment_(\d{3,})")


def is_result(path: PurePosixPath) -> bool:
    """Tell whether a file, relative to the folder, is a result: no log, nothing set aside, nothing half written."""
    return path.parts[0] not in APART and not any(part.startswith(".") for part in path.parts) and str(path) != CRATE


def segment_of(path: PurePosixPath) -> str | None:
    """Return the name of the segment that a file belongs to; None where it belongs to the run as a whole.

    >>> segment_of(PurePosixPath("frames/segment_001/frame_00003.vtu")), segment_of(PurePosixPath("eye.vtp"))
    ('001', None)
    """
    names = [match[1] for part in path.parts if (match := _SEGMENT.fullmatch(part.partition(".")[0]))]
    return names[0] if names else None


def frame_of(path: PurePosixPath) -> str | None:
    """Return the name of the frame that a file belongs to; None of one that belongs to none.

    >>> frame_of(PurePosixPath("surfaces/segment_001/frame_00003_aqueous.vtp"))
    'frame_00003'
    """
    match = _FRAME.match(path.name)
    return match[0] if match else None


def left_over(paths: Iterable[PurePosixPath], segments: Iterable[str]) -> dict[str, list[PurePosixPath]]:
    """Return the files of segments that the run does not have, by the names of these: a longer run has left them."""
    known, found = {None, *segments}, {}
    for path in paths:
        if (segment := segment_of(path)) not in known:
            found.setdefault(segment, []).append(path)
    return found
