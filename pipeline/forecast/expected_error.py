"""The error to expect of a scene: what the accuracy study has measured at its size, from several starts.

Between sizes it is interpolated, and beyond them carried over by the observed order where there is one.

The study takes minutes and its errors are those of the method, not of the computer: until it is run here, those that
the project came with count. ``cp outputs/studies/accuracy/draft/orders.csv config/expected_errors.csv`` renews
these.
"""
import csv
import dataclasses
import itertools
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipeline.base.errors import UserError
from pipeline.scenes.load import PROJECT_CONFIG
from pipeline.scenes.model import Scene

ORDERS = Path("outputs/studies/accuracy/draft/orders.csv")
SHIPPED = PROJECT_CONFIG / "expected_errors.csv"
LEAST_ORDER = 0.5  # below, the error scatters more than it falls
ALIKE = 1.1  # sizes that differ by less are one
COLUMNS = ("case", "quantity", "unit", "effects", "per_width", "resolution", "error", "least", "most", "starts",
           "order")


@dataclasses.dataclass(frozen=True)
class ExpectedError:
    """An error to expect: of which quantity, how large, the same in words with its unit, and where it comes from."""

    quantity: str
    value: float
    unit: str
    words: str
    source: str


def errors_file() -> Path:
    """What the accuracy study has written here, by this version, or else what it had for the authors."""
    return ORDERS if ORDERS.is_file() and _columns(ORDERS) == COLUMNS else SHIPPED


def _columns(path: Path) -> tuple[str, ...]:
    with path.open(newline="", encoding="utf-8") as file:
        return tuple(next(csv.reader(file), ()))


def in_words(errors: Sequence[float], unit: str, starts: int) -> tuple[str, str]:
    """Return the mean error with its unit, a relative one in percent, and "least to most from so many starts"."""
    percent = unit == "1"
    mean, least, most = (f"{100.0 * one if percent else one:.2g}" for one in errors)
    spread = f"{least} to {most} from {starts} starts" if starts > 1 else ""
    return f"{mean} {'%' if percent else unit}", spread


def error_at(size: float, known: Sequence[Sequence[float]], order: float) -> tuple[np.ndarray, str]:
    """Return mean, least and largest error at a size, and in words how they are known.

    Parameters
    ----------
    size : spacings along the case. order : of the error in the spacing; nan if unknown.
    known : size, mean, least and largest error of what was measured, coarse to fine, at least one.
    """
    sizes, *errors = np.array(known, float).T
    nearest = int(np.argmin(np.abs(np.log(sizes / size))))
    there, found = sizes[nearest], np.array(errors)[:, nearest]
    if max(there / size, size / there) < ALIKE:
        return found, f"at {there:g} spacings"
    if sizes[0] < size < sizes[-1]:
        after = int(np.searchsorted(sizes, size))
        between = np.array([np.interp(math.log(size), np.log(sizes), one) for one in errors])
        return between, f"between {sizes[after - 1]:g} and {sizes[after]:g} spacings"
    if order >= LEAST_ORDER:
        return found * (there / size) ** order, f"order {order:.1f} from {there:g} to {size:.3g} spacings"
    return found, f"that at {there:g} spacings, for it does not fall steadily"


def expected_errors(scene: Scene, width: float, path: Path | None = None) -> list[ExpectedError]:
    """Return the errors to expect; empty where the study has no case with the scene's effects.

    Parameters
    ----------
    width : of the cavity in particle spacings. A case with a drop or a layer in it counts the spacings along that: the
        scene is taken to have a drop or a layer of the same share of its width (``per_width``).
    path : of the study's ``orders.csv``; :func:`errors_file` without it.

    Raises
    ------
    UserError
        The file has other columns.
    """
    path = path or errors_file()
    columns = _columns(path)
    if columns != COLUMNS:
        raise UserError(f"{path}: its columns are {', '.join(columns) or 'none'}, but must be {', '.join(COLUMNS)}")
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    found = []
    for _, same in itertools.groupby(rows, lambda row: row["case"]):
        sizes = [row for row in same if math.isfinite(float(row["error"] or "nan"))]
        if not sizes or not set(sizes[0]["effects"].split()) <= scene.effects.keys():
            continue
        row, here = sizes[0], width * float(sizes[0]["per_width"])
        known = [[float(one[column]) for column in ("resolution", "error", "least", "most")] for one in sizes]
        errors, how = error_at(here, known, float(row["order"] or "nan"))
        words, spread = in_words(errors.tolist(), row["unit"], int(row["starts"]))
        found.append(ExpectedError(f"{row['case']}: {row['quantity']}", float(errors[0]), row["unit"], words,
                                   ", ".join(filter(None, (path.name, how, spread)))))
    return found
