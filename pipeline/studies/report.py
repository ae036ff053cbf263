"""The table, the figures and the page of a study, made of the outcomes of its cases.

A case without a result is a row that does not hold, and a sentence that says why.
"""
import dataclasses
import itertools
from collections.abc import Iterable, Sequence
from pathlib import Path

from pipeline.base import page
from pipeline.base.canvas import empty_figure
from pipeline.base.errors import UserError
from pipeline.base.files import replacing, write_text
from pipeline.base.tables import csv_of
from pipeline.base.words import no_formula
from pipeline.studies.model import COLUMNS, FAILED, MADE, OUTCOME, Curve, Figure, Outcome
from pipeline.studies.plan import Case, Study

MARKERS = "osD^v<>Pp*Xh"
COLORS = ("#1b6ca8", "#c8553d", "#3a8f5c", "#8e5ba6", "#c99a2e", "#4b4e57", "#d16ba5", "#4aa8a0")
VERDICTS = {"true": "✓", "false": "✗", "": ""}
OUTPUTS = Path("outputs/studies")
SO_FAR = "so_far"  # folder in that of a study
DEPENDS = "depends.txt"  # in the folder of a case, beside its outcome: the digest of the case that was run
MOST_LABELS = 40  # of curves in a figure: the names of more cannot be read
MOST_LINES = 20  # of rows that do not hold in the summary; all of them are in the table


def outcomes_so_far(study: Study, folder: Path) -> list[Outcome]:
    """Return the outcomes of all cases in the folder of a study; those that are missing say why.

    An outcome of other parameters or of other code, which the next run replaces, is none of the case.
    """
    return [_outcome_so_far(case, folder) for case in study.cases.values()]


def _outcome_so_far(case: Case, folder: Path) -> Outcome:
    own = folder / "cases" / case.name
    if not (own / OUTCOME).is_file():
        return Outcome.failed(case.name, _why_missing(case, folder / "logs" / f"{case.name}.log"))
    if (own / DEPENDS).is_file() and (own / DEPENDS).read_text(encoding="utf-8") != case.digest():
        return Outcome.failed(case.name, "what is there is of an earlier version of the case or its code; run it again")
    try:
        return Outcome.read(own)
    except UserError as error:
        return Outcome.failed(case.name, str(error))


def _why_missing(case: Case, log: Path) -> str:
    """What the log of a case, or those of the scenes that it reads, end with."""
    if log.is_file():
        return _last_error(log) or f"it has not come to its end, see {log}"
    errors = (_last_error(path) for scene in case.folders().values() for path in sorted(scene.glob("logs/*.log")))
    return next(filter(None, errors), "it has not been run")


def _last_error(log: Path) -> str:
    """The sentence with which a stage has ended, or the last line of a traceback; empty in other logs."""
    lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    errors = [line.removeprefix("error: ") for line in lines if line.startswith("error: ")]
    if not errors and any(line.startswith("Traceback ") for line in lines):
        errors = [lines[-1]]
    return errors[-1] if errors else ""


def write_study(study: Study, outcomes: Sequence[Outcome], target: Path, complete: bool = True) -> None:
    """Write ``table.csv``, ``table.html`` and all PNG files of a study into ``target`` and print a summary.

    Parameters
    ----------
    outcomes : one of every case, in the order of the study.
    complete : a page that answers a question in its own words has them; they are about all cases.
    """
    failed = [outcome for outcome in outcomes if outcome.failure]
    found = [outcome for outcome in outcomes if not outcome.failure]
    if study.page and study.page.judge:
        with_result = dataclasses.replace(study, cases={one.case: study.case(one.case) for one in found})
        found = study.page.judge(with_result, found, target)
    in_short = study.page.in_short(found) if study.page and complete else []
    outcomes = [*in_short, *found, *failed]
    rows = [row.cells(outcome.case) for outcome in outcomes for row in outcome.rows]
    made = [_made(study, [outcome] if outcome.machine else found) for outcome in outcomes for _ in outcome.rows]
    write_text(target / "table.csv", csv_of((*COLUMNS, *MADE), [row | by for row, by in zip(rows, made, strict=True)]))
    for figure in study.figures():
        _draw(target / f"{figure.name}.png", figure, [curve for outcome in outcomes for curve in outcome.curves
                                                     if curve.figure == figure.name])
    drawn = [outcome.pictures for outcome in outcomes]
    drawn += [family.draw(found) for family in study.families() if found and family.draw]
    for pictures in drawn:
        for name in sorted(pictures.keys() & set(study.pictures())):
            content = pictures[name]
            with replacing(target / f"{name}.png") as partial:
                partial.write_bytes(content)
    parts = study.page.write(study.description, found, target) if study.page and complete else []
    _write_page(target / "table.html", study, outcomes, rows, parts)
    print(summary(study.name, rows))


