"""The page on what accuracy costs in the eye: one picture, one sentence on every particle spacing, one table.

``eye_errors.csv`` is what estimates and the pages of runs tell of a scene of its spacing
(`pipeline.forecast.retina_error`).
"""
import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipeline.base import page
from pipeline.base.files import write_text
from pipeline.base.palette import COLORS
from pipeline.base.tables import csv_of
from pipeline.base.words import duration
from pipeline.forecast.retina_error import COLUMNS
from pipeline.studies.model import Outcome, Row
from pipeline.studies.plan import spacings
from pipeline.studies.question_page import WORDS, StudyPage, drawn, link_to, table_rows, write_picture, written_tables
from pipeline.web.embedded import data_url
from studies.questions.eye_accuracy._words import EYE_RUNS, covered_at

PICTURES, TABLES = ("accuracy_eye",), ("eye_runs", "eye_errors")
ON_THE_WAY = 4.0    # s, at which runs are set beside the finest one: oil still moves
AT_REST, WAY = COLORS[0], COLORS[1]


@dataclasses.dataclass(frozen=True)
class Size:
    """The runs of one particle spacing, one number per start.

    Attributes
    ----------
    spacing : mm. level : accuracy level of that spacing, empty if there is none.
    minutes : mean of the starts.
    rest : distance of the covered retina at the end from that at rest, points.
    way : its distance on the way from that of the finest run, points; empty for that one.
    rests_after : s; nan where a run has not come to rest.
    deepest : deepest point of the aqueous at the end, mm.
    """

    scene: str
    spacing: float
    level: str
    particles: int
    minutes: float
    rest: np.ndarray
    way: np.ndarray
    rests_after: np.ndarray
    deepest: np.ndarray
    deepest_at_rest: float

    @property
    def name(self) -> str:
        """The spacing with the level, in words."""
        return f"{self.level} ({self.spacing:g} mm)" if self.level else f"{self.spacing:g} mm"


def moment_of(lines: Sequence[dict[str, str]]) -> float:
    """Return the time on the way at which runs are set beside each other, s: the last one told up to `ON_THE_WAY`."""
    told = [float(name.split()[2]) for name in lines[0] if name not in EYE_RUNS]
    return max(moment for moment in told if moment <= ON_THE_WAY)


def sizes_of(lines: Sequence[dict[str, str]]) -> list[Size]:
    """Return what lines of the table ``eye_runs`` tell, coarse to fine."""
    way_column = covered_at(moment_of(lines))
    by_spacing: dict[float, list[dict[str, str]]] = {}
    for line in sorted(lines, key=lambda line: -float(line["spacing [mm]"])):
        by_spacing.setdefault(float(line["spacing [mm]"]), []).append(line)
    levels = {round(1e3 * spacing, 6): name for name, spacing in spacings().items()}

    def numbers(same: Sequence[dict[str, str]], column: str) -> np.ndarray:
        return np.array([float(line[column]) for line in same])

    finest = numbers(by_spacing[min(by_spacing)], way_column).mean()
    return [Size(
        same[0]["scene"], spacing, levels.get(round(spacing, 6), ""), int(float(same[0]["particles"])),
        float(numbers(same, "minutes").mean()),
        np.abs(numbers(same, "covered [%]") - numbers(same, "covered at rest [%]")),
        np.abs(numbers(same, way_column) - finest) if spacing > min(by_spacing) else np.zeros(0),
        numbers(same, "to rest [s]"), numbers(same, "deepest aqueous [mm]"),
        float(numbers(same, "deepest aqueous at rest [mm]").mean())) for spacing, same in by_spacing.items()]


def in_short(outcomes: Sequence[Outcome]) -> list[Outcome]:
    """Return what every spacing buys, as rows and a sentence."""
    lines = table_rows(outcomes, "eye_runs")
    moment, found = moment_of(lines), Outcome(case="the eye at")
    for size in sizes_of(lines):
        rows = [("computing time", size.minutes, "min"), ("starts", float(len(size.rest)), "1")]
        rows += [(f"off at rest, {which}", value, "points") for which, value in (
            ("mean", size.rest.mean()), ("least", size.rest.min()), ("largest", size.rest.max()))]
        if len(size.way):
            rows.append((f"off the finest run at {moment:g} s, largest", size.way.max(), "points"))
        if np.isfinite(size.rests_after).all():
            rows.append(("time to rest", size.rests_after.mean(), "s"))
        rows += [("deepest aqueous", size.deepest.mean(), "mm"),
                 ("deepest aqueous at rest, exact", size.deepest_at_rest, "mm")]
        # More digits than three say nothing of runs whose starts differ.
        found.rows += [Row(name, float(f"{value:.3g}"), unit, at=f"{size.spacing:g} mm") for name, value, unit in rows]
        found.remarks.append(sentence(size, moment))
    return [found]


