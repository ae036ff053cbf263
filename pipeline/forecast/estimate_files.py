"""The file in which the estimate stage says what a scene will cost."""
import json
from pathlib import Path
from typing import Any

from pipeline.base.errors import UserError
from pipeline.scenes.model import Scene


def read_level(path: Path, scene: Scene) -> dict[str, Any]:
    """Read what was foretold of a scene at its accuracy level, with the keys of ``pipeline.forecast.prediction``.

    Raises
    ------
    UserError : the file is no estimate of it.
    """
    try:
        levels = json.loads(path.read_text(encoding="utf-8"))["levels"]
        level = next(one for one in levels if one["accuracy"] == scene.accuracy)
        for error in level["errors"]:
            error["words"]  # which an older version has not written
        return level
    except (OSError, ValueError, KeyError, TypeError, StopIteration) as error:
        raise UserError(f"{path}: is no estimate of {scene.name} at {scene.accuracy}; make it again with "
                        "`python -m pipeline.estimate`") from error
