"""What a study is made of: cases with parameters, and what each of them measured.

A case is one call of ``run(parameters)`` in one file of ``studies`` (a family of cases). It returns an
:class:`Outcome`: rows for the table, curves for the figures, and remarks in words.
"""
import dataclasses
import json
import math
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from pipeline.base.errors import UserError
from pipeline.base.files import write_text

COLUMNS = ("case", "quantity", "value", "unit", "reference", "error", "error_is", "tolerance", "holds", "wall_s")
MADE = ("machine", "code", "command")  # columns of the table beside these: where, with which code and by what
RELATIVE, ABSOLUTE = "relative", "absolute"
FAILED = "no result"  # quantity of the one row of a case that has failed; the remarks say why
WALL_TIME, COMPUTING_TIME = "wall time without compilation", "computing time without compilation, all cores"
OUTCOME = "outcome.json"  # in the folder of a case, beside its pictures


@dataclasses.dataclass(frozen=True)
class Row:
    """One measurement.

    Attributes
    ----------
    quantity, value, unit : what was measured; the unit of a pure number is "1".
    at : what tells the row from others of its case, such as the resolution; joined to the name of the case.
    reference, error, tolerance : the expected value, how far off, and how far is allowed (None: nothing is asked).
    relative : whether error and tolerance are parts of the reference; else they have the unit of the value.
    wall_s : seconds that the run behind it took.
    """

    quantity: str
    value: float
    unit: str = "1"
    at: str = ""
    reference: float | None = None
    error: float | None = None
    tolerance: float | None = None
    wall_s: float | None = None
    relative: bool = False

    def __post_init__(self):
        if not self.unit:
            raise UserError(f'the row "{self.quantity}" has no unit; that of a pure number is "1"')

    @property
    def holds(self) -> bool | None:
        """Whether the error is within the tolerance; None where nothing is asked. No number is no success."""
        if self.tolerance is None:
            return None
        return self.error is not None and math.isfinite(self.error) and bool(self.error <= self.tolerance)

    def cells(self, case: str) -> dict[str, str]:
        """Return the cells of the table, column by column; what is empty stays so."""
        kind = "" if self.error is None else RELATIVE if self.relative else ABSOLUTE
        cells = {"case": f"{case} {self.at}".strip(), "quantity": self.quantity, "unit": self.unit, "error_is": kind,
                 "holds": {None: "", True: "true", False: "false"}[self.holds]}
        numbers = {name: getattr(self, name) for name in ("value", "reference", "error", "tolerance", "wall_s")}
        return cells | {name: "" if number is None else f"{number:.6g}" for name, number in numbers.items()}


def compared(quantity: str, value: float, reference: float, tolerance: float | None, unit: str = "1", **more) -> Row:
    """Return a row whose error is relative to its reference."""
    return Row(quantity, value, unit, reference=reference, error=abs(value - reference) / abs(reference),
               tolerance=tolerance, relative=True, **more)


def bounded(quantity: str, value: float, limit: float | None, unit: str = "1", **more) -> Row:
    """Return a row for something that should be zero: it is its own error."""
    return Row(quantity, value, unit, reference=0.0, error=abs(value), tolerance=limit, **more)


def observed_order(spacings: ArrayLike, errors: ArrayLike) -> float:
    """Return the slope of log(error) against log(spacing), by least squares; nan without two errors above zero.

    >>> round(observed_order([0.1, 0.05, 0.025], [4e-2, 1e-2, 2.5e-3]), 9)
    2.0
    """
    spacings, errors = np.asarray(spacings, float), np.asarray(errors, float)
    known = np.isfinite(errors) & (errors > 0.0)
    if np.count_nonzero(known) < 2:
        return math.nan
    return float(np.polyfit(np.log(spacings[known]), np.log(errors[known]), 1)[0])


@dataclasses.dataclass(frozen=True)
class Figure:
    """A figure of a family: every case of it may add curves."""

    name: str
    title: str
    x: str
    y: str
    logarithmic: bool = False


@dataclasses.dataclass(frozen=True)
class Curve:
    """Points of one figure. ``style``: "points", "line", or "reference" (black, drawn once per label)."""

    figure: str
    label: str
    x: ArrayLike
    y: ArrayLike
    style: str = "points"


@dataclasses.dataclass
class Outcome:
    """What a case has found.

    Attributes
    ----------
    remarks : sentences for the page of the study.
    pictures : name -> PNG as bytes.
    tables : name -> lines of cells, the heads first.
    failure : why the case has no result, in words; empty where it has one.
    machine, code : where and with which code it was found.
    """

    rows: list[Row] = dataclasses.field(default_factory=list)
    curves: list[Curve] = dataclasses.field(default_factory=list)
    remarks: list[str] = dataclasses.field(default_factory=list)
    pictures: dict[str, bytes] = dataclasses.field(default_factory=dict)
    case: str = ""
    tables: dict[str, list[list[str]]] = dataclasses.field(default_factory=dict)
    failure: str = ""
    machine: str = ""
    code: str = ""

    @classmethod
    def failed(cls, case: str, why: str) -> "Outcome":
        """Return the outcome of a case that has no result: a row that does not hold, and a remark that says why."""
        return cls([Row(FAILED, math.nan, tolerance=0.0)], remarks=[f"{case} has no result: {why}"], case=case,
                   failure=why)

    def write(self, folder: Path) -> None:
        """Write the outcome into an existing folder."""
        data = {"case": self.case, "rows": [dataclasses.asdict(row) for row in self.rows],
                "curves": [dataclasses.asdict(curve) | {"x": _plain(curve.x), "y": _plain(curve.y)}
                           for curve in self.curves], "remarks": self.remarks, "tables": self.tables,
                "failure": self.failure, "machine": self.machine, "code": self.code}
        for name, content in self.pictures.items():
            (folder / f"{name}.png").write_bytes(content)
        write_text(folder / OUTCOME, json.dumps(data, indent=1) + "\n")

    @classmethod
    def read(cls, folder: Path) -> "Outcome":
        """Read what :meth:`write` wrote.

        Raises
        ------
        UserError
            The folder holds no outcome.
        """
        path = folder / OUTCOME
        if not path.is_file():
            raise UserError(f"{path}: no such file; run the case first (`python -m pipeline.study --help`)")
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
            return cls([Row(**row) for row in data["rows"]], [Curve(**curve) for curve in data["curves"]],
                       data["remarks"], {file.stem: file.read_bytes() for file in sorted(folder.glob("*.png"))},
                       data["case"], data["tables"], data["failure"], data["machine"], data["code"])
        except (ValueError, KeyError, TypeError) as error:
            raise UserError(f"{path}: is no outcome of a case ({error}); run the case again") from error


def _plain(numbers: ArrayLike) -> list[float]:
    return np.asarray(numbers, float).tolist()
