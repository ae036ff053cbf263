"""Tables as CSV files. A column is called ``name [unit]``."""
import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from pipeline.base.errors import UserError
from pipeline.base.files import replacing
from pipeline.base.words import nearest

TIME = "time [s]"


class Table(dict[str, np.ndarray]):
    """Column -> numbers of a file; to ask for a column that it does not have is a UserError, which names it."""

    def __init__(self, path: Path, columns: Iterable[tuple[str, np.ndarray]]):
        super().__init__(columns)
        self._path = path

    def __missing__(self, column: str) -> np.ndarray:
        raise UserError(f"{self._path}: has no column {column}{nearest(column, self)}")


def csv_of(heads: Sequence[str], rows: Iterable[Sequence[object] | Mapping[str, object]]) -> str:
    """Return a table as CSV; a row holds its cells in the order of the heads, or by them."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([heads, *(
        [row[head] for head in heads] if isinstance(row, Mapping) else row for row in rows)])
    return text.getvalue()


def write_table(path: Path, table: Mapping[str, Iterable[float]]) -> None:
    """Write column -> numbers as CSV, with every digit that a number has.

    A cell is empty where there is nothing to measure: no steps before frame 0, no center of a liquid that is not there.
    """
    rows = zip(*table.values(), strict=True)
    lines = [",".join(table), *(",".join(map(_cell, row)) for row in rows), ""]
    with replacing(path) as partial:
        partial.write_text("\n".join(lines))


def _cell(number: float) -> str:
    number = float(number)
    if np.isnan(number):
        return ""
    return str(int(number) if number.is_integer() and abs(number) < 1e15 else number)


def read_table(path: Path) -> Table:
    """Read a table of metrics: column -> (frames,) float64, NaN for an empty cell.

    Raises
    ------
    UserError : the file is missing or no such table.
    """
    if not path.is_file():
        raise UserError(f"{path}: no such table of metrics; run the metrics stage first")
    header, *rows = path.read_text().splitlines() or [""]
    columns = header.split(",")
    try:
        values = np.array([[float(cell or "nan") for cell in row.split(",")] for row in rows])
        values = values.reshape(len(rows), len(columns))
    except ValueError as error:
        raise UserError(f"{path}: is damaged ({error}); measure again") from error
    if "frame" not in columns:
        raise UserError(f"{path}: is no table of metrics; it has no column `frame`")
    return Table(path, zip(columns, values.T, strict=True))
