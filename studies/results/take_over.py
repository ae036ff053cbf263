"""Numbers of fresh runs come into the tables of ``docs/results``.

From a study, ``outputs/studies/<study>/<level>``: each row of its ``table.csv`` replaces the row of the same level,
case and quantity; a row that is named otherwise has "case: quantity" of the study as its source. A table with ``cases``
gets every number of these cases that is allowed an error, at their finest resolution and where it does not hold.

From a scene, ``outputs/<scene>/<level>``: rows of that level whose source is "<scene>: <what> <how>". What: a column of
``metrics.csv`` without its unit; how: last, largest or smallest. Or what: a stage, or all; how: wall, cpu or memory, as
the logs say.
"""
import csv
import dataclasses
import fnmatch
import math
import re
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from pipeline.base.errors import UserError
from pipeline.base.origin import commit_before, machine, release
from pipeline.base.tables import read_table
from pipeline.runs.run_folder import RunFolder
from pipeline.scenes.units import parse_quantity
from pipeline.studies.model import COLUMNS, MADE, RELATIVE
from studies.results.tables import Layout, Page, Row

STUDIES = "studies"
SO_FAR = "so_far"  # folder with the table of a study that has not been run in full
HOW: dict[str, Callable] = {"last": lambda x: x[-1], "largest": np.max, "smallest": np.min}
TAKEN = {"wall": "s", "cpu": "s", "memory": "B"}
COUNTED = ("spacings",)     # words for pure numbers in place of a unit


@dataclasses.dataclass(frozen=True)
class Made:
    """Where, and with which code, numbers were made."""

    machine: str
    code: str


def made(path: Path, code: str | None = None) -> Made:
    """Return this computer and, where the code is not told, the version with the last commit older than a file."""
    commit = commit_before(datetime.fromtimestamp(path.stat().st_mtime, UTC).isoformat())
    return Made(machine(), code or (f"{release()} ({commit})" if commit else release()))


def take_over(folder: Path, layout: Layout, rows: dict[str, list[Row]], code: str | None = None,
              add: str = "") -> int:
    """Replace the rows that a folder of outputs has anew; return how many.

    Parameters
    ----------
    rows : page -> its rows, which are changed.
    code : that made the numbers, in place of what a study says of itself and of what the date of a run tells.
    add : "table=case pattern" of rows of a study that are added where none is replaced.

    Raises
    ------
    UserError : the folder holds no results, or none that a table wants.
    """
    folder = folder.resolve()
    study = folder.parent if folder.name == SO_FAR else folder
    if (folder / "table.csv").is_file() and study.parent.parent.name == STUDIES:
        count = _from_study(folder, study.parent.name, study.name, layout, rows, code, add)
    elif (folder / "metrics.csv").is_file():
        count = _from_scene(folder, rows, made(folder / "metrics.csv", code))
    else:
        raise UserError(f"{folder}: is neither outputs/studies/<study>/<level> with a table.csv nor "
                        "outputs/<scene>/<level> with a metrics.csv")
    if not count:
        raise UserError(f"{folder}: no row of docs/results has a number of it; --add brings new ones")
    return count


def _from_study(folder: Path, study: str, level: str, layout: Layout, rows: dict[str, list[Row]], code: str | None,
                add: str) -> int:
    places = {(page.name, table.name): page for page in layout.pages for table in page.tables if table.study == study}
    target, _, pattern = add.partition("=")
    with (folder / "table.csv").open(newline="", encoding="utf-8") as file:
        found = list(csv.DictReader(file))
    if found and not {*COLUMNS, *MADE} <= found[0].keys():
        raise UserError(f"{folder / 'table.csv'}: does not say what its errors are and where they were found, as of an "
                        f"earlier version; run the study again: snakemake -j2 {study}")
    if code:
        found = [line | {"code": code} for line in found]
    count = 0
    for line in found:
        names = {f"{line['case']}: {line['quantity']}"}
        matches = [row for page, table in places for row in rows[page] if row.table == table and row.level == level
                   and (row.source or f"{row.case}: {row.quantity}") in names]
        if not matches and add and fnmatch.fnmatchcase(line["case"], pattern):
            page = _page_of(target, places)
            matches = [Row(target, line["case"], line["quantity"], unit=_unit(line["unit"]), level=level,
                           command=line["command"])]
            rows[page.name] += matches
        for row in matches:
            _fill(row, line)
        count += len(matches)
    for owner, table in ((page, table) for page in layout.pages for table in page.tables if table.study == study):
        fresh = [_fresh(table.name, line, level) for line in _judged(found, table.cases)]
        cases = {row.case for row in fresh}
        rows[owner.name] = [row for row in rows[owner.name]
                            if (row.table, row.level) != (table.name, level) or row.case not in cases] + fresh
        count += len(fresh)
    return count


