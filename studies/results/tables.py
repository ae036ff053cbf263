"""The tables of ``docs/results``: one CSV file per page, one row per number, and what the pages say around them."""
import csv
import dataclasses
from collections.abc import Iterable
from pathlib import Path

from pipeline.base.errors import UserError
from pipeline.base.files import write_text
from pipeline.base.tables import csv_of
from pipeline.scenes.yaml_files import read_yaml

FOLDER = Path("docs") / "results"  # in the project
LAYOUT = "pages.yaml"
VERDICTS = ("", "yes", "no")


@dataclasses.dataclass
class Row:
    """One number. All are words, as they stand in the file; what is empty is unknown or has no meaning.

    Attributes
    ----------
    table : name of the table on the page.
    case, quantity : what was run, what was measured.
    value, unit : the number; an empty unit is that of a pure number.
    expected : what an exact solution, an experiment or a paper has, in ``unit``.
    error, allowed, error_unit : how far off, and how far it may be.
    holds : "yes", "no", or empty where nothing is asked.
    size : particles, or particle spacings along a length.
    level : of config/accuracy.yaml.
    machine, code, command : where, with which version of the solver and by what it was measured.
    note : a caveat, a footnote of the page.
    source : what :mod:`studies.results.take_over` reads the number from; empty: a row of the same case and quantity.
    """

    table: str
    case: str
    quantity: str
    value: str = ""
    unit: str = ""
    expected: str = ""
    error: str = ""
    allowed: str = ""
    error_unit: str = ""
    holds: str = ""
    size: str = ""
    level: str = ""
    machine: str = ""
    code: str = ""
    command: str = ""
    note: str = ""
    source: str = ""

    def fault(self) -> str:
        """Return what is wrong with this row; empty: nothing."""
        for name in ("value", "expected", "error", "allowed"):
            try:
                float(getattr(self, name) or 0.0)
            except ValueError:
                return f"{name} is \"{getattr(self, name)}\", but must be one number"
        if not self.value and not self.error:
            return "has neither value nor error"
        if self.holds not in VERDICTS:
            return f"holds is \"{self.holds}\", but must be yes, no or empty"
        if self.error and self.allowed and self.holds != ("yes" if float(self.error) <= float(self.allowed) else "no"):
            return f"holds is \"{self.holds}\", but the error is {self.error} and {self.allowed} is allowed"
        return ""


COLUMNS = tuple(field.name for field in dataclasses.fields(Row))


@dataclasses.dataclass(frozen=True)
class Table:
    """A table of a page.

    Attributes
    ----------
    study : of config/studies, whose numbers it has.
    cases : patterns of cases of that study, of which it has every number that is allowed an error, at the finest
        resolution, and at any other where it does not hold.
    wide : one line per case and one column per quantity, instead of a line per number.
    figure, caption : picture in docs/images above the table.
    text : Markdown above, ``after``: below.
    """

    name: str
    title: str
    text: str = ""
    after: str = ""
    study: str = ""
    cases: tuple[str, ...] = ()
    wide: bool = False
    figure: str = ""
    caption: str = ""


@dataclasses.dataclass(frozen=True)
class Group:
    """Cases of a page that are counted together: of which solver, what they are about, patterns of their names."""

    of: str
    words: str
    cases: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class Page:
    """A page: its tables, a sentence on what it is about, and groups by which it is summed up at its top."""

    name: str
    title: str
    text: str
    tables: tuple[Table, ...]
    summary: tuple[Group, ...] = ()


@dataclasses.dataclass(frozen=True)
class Headline:
    """A number of the README: what it says, the row that has it, and the quantity whose half is its uncertainty."""

    words: str
    page: str
    case: str
    quantity: str
    level: str = ""
    band: str = ""


@dataclasses.dataclass(frozen=True)
class Change:
    """A change of the solver that has moved numbers.

    Attributes
    ----------
    commit : of the change, as git knows it.
    words : what has changed, and what it has moved.
    before : codes of the tables, in the order of git, that have all earlier changes and lack this one.
    """

    commit: str
    words: str
    before: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class Layout:
    """What pages there are, what the README takes from them, and which changes their numbers may lack, oldest first."""

    title: str
    text: str
    pages: tuple[Page, ...]
    headlines: tuple[Headline, ...]
    changes: tuple[Change, ...] = ()


def read_layout(folder: Path) -> Layout:
    """Read ``pages.yaml`` of a folder of results.

    Raises
    ------
    UserError : a key is missing or unknown.
    """
    path = folder / LAYOUT
    plain = read_yaml(path)
    try:
        pages = tuple(Page(**page | {"tables": tuple(map(_table, page["tables"])),
                                     "summary": tuple(map(_group, page.get("summary", ())))})
                      for page in plain["pages"])
        changes = tuple(Change(**one | {"before": tuple(one["before"])}) for one in plain["changes"])
        return Layout(plain["title"], plain["text"], pages, tuple(Headline(**one) for one in plain["headlines"]),
                      changes)
    except (KeyError, TypeError) as error:
        raise UserError(f"{path}: is no layout of pages ({error})") from error


def _table(plain: dict) -> Table:
    return Table(**plain | {"cases": tuple(plain.get("cases", ()))})


def _group(plain: dict) -> Group:
    return Group(**plain | {"cases": tuple(plain["cases"])})


def read_rows(folder: Path, page: Page) -> list[Row]:
    """Read the table of a page.

    Raises
    ------
    UserError : it is missing, or a row is wrong.
    """
    path, known = folder / f"{page.name}.csv", {table.name for table in page.tables}
    if not path.is_file():
        raise UserError(f"{path}: no such table, but {folder / LAYOUT} has the page {page.name}")
    with path.open(newline="", encoding="utf-8") as file:
        lines = list(csv.reader(file))
    if not lines or tuple(lines[0]) != COLUMNS:
        raise UserError(f"{path}: its first line must be {','.join(COLUMNS)}")
    if wrong := [number for number, line in enumerate(lines, 1) if len(line) != len(COLUMNS)]:
        raise UserError(f"{path}: line {wrong[0]} has not {len(COLUMNS)} cells")
    rows = [Row(*line) for line in lines[1:]]
    faults = [f"{path}: {row.case}: {row.quantity} {fault}" for row in rows if (fault := row.fault())]
    faults += [f"{path}: {row.case} is in the table {row.table}, but there are {', '.join(sorted(known))}"
               for row in rows if row.table not in known]
    if faults:
        raise UserError(*faults)
    return rows


def write_rows(folder: Path, page: Page, rows: Iterable[Row]) -> None:
    """Write the table of a page."""
    write_text(folder / f"{page.name}.csv", csv_of(COLUMNS, map(dataclasses.astuple, rows)))
