"""Write the pages of docs/results, and the numbers of README.md, from the tables of docs/results.

    python -m studies.results            write the pages
    python -m studies.results --check    exit code 1 where a page is older than its tables
    python -m studies.results --take outputs/studies/injection_size_study/draft outputs/tamponade/standard
                                               first take over the numbers of these runs
"""
import argparse
import contextlib
import csv
import fcntl
import fnmatch
import os
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from pipeline.base.cli import CommandLine, run
from pipeline.base.errors import UserError
from pipeline.base.markdown import settle, table
from pipeline.base.numbers import plain
from studies.results.plan import PLAN, not_made, read_plan
from studies.results.tables import (
    FOLDER,
    LAYOUT,
    Group,
    Headline,
    Layout,
    Page,
    Row,
    read_layout,
    read_rows,
    write_rows,
)
from studies.results.take_over import take_over

ROOT = Path(__file__).resolve().parents[2]
COMMAND = "python -m studies.results"
BEGIN, END = "<!-- numbers of docs/results -->", "<!-- end of the numbers -->"
ABOUT = ("size", "level", "machine", "code", "command")  # what many rows share
BENCHMARKS, PEERS = "benchmarks", Path("benchmarks") / "dam_break" / "results.csv"  # docs/benchmarks.md has them
AGE = "README.md#how-old-is-a-number"


def amount(number: str, unit: str) -> str:
    """Return a number with its unit; digits of whole numbers in threes."""
    if not number:
        return ""
    text = f"{int(number):,}" if number.lstrip("-").isdecimal() else number
    return f"{text} {unit}".strip()


class Footnotes:
    """The caveats of a page; the same words are one footnote."""

    def __init__(self):
        self.words: list[str] = []

    def mark(self, note: str) -> str:
        """Return what points to a footnote; nothing for none."""
        if not note:
            return ""
        if note not in self.words:
            self.words.append(note)
        return f"[^{self.words.index(note) + 1}]"

    def text(self) -> str:
        """All of them, for the end of the page."""
        return "".join(f"\n[^{number}]: {note}\n" for number, note in enumerate(self.words, 1))


def facts(rows: Sequence[Row]) -> tuple[str, tuple[str, ...]]:
    """Return a line with what all rows share, and the names of what they do not."""
    shared, own = [], []
    for name in ABOUT:
        values = {getattr(row, name) for row in rows}
        if len(values) > 1:
            own.append(name)
        elif value := values.pop():
            shared.append(f"{name} {_about(name, value)}")
    return (f"All of this table: {'; '.join(shared)}." if shared else ""), tuple(own)


def _about(name: str, value: str) -> str:
    if name == "command" and value:
        return f"`{value}`"
    return f"[{value}]({AGE})" if name == "code" and value else value


def long_table(rows: Sequence[Row], own: Sequence[str], footnotes: Footnotes) -> str:
    """A line per number."""
    columns = {
        "case": [row.case for row in rows],
        "quantity": [row.quantity for row in rows],
        "value": [amount(row.value, row.unit) + (footnotes.mark(row.note) if row.value else "") for row in rows],
        "expected": [amount(row.expected, row.unit) for row in rows],
        "error": [amount(row.error, row.error_unit) + ("" if row.value else footnotes.mark(row.note)) for row in rows],
        "allowed": [amount(row.allowed, row.error_unit) for row in rows],
        "holds": [row.holds for row in rows],
        **{name: [_about(name, getattr(row, name)) for row in rows] for name in own},
    }
    columns = {name: cells for name, cells in columns.items() if any(cells)}
    return table(tuple(columns), list(zip(*columns.values(), strict=True)))


def wide_table(rows: Sequence[Row], own: Sequence[str], footnotes: Footnotes) -> str:
    """A line per case, a column per quantity."""
    cases, quantities = (list(dict.fromkeys(getattr(row, name) for row in rows)) for name in ("case", "quantity"))
    found = {(row.case, row.quantity): row for row in rows}
    if len(found) < len(rows):
        raise UserError(f"the table {rows[0].table} has a case and quantity twice, and so cannot be wide")
    columns = {"case": cases}
    for quantity in quantities:
        of = [found.get((case, quantity)) for case in cases]
        columns[quantity] = [_cell(row, footnotes) if row else "" for row in of]
        for name, unit in (("expected", "unit"), ("allowed", "error_unit"), ("holds", "")):
            cells = [amount(getattr(row, name), getattr(row, unit) if unit else "") if row else "" for row in of]
            if any(cells):
                columns[f"{quantity}: {name}"] = cells
    for name in own:
        columns[name] = [", ".join(dict.fromkeys(_about(name, getattr(row, name)) for row in rows if row.case == case
                                                 and getattr(row, name))) for case in cases]
    return table(tuple(columns), list(zip(*columns.values(), strict=True)))