def _made(study: Study, outcomes: Sequence[Outcome]) -> dict[str, str]:
    """Where, with which code and by what the rows of some outcomes were made."""
    return {"machine": "; ".join(dict.fromkeys(outcome.machine for outcome in outcomes)),
            "code": "; ".join(dict.fromkeys(outcome.code for outcome in outcomes)), "command": study.command}


def summary(name: str, rows: Iterable[dict[str, str]]) -> str:
    """Return how many rows hold, and every one that does not."""
    asked = [row for row in rows if row["holds"]]
    missed = [row for row in asked if row["holds"] == "false"]
    lines = [f"{name}: {len(asked) - len(missed)} of {len(asked)} rows hold" + (", these do not:" if missed else "")]
    lines += [f"  {row['case']}: " + (FAILED if row["quantity"] == FAILED else (
        f"{row['quantity']} is {row['value']} {row['unit']}, error {row['error'] or 'unknown'} above "
        f"{row['tolerance']}")) for row in missed[:MOST_LINES]]
    if len(missed) > MOST_LINES:
        lines.append(f"  and {len(missed) - MOST_LINES} more, see its table")
    return "\n".join(lines)


def _draw(path: Path, figure: Figure, curves: Sequence[Curve]) -> None:
    """Draw one figure; a reference that several cases bring is drawn once."""
    canvas = empty_figure((9.5, 5.2))
    axes = canvas.subplots()
    looks = itertools.cycle(zip(itertools.cycle(COLORS), MARKERS, strict=False))
    references: dict[str, Curve] = {}
    for curve in curves:
        if curve.style == "reference":
            references[curve.label] = curve
            continue
        color, marker = next(looks)
        if curve.style == "line":
            axes.plot(curve.x, curve.y, color=color, lw=1.6, label=no_formula(curve.label))
        else:
            joined = "-" if figure.logarithmic else ""
            axes.plot(curve.x, curve.y, joined, color=color, marker=marker, ms=5, lw=1.2, label=no_formula(curve.label))
    for curve, dashes in zip(references.values(), itertools.cycle(("-", "--", ":", "-."))):
        axes.plot(curve.x, curve.y, dashes, color="black", lw=1.2, label=no_formula(curve.label), zorder=5)
    if figure.logarithmic:
        axes.set(xscale="log", yscale="log")
    axes.set(xlabel=figure.x, ylabel=figure.y)
    axes.set_title(figure.title, loc="left", fontsize=12)
    axes.grid(alpha=0.3, which="both" if figure.logarithmic else "major")
    if curves and len(axes.get_lines()) <= MOST_LABELS:
        canvas.legend(loc="outside right upper", frameon=False, fontsize=8)
    with replacing(path) as partial:
        canvas.savefig(partial, dpi=130)


def _write_page(path: Path, study: Study, outcomes: Sequence[Outcome], rows: Sequence[dict[str, str]],
                instead: Sequence[str] = ()) -> None:
    """Write the page: what was asked, what was found in words, and the table with the rows that do not hold marked.

    Parameters
    ----------
    instead : what a study says in words of its own; the table can then be opened below.
    """
    cells = [[VERDICTS[row[column]] if column == "holds" else row[column] for column in COLUMNS] for row in rows]
    words = [COLUMNS.index(column) for column in ("quantity", "unit", "error_is", "holds")]
    asked = [row for row in rows if row["holds"]]
    held = sum(row["holds"] == "true" for row in asked)
    found = f"{held} of {len(asked)} with a tolerance are within it" if asked else "none has a tolerance"
    write_text(path, page.page(study.title, [page.filled(
        __file__, description=study.description, accuracy=study.accuracy, found=found, instead=instead,
        command=study.command,
        remarks=[remark for outcome in outcomes for remark in outcome.remarks],
        numbers=page.table(COLUMNS, cells, words, [number for number, row in enumerate(rows)
                                                   if row["holds"] == "false"]))]))
