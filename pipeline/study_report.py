"""Stage: the outcomes of a study's cases become its table, its figures and its page of the report."""
import argparse
import csv
import itertools
from collections.abc import Iterable, Sequence
from pathlib import Path

from pipeline.base import page
from pipeline.base.cli import run
from pipeline.base.files import replacing, write_text
from pipeline.study_kit.model import COLUMNS, Curve, Figure, Outcome
from pipeline.study_kit.plan import Study, load_study

MARKERS = "osD^v<>Pp*Xh"
COLORS = ("#1b6ca8", "#c8553d", "#3a8f5c", "#8e5ba6", "#c99a2e", "#4b4e57", "#d16ba5", "#4aa8a0")
VERDICTS = {"true": "✓", "false": "✗", "": ""}


def write_study(study: Study, folders: Sequence[Path], target: Path) -> None:
    """Write ``table.csv``, ``table.html`` and all PNG files of a study into ``target`` and print a summary."""
    outcomes = [Outcome.read(folder) for folder in folders]
    if study.report == "tradeoff":
        from pipeline.study_kit.tradeoff import unasked, write_tradeoff  # the solver takes a second to import

        outcomes = write_tradeoff(study, outcomes, target) + [unasked(outcome) for outcome in outcomes]
    rows = [row.cells(outcome.case) for outcome in outcomes for row in outcome.rows]
    _write_csv(target / "table.csv", rows)
    for figure in study.figures():
        _draw(target / f"{figure.name}.png", figure, [curve for outcome in outcomes for curve in outcome.curves
                                                     if curve.figure == figure.name])
    made = [outcome.pictures for outcome in outcomes]
    made += [family.pictures(outcomes) for family in study.families() if hasattr(family, "pictures")]
    for pictures in made:
        for name in pictures.keys() & set(study.pictures()):
            content = pictures[name]
            with replacing(target / f"{name}.png") as partial:
                partial.write_bytes(content)
    parts = []
    if study.report == "filled_eye":
        from pipeline.study_kit.filled_eye_page import write_filled_eye

        parts = write_filled_eye(study.description, outcomes, target)
    if study.report == "patient_eyes":
        from pipeline.study_kit.patient_eyes_page import write_patient_eyes

        parts = write_patient_eyes(study.description, outcomes, target)
    _write_page(target / "table.html", study, outcomes, rows, parts)
    print(summary(study.name, rows))


def summary(name: str, rows: Iterable[dict[str, str]]) -> str:
    """Return how many rows hold, and every one that does not."""
    asked = [row for row in rows if row["holds"]]
    missed = [row for row in asked if row["holds"] == "false"]
    lines = [f"{name}: {len(asked) - len(missed)} of {len(asked)} rows hold" + (", these do not:" if missed else "")]
    lines += [f"  {row['case']}: {row['quantity']} is {row['value']} {row['unit']}, error {row['error'] or 'unknown'} "
              f"above {row['tolerance']}" for row in missed]
    return "\n".join(lines)


def _write_csv(path: Path, rows: Iterable[dict[str, str]]) -> None:
    with replacing(path) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def _draw(path: Path, figure: Figure, curves: Sequence[Curve]) -> None:
    """Draw one figure; a reference that several cases bring is drawn once."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure as Canvas

    canvas = Canvas(figsize=(9.5, 5.2), layout="constrained")
    axes = FigureCanvasAgg(canvas).figure.subplots()
    looks = itertools.cycle(zip(itertools.cycle(COLORS), MARKERS, strict=False))
    references: dict[str, Curve] = {}
    for curve in curves:
        if curve.style == "reference":
            references[curve.label] = curve
            continue
        color, marker = next(looks)
        if curve.style == "line":
            axes.plot(curve.x, curve.y, color=color, lw=1.6, label=curve.label)
        else:
            joined = "-" if figure.logarithmic else ""
            axes.plot(curve.x, curve.y, joined, color=color, marker=marker, ms=5, lw=1.2, label=curve.label)
    for curve, dashes in zip(references.values(), itertools.cycle(("-", "--", ":", "-."))):
        axes.plot(curve.x, curve.y, dashes, color="black", lw=1.2, label=curve.label, zorder=5)
    if figure.logarithmic:
        axes.set(xscale="log", yscale="log")
    axes.set(xlabel=figure.x, ylabel=figure.y)
    axes.set_title(figure.title, loc="left", fontsize=12)
    axes.grid(alpha=0.3, which="both" if figure.logarithmic else "major")
    if curves:
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
    words = [COLUMNS.index(column) for column in ("quantity", "unit", "holds")]
    asked = [row for row in rows if row["holds"]]
    held = sum(row["holds"] == "true" for row in asked)
    found = f"Accuracy {study.accuracy}: {held} of {len(asked)} rows with a tolerance hold."
    table = page.table(COLUMNS, cells, words, [number for number, row in enumerate(rows) if row["holds"] == "false"])
    write_text(path, page.page(study.title, [*instead, page.details(found, table)] if instead else [
        page.paragraph(study.description),
        page.paragraph(found),
        page.bullets([remark for outcome in outcomes for remark in outcome.remarks]),
        table,
    ], style="td,th{padding:.35em .4em}" if instead else ""))


def main() -> None:
    """Command line: ``python -m pipeline.study_report <study> CASE_DIR... --output DIR``."""
    p = argparse.ArgumentParser(prog="python -m pipeline.study_report", description=__doc__)
    p.add_argument("study", help="name of the study")
    p.add_argument("cases", type=Path, nargs="+", metavar="CASE_DIR", help="outcomes of its cases")
    p.add_argument("--accuracy", default="draft", help="level of config/accuracy.yaml (default draft)")
    p.add_argument("--output", type=Path, required=True, metavar="DIR", help="folder for table and figures")
    arguments = p.parse_args()
    write_study(load_study(arguments.study, arguments.accuracy), arguments.cases, arguments.output)


if __name__ == "__main__":
    run(main)
