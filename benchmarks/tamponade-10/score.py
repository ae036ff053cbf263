"""Score entries of tamponade-10: how far every number is from its reference, and whether that holds.

    python score.py entries                    score every entries/*.csv, print the tables, write entries/scores/
    python score.py entries/mine.csv           score one entry
    python score.py --template > mine.csv      print an entry without values, to be filled in

An entry is a CSV file with the columns case, quantity, time, value and unit, one line for each line of the reference
tables of the cases that it enters. Cases that it leaves out count as not entered. Lines `wall_time` and
`processor_time` (s) of a case tell what it took; they are shown and not scored.

A line holds if its value is at most the tolerance away from the reference. The score of a case is the share of its
lines that hold, the score of an entry the sum over its cases: ten at most. What is wrong with an entry is told in one
sentence each; the exit code is then 1. Python 3.11 or newer is all that it needs.
"""
import argparse
import csv
import difflib
import io
import math
import sys
from dataclasses import dataclass, field
from pathlib import Path

HERE = Path(__file__).resolve().parent
REFERENCE = "reference.csv"
COLUMNS = ("case", "quantity", "time", "value", "unit")
REFERENCE_COLUMNS = ("quantity", "time", "value", "unit", "tolerance", "source")
COSTS = ("wall_time", "processor_time")  # s, of a case
SAME_TIME = 1e-6  # times that differ by this share are the same


@dataclass(frozen=True)
class Reference:
    """One line of a reference table; time in s, None for what has no time."""

    quantity: str
    time: float | None
    value: float
    unit: str
    tolerance: float
    source: str

    @property
    def name(self) -> str:
        """The quantity, with its time."""
        return self.quantity if self.time is None else f"{self.quantity} at {self.time:g} s"


@dataclass(frozen=True)
class Scored:
    """One line of an entry beside its reference; the value is None where there is none that counts."""

    case: str
    reference: Reference
    value: float | None

    @property
    def error(self) -> float:
        """Distance from the reference, in its unit."""
        return math.nan if self.value is None else abs(self.value - self.reference.value)

    @property
    def holds(self) -> bool:
        """Whether the value is near enough; no value is not."""
        return self.error <= self.reference.tolerance


@dataclass
class Result:
    """An entry that was scored.

    Attributes
    ----------
    rows : of the cases that it enters, in the order of the reference tables.
    costs : case -> seconds by the words of ``COSTS``.
    faults : sentences.
    """

    name: str
    rows: list[Scored] = field(default_factory=list)
    costs: dict[str, dict[str, float]] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)

    def of(self, case: str) -> list[Scored]:
        """Return the lines of a case."""
        return [row for row in self.rows if row.case == case]

    def score(self, case: str) -> float:
        """Return the share of the lines of a case that hold, 0 to 1; nan where it is not entered."""
        rows = self.of(case)
        return sum(row.holds for row in rows) / len(rows) if rows else math.nan


def read_references(folder: Path = HERE) -> dict[str, list[Reference]]:
    """Return case -> its reference table, for every folder that has one."""
    tables = {}
    for path in sorted(folder.glob(f"*/{REFERENCE}")):
        with path.open(newline="", encoding="utf-8") as file:
            lines = list(csv.DictReader(file))
        tables[path.parent.name] = [
            Reference(line["quantity"], float(line["time"]) if line["time"] else None, float(line["value"]),
                      line["unit"], float(line["tolerance"]), line["source"]) for line in lines]
    return tables


def _nearest(word: str, known) -> str:
    found = difflib.get_close_matches(word, list(known), n=1)
    return f'; did you mean "{found[0]}"?' if found else ""


def _number(text: str) -> float | None:
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def _same(first: float | None, second: float | None) -> bool:
    if first is None or second is None:
        return first is second
    return math.isclose(first, second, rel_tol=SAME_TIME, abs_tol=1e-9)


def score(path: Path, references: dict[str, list[Reference]]) -> Result:
    """Score one entry."""
    result = Result(path.stem)
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            lines = list(csv.reader(file))
    except (OSError, UnicodeDecodeError) as error:
        result.faults.append(f"{path}: cannot be read ({error})")
        return result
    if not lines or tuple(cell.strip() for cell in lines[0]) != COLUMNS:
        result.faults.append(f"{path}: its first line must be {','.join(COLUMNS)}")
        return result
    found: dict[tuple[str, int], float | None] = {}
    for number, line in enumerate(lines[1:], 2):
        if any(cell.strip() for cell in line) and (fault := _take(line, references, result, found)):
            result.faults.append(f"{path}: line {number}: {fault}")
    entered = dict.fromkeys(case for case, _ in found)
    for case in references:
        for index, reference in enumerate(references[case] if case in entered else ()):
            if (case, index) not in found:
                result.faults.append(f"{path}: {case} has no line {reference.name} ({reference.unit})")
            result.rows.append(Scored(case, reference, found.get((case, index))))
    if not found and not result.faults:
        result.faults.append(f"{path}: enters no case; there are {', '.join(references)}")
    return result


