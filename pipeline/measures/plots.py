"""Curves of metrics over time: one picture for each, and one sheet of those that matter most."""
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from pipeline.base.files import replacing_folder
from pipeline.base.palette import AQUEOUS, OIL, curve_style
from pipeline.base.tables import TIME
from pipeline.base.words import no_formula
from pipeline.measures.events import Event
from pipeline.measures.shown import Shown
from pipeline.pictures.picture_grid import as_png, panels

OVERVIEW = "overview"
ON_SHEET, ACROSS = 6, 3
SMALLEST_SPAN = 0.02  # of an axis, over the largest number: what is less looks as small as it is
DPI = 120
INK = "#5c6670"
# Color and hatch of yes, perhaps and no: those of the maps.
BARS = {1.0: (OIL, ""), 0.5: ("#ffffff", "//////"), 0.0: (AQUEOUS, "")}


def drawn_metrics(shown: Sequence[Shown]) -> list[Shown]:
    """Return the metrics that have a plot: those that change, without time and what is drawn as a band of others."""
    bands = {one.metric.uncertainty for one in shown}
    return [one for one in shown if not one.constant and one.metric.name not in bands | {"time"}]


def write_plots(folder: Path, shown: Sequence[Shown], table: Mapping[str, np.ndarray], events: Sequence[Event],
                title: str) -> None:
    """Write one PNG for every metric that changes, and the sheet, into ``folder``, which appears by rename."""
    with replacing_folder(folder) as partial:
        (partial / f"{OVERVIEW}.png").write_bytes(overview(shown, table, events, title))
        for one in drawn_metrics(shown):
            canvas, axes = panels(1, 1, (8.0, 4.5))
            draw(axes[0, 0], one, table[TIME], events)
            axes[0, 0].set_title(no_formula(f"{title}: {one.name}"), loc="left", fontsize=12, wrap=True)
            axes[0, 0].set(xlabel="simulated time [s]", ylabel="" if one.metric.yes_or_no else one.label)
            if len(one.curves) > 1 and not one.metric.yes_or_no:
                canvas.legend(loc="outside right upper", frameon=False)
            (partial / f"{one.metric.name}.png").write_bytes(as_png(canvas, DPI))


def overview(shown: Sequence[Shown], table: Mapping[str, np.ndarray], events: Sequence[Event], title: str) -> bytes:
    """Return the sheet of the most interesting metrics as PNG."""
    chosen = drawn_metrics(shown)[:ON_SHEET]
    canvas, axes = panels(max(-(-len(chosen) // ACROSS), 1), ACROSS, (5.2, 3.8))
    for place, one in zip(axes.flat, chosen, strict=False):
        draw(place, one, table[TIME], events)
        place.set_title(one.name if one.metric.yes_or_no else one.label, loc="left", fontsize=12)
        if len(one.curves) > 1 and not one.metric.yes_or_no:
            place.legend(fontsize=9, frameon=False, ncols=3 if len(one.curves) % 3 == 0 else 4, loc="upper left",
                         bbox_to_anchor=(-0.02, -0.06), handlelength=1.8, columnspacing=1.2)
    for place in axes.flat[len(chosen):]:
        place.axis("off")
    canvas.suptitle(no_formula(title), x=0.01, ha="left", fontsize=14, wrap=True)
    canvas.supxlabel("simulated time [s]", fontsize=10)
    return as_png(canvas, DPI)


def draw(axes, one: Shown, time: np.ndarray, events: Sequence[Event]) -> None:
    """Draw the curves of a metric with their bands of uncertainty, and the events, into axes of matplotlib."""
    if one.metric.yes_or_no:
        _draw_bars(axes, one, time)
        _mark(axes, events)
        return
    for number, curve in enumerate(one.curves):
        if not curve.known.any():
            continue
        style = curve_style(number)
        axes.plot(time, curve.values, lw=1.8, marker="." if len(time) < 100 else "", ms=4, label=curve.part, **style)
        if (curve.uncertainty > 0.0).any():
            band = np.clip([curve.values - curve.uncertainty, curve.values + curve.uncertainty], *(
                one.metric.limits or (-np.inf, np.inf)))
            axes.fill_between(time, *band, lw=0.0, color=style["color"], alpha=0.15)
    axes.grid(alpha=0.3)
    axes.margins(x=0.02)
    axes.ticklabel_format(axis="y", useOffset=False)
    _limit(axes, one)
    _mark(axes, events)


def _draw_bars(axes, one: Shown, time: np.ndarray) -> None:
    """Draw a bar over time for every curve: covered, bare, or hatched where that is uncertain."""
    from matplotlib.patches import Patch

    edges = np.concatenate([time[:1], 0.5 * (time[1:] + time[:-1]), time[-1:]])
    names = [curve.part or one.name for curve in one.curves]
    for row, curve in enumerate(one.curves):
        values = np.nan_to_num(curve.values, nan=0.5)
        starts = np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)
        for start, end in zip(starts, [*starts[1:], len(values)], strict=True):
            color, hatch = BARS[float(values[start])]
            axes.barh(row, edges[end] - edges[start], left=edges[start], height=0.6, color=color, hatch=hatch, lw=0.5,
                      edgecolor=INK)
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.margins(x=0.02)
    axes.legend([Patch(facecolor=color, hatch=hatch, edgecolor=INK, lw=0.5) for color, hatch in BARS.values()],
                ["covered", "uncertain", "bare"], ncols=3, fontsize=9, frameon=False, loc="upper left",
                bbox_to_anchor=(-0.02, -0.06), handlelength=1.8, columnspacing=1.2)


def _mark(axes, events: Sequence[Event]) -> None:
    from matplotlib.patheffects import withStroke

    for event in events:
        axes.axvline(event.begin, color=INK, lw=0.8)
        lasts = event.end > event.begin
        if lasts:
            axes.axvspan(event.begin, event.end, color=INK, alpha=0.1, lw=0.0)
        words = axes.annotate(event.words, (event.begin, 0.98), xycoords=("data", "axes fraction"), rotation=90,
                              xytext=(2 if lasts else -2, 0), textcoords="offset points",
                              ha="left" if lasts else "right", va="top", fontsize=9, color=INK)
        words.set_path_effects([withStroke(linewidth=2.0, foreground="white")])


def _limit(axes, one: Shown) -> None:
    """Set the ends of the vertical axis: whole where the metric has ends, else never so near that noise fills it."""
    from matplotlib.ticker import MaxNLocator, MultipleLocator

    if one.metric.limits:
        low, high = one.metric.limits
        room = 0.03 * (high - low)
        axes.set_ylim(low - room, high + room)
        if one.unit == "deg":
            axes.yaxis.set_major_locator(MultipleLocator(60))
        return
    if all(curve.whole for curve in one.curves):
        axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    low, high = axes.get_ylim()
    span = SMALLEST_SPAN * max(abs(low), abs(high))
    if high - low < span:
        middle = 0.5 * (low + high)
        axes.set_ylim(middle - 0.5 * span, middle + 0.5 * span)
