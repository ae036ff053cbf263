"""The page of a comparison: what accuracy costs, and what it changes."""
import math
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipeline.base import page
from pipeline.base.numbers import plain
from pipeline.base.tables import TIME
from pipeline.base.words import NO_ADVICE, duration, in_a_row
from pipeline.comparison.levels import ALL_CORES, BESIDE_COST, CLOCK, Change, cost, in_short, last_pictures, of_level
from pipeline.measures.least_energy import RESTING, LeastEnergy
from pipeline.pictures.moments import read_picture, scaled
from pipeline.runs.run_folder import RunFolder
from pipeline.scenes.effects import illustration_in_words
from pipeline.web.chart import Chart, Series, chart_library, chart_style, charts
from pipeline.web.embedded import data_url, webp
from pipeline.web.scripts import POLICY

PICTURE_WIDTH = 1280  # pixels
MARKED = 0.1        # share of the extent of a metric from which its row is marked
HERE = Path(__file__).parent


def rows_of(runs: Sequence[RunFolder], found: Sequence[Change]) -> tuple[list[str], list[list[str]]]:
    """Return heads and rows of the table: the cost, then every metric."""
    heads = ["what", "unit", *(run.level for run in runs), RESTING, "largest difference", "at [s]",
             "of its extent"]
    lines = []
    costs = [cost(run) for run in runs]
    for name in [name for name in costs[0] if all(name in one for one in costs)]:
        words, _, unit = name.rstrip("]").partition(" [")
        lines.append([words, unit, *(f"{one[name]:.6g}" for one in costs), "", "", "", ""])
    lines += [[one.name, one.unit, *(f"{value:.6g}" if math.isfinite(value) else "" for value in one.values),
               "" if one.at_rest is None else f"{one.at_rest:.6g}", f"{one.largest:.6g}",
               f"{one.time:.6g}" if one.largest else "", f"{100 * one.share:.1f} %"] for one in found]
    return heads, lines


def price_table(runs: Sequence[RunFolder], found: Sequence[Change]) -> tuple[list[str], list[list[str]]]:
    """Return heads and rows of what accuracy costs: a row for every level, its cost first, then what it tells."""
    first = [one for one in found if one.drawn][:BESIDE_COST]
    heads = ["level", "resolution", "particles", "time steps", "computing time, all cores", "by the clock"]
    heads += [f"{one.name}{one.unit and f' [{one.unit}]'}" for one in first]
    off = first[0] if first and first[0].at_rest is not None else None
    if off is not None:
        heads.append(f"whole less {RESTING} [percentage points]")
    lines = []
    for number, run in enumerate(runs):
        numbers = cost(run)
        lines.append([run.level, f"{numbers['particle spacing [mm]']:g} mm",
                      *(f"{numbers[name]:,.0f}" if name in numbers else "" for name in (
                          "liquid particles", "time steps")),
                      *(duration(numbers[name]) if name in numbers else "" for name in (ALL_CORES, CLOCK)),
                      *(one.curve.text(one.ends[number]) for one in first)])
        if off is not None:
            lines[-1].append(f"{off.values[number] - off.at_rest:+.1f}")
    if any(one.at_rest is not None for one in first):
        lines.append([RESTING, *[""] * 5,
                      *("" if one.at_rest is None else one.curve.beside(one.at_rest, one.ends[-1]) for one in first),
                      *[""] * (off is not None)])
    return heads, lines


def price_chart(runs: Sequence[RunFolder], found: Sequence[Change]) -> list[Chart]:
    """Return the chart of how far the covered retina is from the resting shape against computing time; none without."""
    costs = [cost(run).get(ALL_CORES, 0.0) / 60.0 for run in runs]
    drawn = []
    for one in found:
        if one.at_rest is None or not one.drawn or min(costs) <= 0.0:
            continue
        order = np.argsort(costs)
        drawn.append(Series(one.curve.part, np.abs(np.array(one.values) - one.at_rest)[order],
                            [f"{runs[k].level}: {plain(abs(one.values[k] - one.at_rest), 1)}" for k in order]))
    if not drawn:
        return []
    return [Chart(f"distance of the covered retina from the {RESTING}", "percentage points",
                  "computing time, all cores [min]", np.sort(costs), drawn, logarithmic=True)]


