"""The files in which the simulate stage says what every effect and every frame has cost."""
import json
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from pipeline.base.errors import UserError

STARTED_FROM = "started_from"  # key of the checksum of the checkpoint that a segment started from, empty at the start


def read_costs(path: Path) -> dict:
    """Read what one segment has cost.

    Raises
    ------
    UserError : the file is missing, damaged, or of a version that did not count frames.
    """
    try:
        costs = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: cannot be read ({error}); run the simulate stage again") from error
    if not isinstance(costs, dict) or "frames" not in costs:
        raise UserError(f"{path}: does not tell what its frames took; run the simulate stage again")
    return costs


def seconds_of(costs: Iterable[dict], name: str) -> np.ndarray:
    """Return what every frame of some segments took since the one before, (frames,), s.

    Parameters
    ----------
    costs : of the segments, in the order of time.
    name : ``wall_seconds``, ``cpu_seconds`` (of all cores), or ``<effect>_seconds``, 0 where it was not timed.
    """
    return np.array([frame.get(name, 0.0) for segment in costs for frame in segment["frames"]])