def _judged(found: list[dict[str, str]], patterns: tuple[str, ...]) -> list[dict[str, str]]:
    """The lines of cases that are allowed an error: those of the last resolution, and of any other what does not hold.

    A study begins with the coarsest resolution. A case without a result is allowed no error: what the table has of it
    stays.
    """
    lines = [line for line in found if float(line["tolerance"] or 0.0) > 0.0
             and any(fnmatch.fnmatchcase(line["case"].partition(" ")[0], one) for one in patterns)]
    last = {(line["case"].partition(" ")[0], line["quantity"]): line for line in lines}
    return [line for line in lines if line["holds"] == "false" or line in last.values()]


def _fresh(table: str, line: dict[str, str], level: str) -> Row:
    case, _, size = line["case"].partition(" ")
    row = Row(table, case, line["quantity"], unit=_unit(line["unit"]), size=size, level=level,
              command=line["command"])
    _fill(row, line)
    return row


def _page_of(table: str, places: dict[tuple[str, str], Page]) -> Page:
    for (_, name), page in places.items():
        if name == table:
            return page
    raise UserError(f"--add: {table} is no table of this study; there are {', '.join(name for _, name in places)}")


def _fill(row: Row, line: dict[str, str]) -> None:
    """Put the numbers of a line of a study into a row, in the units that the row has."""
    value, expected, error, allowed = (float(line[name]) if line[name] else math.nan
                                       for name in ("value", "reference", "error", "tolerance"))
    unit = _unit(line["unit"])
    row.value = _digits(_converted(value, unit, row.unit), row.value)
    if line["reference"]:
        row.expected = _digits(_converted(expected, unit, row.unit), row.expected)
    relative = line["error_is"] == RELATIVE
    row.error_unit = row.error_unit or ("%" if relative else row.unit) if line["error"] else ""
    row.error, row.allowed = (_digits(_converted(number, "" if relative else unit, row.error_unit))
                              for number in (error, allowed))
    row.holds = {"true": "yes", "false": "no", "": ""}[line["holds"]]
    row.machine, row.code = line["machine"], line["code"]


def _from_scene(folder: Path, rows: dict[str, list[Row]], by: Made) -> int:
    scene, level = folder.parent.name, folder.name
    columns, count = read_table(folder / "metrics.csv"), 0
    taken = taken_of(folder)
    for row in (row for page in rows.values() for row in page):
        name, _, rest = row.source.partition(": ")
        if name != scene or row.level != level or not rest:
            continue
        what, _, how = rest.rpartition(" ")
        if how in TAKEN and what in taken:
            number, unit = taken[what][how], TAKEN[how]
        else:
            number, unit = _metric(columns, what, how, f"{folder}: {row.source}")
        number = _converted(number, unit, row.unit)
        row.value = _digits(number, row.value)
        row.machine, row.code = by.machine, by.code
        if row.error:
            row.error = _digits(abs(number - float(row.expected or 0.0)), row.error)
            if row.allowed:
                row.holds = "yes" if float(row.error) <= float(row.allowed) else "no"
        count += 1
    return count


def taken_of(folder: Path) -> dict[str, dict[str, float]]:
    """Return what every stage of a run took, and ``all`` of them; nothing where no log says so."""
    taken = RunFolder(folder).taken if (folder / "logs").is_dir() else {}
    if taken:
        taken["all"] = {kind: (max if kind == "memory" else sum)(one[kind] for one in taken.values()) for kind in TAKEN}
    return taken


def _metric(columns: dict[str, np.ndarray], what: str, how: str, where: str) -> tuple[float, str]:
    """Return a number of a table of metrics, and its unit."""
    for head, values in columns.items():
        if head.partition(" [")[0] == what and how in HOW:
            known = values[np.isfinite(values)]
            if not len(known):
                raise UserError(f"{where}: that column is empty")
            return float(HOW[how](known)), _unit(head.partition(" [")[2].rstrip("]"))
    raise UserError(f"{where}: is no column of metrics with one of {', '.join(HOW)}, and no stage with one of "
                    f"{', '.join(TAKEN)}")


def _unit(unit: str) -> str:
    """The tables leave the unit of pure numbers empty."""
    return "" if unit == "1" else unit


def _converted(number: float, unit: str, wanted: str) -> float:
    if unit == wanted or math.isnan(number) or (not unit and wanted in COUNTED):
        return number
    try:
        return parse_quantity(f"{number!r} {unit or 1}", wanted)
    except ValueError as error:
        raise UserError(f"a number of a study is {error}") from error


def _digits(number: float, before: str = "") -> str:
    """Return a number with the decimals of the one before, where they leave two digits, else with four digits."""
    if math.isnan(number):
        return ""
    if re.fullmatch(r"-?\d+(\.\d+)?", before):
        text = f"{number:.{len(before.partition('.')[2])}f}"
        if number == 0.0 or len(text.replace(".", "").lstrip("-0")) > 1:
            return text
    return str(int(number)) if number.is_integer() and abs(number) < 1e15 else f"{number:.4g}"