def sentence(size: Size, moment: float) -> str:
    """Return what a spacing buys, in one sentence."""
    starts = f" ({size.rest.min():.1f} to {size.rest.max():.1f} from {len(size.rest)} starts)" * (len(size.rest) > 1)
    way = (f"{moment:g} s after the start it is within {size.way.max():.1f} points of the finest run" if len(size.way)
           else "no run was finer")
    known = np.isfinite(size.rests_after)
    rest = (f"oil rests {size.rests_after.mean():.1f} s after the last movement" if known.all() else
            "not every start has come to rest" if known.any() else "the oil has not come to rest")
    return (f"{size.name}, {duration(60.0 * size.minutes)} on the clock: at the end the covered retina is "
            f"{size.rest.mean():.1f} points{starts} from that of least energy; {way}; {rest}; the aqueous is "
            f"{size.deepest.mean():.1f} mm deep, at rest {size.deepest_at_rest:.1f} mm.")


def write_page(description: str, outcomes: Sequence[Outcome], target: Path) -> list[str]:
    """Write picture and tables into a folder, and return the parts of the page."""
    lines = written_tables(outcomes, TABLES[:1], target)["eye_runs"]
    sizes, moment = sizes_of(lines), moment_of(lines)
    picture = picture_of(sizes, moment)
    write_picture(target / "accuracy_eye.png", picture)
    write_text(target / "eye_errors.csv", csv_of(COLUMNS, [(
        size.scene, f"{1e-3 * size.spacing:.6g}", len(size.rest), f"{size.minutes:.4g}",
        *(f"{number:.4g}" for number in (size.rest.mean(), size.rest.min(), size.rest.max()))) for size in sizes]))
    return [page.filled(
        __file__, description=description, picture=data_url(picture, "image/png"),
        sentences=[sentence(size, moment) for size in sizes], points=WORDS["points"],
        method=link_to("methods/equilibrium.md"),
        remarks=[remark for outcome in outcomes for remark in outcome.remarks],
        runs=page.table(list(lines[0]), [list(line.values()) for line in lines], words=(0, 1)))]


def picture_of(sizes: Sequence[Size], moment: float) -> bytes:
    """Error of the covered retina against computing time, with time to rest and depth of the aqueous beside, as PNG."""
    from matplotlib.ticker import LogLocator, NullFormatter

    minutes = np.array([size.minutes for size in sizes])

    def starts(axes, chosen: Sequence[tuple[float, np.ndarray]], color: str, label: str | None, look: str) -> None:
        """A curve through the means, with bars from the least to the largest."""
        known = [(x, values) for x, values in chosen if len(values) and np.isfinite(values).all()]
        if known:
            axes.plot([x for x, _ in known], [values.mean() for _, values in known], look, color=color, lw=1.8, ms=7,
                      label=label)
            axes.vlines([x for x, _ in known], [values.min() for _, values in known],
                        [values.max() for _, values in known], color=color, lw=2.5, alpha=0.6)

    def draw(grid) -> None:
        figure, places = grid[0, 0].figure, grid[0, 0].get_gridspec()
        for axes in grid[:, 0]:
            axes.remove()
        main = figure.add_subplot(places[:, 0])
        starts(main, list(zip(minutes, [size.rest for size in sizes], strict=True)), AT_REST,
               "at the end, from the exact shape at rest", "o-")
        starts(main, list(zip(minutes, [size.way for size in sizes], strict=True)), WAY,
               f"on the way, at {moment:g} s, from the finest run", "s--")
        main.set(ylabel="retina under oil is off by / points", xlabel="computing time / minutes")
        main.set_ylim(0.0, 1.35 * main.get_ylim()[1])
        for size in sizes:
            top = max([*size.rest, *size.way])
            main.annotate(f"{size.spacing:g} mm" + f"\n{size.level}" * bool(size.level), (size.minutes, top), (0, 7),
                          textcoords="offset points", ha="center", fontsize=9.5)
        main.legend(frameon=False, fontsize=9.5, loc="upper right")
        rest, deep = grid[:, 1]
        starts(rest, list(zip(minutes, [size.rests_after for size in sizes], strict=True)), AT_REST, None, "o-")
        rest.set_title("Time to rest / s", loc="left", fontsize=10.5)
        if not rest.lines:
            rest.text(0.5, 0.5, "no run has come to rest", transform=rest.transAxes, ha="center", fontsize=9.5)
            rest.set_yticks([])
        starts(deep, list(zip(minutes, [size.deepest for size in sizes], strict=True)), AT_REST, None, "o-")
        deep.axhline(np.mean([size.deepest_at_rest for size in sizes]), color="black", ls=":", lw=1.4)
        deep.set_title("Deepest aqueous / mm\n(dotted: exact, at rest)", loc="left", fontsize=10.5)
        deep.set_xlabel("computing time / minutes")
        for axes in (rest, deep):
            axes.margins(y=0.2)
        for axes in (main, rest, deep):
            axes.set_xscale("log")
            axes.set_xlim(minutes.min() / 1.6, minutes.max() * 1.6)
            axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
            axes.xaxis.set_major_formatter("{x:g}")
            axes.xaxis.set_minor_formatter(NullFormatter())
            axes.tick_params(labelsize=9.5)
            axes.grid(alpha=0.3)

    return drawn((7.6, 4.3), draw, 2, 2, gridspec_kw={"width_ratios": (2.1, 1.0)})


PAGE = StudyPage(__name__, PICTURES, TABLES, write_page, in_short)