def _take(line: list[str], references: dict[str, list[Reference]], result: Result,
          found: dict[tuple[str, int], float | None]) -> str:
    """Take a line over into a result and what was found; return what is wrong with it, empty for nothing."""
    if len(line) != len(COLUMNS):
        return f"has {len(line)} cells, but must have {len(COLUMNS)}"
    case, quantity, time_text, value_text, unit = (cell.strip() for cell in line)
    if case not in references:
        return f'no case is called "{case}"{_nearest(case, references)}'
    value, time = _number(value_text), _number(time_text) if time_text else None
    if quantity in COSTS:
        if unit != "s":
            return f'{case}, {quantity} is in "{unit}", but must be in s'
        if not value_text:
            return ""
        if value is None or value < 0.0:
            return f'{case}, {quantity} is "{value_text}", but must be a number of seconds'
        result.costs.setdefault(case, {})[quantity] = value
        return ""
    known = dict.fromkeys(reference.quantity for reference in references[case])
    if quantity not in known:
        return f'{case} has no quantity "{quantity}"{_nearest(quantity, known)}'
    if time_text and time is None:
        return f'{case}, {quantity}: the time is "{time_text}", but must be a number of seconds'
    index = next((index for index, reference in enumerate(references[case])
                  if reference.quantity == quantity and _same(reference.time, time)), None)
    if index is None:
        times = [reference.time for reference in references[case] if reference.quantity == quantity]
        asked = ", ".join("empty" if one is None else f"{one:g}" for one in times)
        return f'{case}, {quantity}: nothing is asked at the time "{time_text}"; times are {asked}'
    reference = references[case][index]
    if (case, index) in found:
        return f"{case}, {reference.name} stands here for the second time"
    found[case, index] = None
    if unit != reference.unit:
        return f'{case}, {reference.name} is in "{unit}", but must be in {reference.unit}'
    if value is None:
        return f'{case}, {reference.name} is "{value_text}", but must be a number'
    found[case, index] = value
    return ""


def template(references: dict[str, list[Reference]]) -> str:
    """Return an entry without values."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for case, table in references.items():
        for reference in table:
            writer.writerow((case, reference.quantity, _cell(reference.time), "", reference.unit))
        writer.writerow((case, COSTS[0], "", "", "s"))
    return text.getvalue()


def _cell(number: float | None) -> str:
    return "" if number is None or math.isnan(number) else f"{number:.6g}"


def table_of_rows(results: list[Result]) -> str:
    """Return all lines as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("entry", "case", "quantity", "time", "value", "unit", "reference", "error", "tolerance", "holds"))
    for result in results:
        for row in result.rows:
            one = row.reference
            writer.writerow((result.name, row.case, one.quantity, _cell(one.time), _cell(row.value), one.unit,
                             _cell(one.value), _cell(row.error), _cell(one.tolerance), "yes" if row.holds else "no"))
    return text.getvalue()


def table_of_cases(results: list[Result], references: dict[str, list[Reference]]) -> str:
    """Return the scores case by case as CSV; a case that is not entered has none."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("entry", "case", "lines", "hold", "score", *(f"{cost}_s" for cost in COSTS)))
    for result in results:
        for case in references:
            rows, costs = result.of(case), result.costs.get(case, {})
            writer.writerow((result.name, case, len(rows), sum(row.holds for row in rows), _cell(result.score(case)),
                             *(_cell(costs.get(cost)) for cost in COSTS)))
    return text.getvalue()


def summary(results: list[Result], references: dict[str, list[Reference]]) -> str:
    """Return the scores as a table in Markdown: a line per case, a column per entry."""
    lines = [["case", *(result.name for result in results)], ["---"] * (len(results) + 1)]
    for case in references:
        cells = [case]
        for result in results:
            rows = result.of(case)
            cells.append(f"{sum(row.holds for row in rows)} of {len(rows)}" if rows else "–")
        lines.append(cells)
    totals = [[result.score(case) for case in references if result.of(case)] for result in results]
    lines.append(["**score**", *(f"**{sum(total):.1f}** of {len(total)} entered" for total in totals)])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def print_rows(result: Result) -> None:
    """Print every line of an entry, with its error."""
    print(f"{result.name}:")
    for row in result.rows:
        one = row.reference
        value = "no value" if row.value is None else f"{row.value:.4g}"
        error = "" if row.value is None else f", {row.error:.2g} off"
        print(f"  {row.case}, {one.name}: {value} (reference {one.value:.4g} {one.unit}{error}, {one.tolerance:.2g} "
              f"allowed): {'holds' if row.holds else 'does not hold'}")


def main(arguments: list[str] | None = None) -> int:
    """Run the command; see the head of the file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("entries", type=Path, nargs="?", help="folder of entries, or one CSV file")
    parser.add_argument("--output", type=Path, metavar="DIR",
                        help="folder to write rows.csv, cases.csv and scores.md into (default: scores in that of the "
                             "entries)")
    parser.add_argument("--cases", type=Path, default=HERE, metavar="DIR", help="folder of the cases (default: here)")
    parser.add_argument("--template", action="store_true", help="print an entry without values, and stop")
    options = parser.parse_args(arguments)
    references = read_references(options.cases)
    if not references:
        print(f"error: {options.cases}: no folder in it has a {REFERENCE}", file=sys.stderr)
        return 1
    if options.template:
        print(template(references), end="")
        return 0
    if options.entries is None or not options.entries.exists():
        print(f"error: {options.entries or 'entries'}: no such folder or file of entries", file=sys.stderr)
        return 1
    paths = sorted(options.entries.glob("*.csv")) if options.entries.is_dir() else [options.entries]
    if not paths:
        print(f"error: {options.entries}: holds no CSV file", file=sys.stderr)
        return 1
    results = [score(path, references) for path in paths]
    for result in results:
        print_rows(result)
    print(f"\n{summary(results, references)}")
    folder = options.output or (options.entries if options.entries.is_dir() else options.entries.parent) / "scores"
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in (("rows.csv", table_of_rows(results)), ("cases.csv", table_of_cases(results, references)),
                       ("scores.md", summary(results, references) + "\n")):
        (folder / name).write_text(text, encoding="utf-8")
    faults = [fault for result in results for fault in result.faults]
    for fault in faults:
        print(f"error: {fault}", file=sys.stderr)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