def _cell(row: Row, footnotes: Footnotes) -> str:
    shown = amount(row.value, row.unit) if row.value else amount(row.error, row.error_unit)
    return shown + footnotes.mark(row.note)


def summary_table(page: Page, rows: Sequence[Row]) -> str:
    """How many numbers of every group hold, and the quantities of those that do not.

    Raises
    ------
    UserError : a number that is allowed an error belongs to no group.
    """
    grouped: dict[Group, list[Row]] = {group: [] for group in page.summary}
    for row in (row for row in rows if row.holds):
        of = [group for group in grouped if any(fnmatch.fnmatchcase(row.case, pattern) for pattern in group.cases)]
        if len(of) != 1:
            raise UserError(f"{LAYOUT}: {row.case} is in {len(of)} groups of the summary of {page.name}, but must be "
                            "in one")
        grouped[of[0]].append(row)
    body = []
    for solver in dict.fromkeys(group.of for group in grouped):
        groups = {group.words: found for group, found in grouped.items() if group.of == solver}
        if len(groups) > 1:
            body.append(_count(f"**{solver}**", [row for found in groups.values() for row in found], told=False))
            body += [_count(words, found) for words, found in groups.items()]
        else:
            body.append(_count(f"**{solver}**", next(iter(groups.values()))))
    return table(("", "numbers", "hold", "what does not, and how often"), body)


def _count(words: str, rows: Sequence[Row], told: bool = True) -> tuple[str, int, int, str]:
    missed = Counter(f"`{row.case.partition('-')[0]}`: {row.quantity}" for row in rows if row.holds == "no")
    return (words, len(rows), sum(row.holds == "yes" for row in rows),
            "; ".join(f"{name} ({count})" for name, count in missed.items()) if told else "")


def page_text(page: Page, rows: Sequence[Row]) -> str:
    """Return a page."""
    footnotes = Footnotes()
    parts = [f"# {page.title}", f"Made by `{COMMAND}` from [{page.name}.csv]({page.name}.csv).", page.text.strip()]
    if page.summary:
        parts += ["## Summary", summary_table(page, rows)]
    for one in page.tables:
        own_rows = [row for row in rows if row.table == one.name]
        parts += [f"## {one.title}", one.text.strip()]
        if one.figure:
            parts.append(f"![{one.caption}](../images/{one.figure})")
        if own_rows:
            shared, own = facts(own_rows)
            parts += [(wide_table if one.wide else long_table)(own_rows, own, footnotes), shared]
        parts.append(one.after.strip())
    return "\n\n".join(part for part in parts if part) + "\n" + footnotes.text()


def index_text(layout: Layout, rows: dict[str, list[Row]]) -> str:
    """Return the page that lists the pages."""
    body = []
    for page in layout.pages:
        asked = [row for row in rows[page.name] if row.holds]
        body.append((f"[{page.title}]({page.name}.md)", len(rows[page.name]), len(asked),
                     sum(row.holds == "yes" for row in asked)))
    return "\n\n".join((f"# {layout.title}", f"Made by `{COMMAND}`.",
                        table(("page", "numbers", "of which something is asked", "that hold"), body),
                        layout.text.strip(), ages(layout))) + "\n"


def ages(layout: Layout) -> str:
    """Which numbers lack which changes of the solver, as a table."""
    return table(("change of the solver, and its commit", "code of the numbers that lack it, and all below it"),
                 [(f"{one.words} ({one.commit})", ", ".join(one.before)) for one in layout.changes])


def headline(one: Headline, rows: dict[str, list[Row]], quantity: str = "") -> Row:
    """Return the row of a number of the README, or of another quantity of the same case.

    Raises
    ------
    UserError : there is none, or more than one.
    """
    found = [row for row in rows.get(one.page, []) if (row.case, row.quantity) == (one.case, quantity or one.quantity)
             and one.level in ("", row.level)]
    if len(found) != 1:
        raise UserError(f"{len(found)} rows of the page {one.page} are {one.case}: {quantity or one.quantity}; "
                        "README.md needs 1")
    return found[0]


