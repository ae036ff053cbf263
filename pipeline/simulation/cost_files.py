"""The files in which the simulate stage says what every effect has cost."""
import json
from pathlib import Path

from pipeline.base.errors import UserError


def read_costs(path: Path) -> dict:
    """Read what one segment has cost.

    Raises
    ------
    UserError : the file is missing or damaged.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, json.JSONDecodeError) as error:
        raise UserError(f"{path}: cannot be read ({error}); run the simulate stage again") from error