def curves_of(runs: Sequence[RunFolder], found: Sequence[Change]) -> list[Chart]:
    """Return a chart for every metric that is drawn, with a curve for every level and a line for the resting shape."""
    times = np.unique(np.round(np.concatenate([run.table[TIME] for run in runs]), 9))
    starts = np.cumsum([0, *(len(run.table[TIME]) for run in runs)])
    drawn = []
    for one in (each for each in found if each.drawn):
        series = []
        for number, run in enumerate(runs):
            places = np.searchsorted(times, np.round(run.table[TIME], 9))
            values, half, texts = np.full(len(times), np.nan), np.full(len(times), np.nan), [""] * len(times)
            here = range(starts[number], starts[number + 1])
            values[places], half[places] = one.curve.values[here], np.nan_to_num(one.curve.uncertainty[here])
            for place, frame in zip(places, here, strict=True):
                texts[place] = one.curve.text(frame)
            series.append(Series(run.level, values, texts, half if (half > 0.0).any() else None))
        if one.at_rest is not None:
            rest = one.curve.beside(one.at_rest, one.ends[-1])
            series.append(Series(RESTING, np.full(len(times), one.at_rest), [rest] * len(times)))
        drawn.append(Chart(one.name, one.unit, "simulated time [s]", times, series, one.metric.metric.limits,
                           events=[(event.words, event.begin, event.end) for event in runs[0].events]))
    return drawn


def page_of(runs: Sequence[RunFolder], rows: Sequence[np.ndarray], found: Sequence[Change], folder: Path) -> str:
    """Return the page, with links to those of the runs, to be written into a folder."""
    heads, lines = rows_of(runs, found)
    levels, illustrated = in_a_row([run.level for run in runs]), illustration_in_words(runs[0].scene)
    _, paths = last_pictures(runs, runs[0].table["frame"][rows[0]])
    sources = [data_url(webp(scaled(read_picture(path), PICTURE_WIDTH)), "image/webp") for path in paths]
    pictures = [{"words": of_level(run), "source": source} for run, source in zip(runs, sources, strict=True)]
    resting, first = runs[-1].least_energy, len(lines) - len(found)
    # Others are noise about zero, of which a share says nothing.
    marked = [first + number for number, one in enumerate(found) if one.drawn and one.share >= MARKED]
    price_heads, price = price_table(runs, found)
    body = page.filled(
        __file__, short=in_short(runs, found), no_advice=NO_ADVICE if runs[0].scene.container is None else "",
        illustrated=illustrated, price=page.table(price_heads, price),
        price_chart=charts(price_chart(runs, found), "price"),
        resting=_resting_in_words(resting), pictures=pictures, curves=charts(curves_of(runs, found)),
        table=page.details(
            "All metrics", page.paragraph(
                "Values at the last time that all have, and the largest difference of any two at any time, also as a "
                f"share of the extent of the metric; of what is drawn, rows from {100 * MARKED:g} % on are marked."),
            page.table(heads, lines, words=[1], marked=marked)))
    return page.page(f"{runs[0].title}: {levels}", [chart_library(), body],
                     heading=f"{runs[0].title}: what accuracy costs",
                     links={os.path.relpath(run.folder / "index.html", folder): f"run at {run.level}" for run in runs
                            if (run.folder / "index.html").is_file()},
                     style=chart_style() + (HERE / "comparison_page.css").read_text(encoding="utf-8"), head=POLICY)


def _resting_in_words(resting: LeastEnergy | None) -> str:
    if resting is None:
        return ""
    return f"{resting.explained()} A run that is not at rest yet has another share."