def readme_text(old: str, layout: Layout, rows: dict[str, list[Row]]) -> str:
    """Return the README with the numbers between its marks made anew, and how many of all hold.

    Raises
    ------
    UserError : it has no such marks.
    """
    before, mark, rest = old.partition(BEGIN)
    _, other, after = rest.partition(END)
    if not mark or not other:
        raise UserError(f"README.md: has not the lines {BEGIN} and {END}")
    body = []
    for one in layout.headlines:
        row = headline(one, rows)
        shown = amount(row.value, row.unit) if row.value else amount(row.error, row.error_unit)
        if one.band:
            half = 0.5 * float(headline(one, rows, one.band).value)
            shown = amount(f"{row.value} ± {plain(half, len(row.value.partition('.')[2]))}", row.unit)
        place = Path("docs") if one.page == BENCHMARKS else FOLDER
        body.append((f"[{one.words}]({(place / one.page).as_posix()}.md)", f"**{shown}**",
                     amount(row.expected, row.unit) if row.value else "", row.holds, row.size, f"`{row.command}`"))
    head = ("what", "number", "reference", "holds", "size", "command")
    asked = [row for page in layout.pages for row in rows[page.name] if row.holds]
    near = sum(row.holds == "yes" for row in asked)
    counts = (f"*Reference*: what was asked for, or an exact or independent solution; *±*: how well the contact line "
              f"is read, half a spacing; particles: at the start. Of all [{len(asked)} numbers]({FOLDER.as_posix()}/"
              f"README.md) that have one, {near} are within their tolerance; [what misses]({FOLDER.as_posix()}/"
              f"validation.md#summary) is mostly other solvers, and layers told apart by labels alone.")
    return f"{before}{mark}\n{table(head, body)}\n\n{counts}\n{other}{after}"


def benchmark_rows(root: Path) -> list[Row]:
    """Return the numbers of the README that the benchmarks have in a table of their own."""
    with (root / PEERS).open(newline="", encoding="utf-8") as file:
        return [Row("", f"{line['program']}, {line['particles']}, liquids {line['liquids']}",
                    "times as fast as SPlisHSPlasH", f"{float(line['wall_ratio']):.1f}",
                    size=f"{int(line['particles']):,} particles",
                    command="python benchmarks/dam_break/compare.py") for line in csv.DictReader(file)]


def pages_of(root: Path, layout: Layout, rows: dict[str, list[Row]]) -> dict[Path, str]:
    """Return path -> text of all that is made from the tables."""
    texts = {root / FOLDER / f"{page.name}.md": page_text(page, rows[page.name]) for page in layout.pages}
    readme = root / "README.md"
    return texts | {root / FOLDER / "README.md": index_text(layout, rows),
                    readme: readme_text(readme.read_text(encoding="utf-8"), layout,
                                        rows | {BENCHMARKS: benchmark_rows(root)})}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; see ``--help``."""
    p = CommandLine(prog=COMMAND, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--check", action="store_true", help="compare only")
    p.add_argument("--take", type=Path, nargs="+", default=[], metavar="DIR",
                   help="outputs/studies/<study>/<level> or outputs/<scene>/<level>, whose numbers replace older ones")
    p.add_argument("--add", default="", metavar="TABLE=PATTERN",
                   help="with --take of a study: also bring cases of such names that a table does not have yet")
    p.add_argument("--code", help="what the column code says of them (default: what a study says of itself; of a run, "
                                  "this version and the last commit before it was written)")
    p.add_argument("--project", type=Path, default=ROOT, metavar="DIR", help="folder of README.md and docs")
    options = p.parse_args(arguments)
    if options.check and options.take:
        raise UserError("--check: changes nothing, and so --take cannot be given with it")
    with alone_in(options.project / FOLDER):
        return written(options)


@contextlib.contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Wait until no other process changes the tables of a folder: jobs of one workflow take numbers side by side."""
    if not folder.is_dir():
        raise UserError(f"{folder}: no such folder of results")
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):  # disks of a network that have no locks
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def written(options: argparse.Namespace) -> int:
    """Take over numbers and write the pages, or compare them; return the exit code."""
    folder = options.project / FOLDER
    layout = read_layout(folder)
    rows = {page.name: read_rows(folder, page) for page in layout.pages}
    known = {"README", *rows}
    if strangers := [path for path in folder.iterdir() if path.suffix in (".md", ".csv") and path.stem not in known]:
        raise UserError(f"{strangers[0]}: belongs to no page of {LAYOUT}; remove it")
    plan = options.project / PLAN
    if plan.is_file() and (untold := list(not_made(read_plan(plan), rows))):
        raise UserError(*untold)
    if options.take:
        for taken in options.take:
            count = take_over(taken, layout, rows, options.code, options.add)
            print(f"{taken}: {count} numbers")
        for page in layout.pages:
            write_rows(folder, page, rows[page.name])
    return settle(pages_of(options.project, layout, rows), options.check, COMMAND)


if __name__ == "__main__":
    run(main)
