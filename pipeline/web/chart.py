"""Curves with values on hover, and bars over time: what pages draw beside pictures.

Curves are drawn by uPlot, which the page holds; bars are HTML.
"""
import dataclasses
from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from pipeline.base.page import rendered
from pipeline.web.scripts import HERE, called, library

SMALLEST_SPAN = 0.02  # of an axis, over the largest number: what is less looks as small as it is


@dataclasses.dataclass(frozen=True)
class Series:
    """One curve.

    Attributes
    ----------
    label : what tells it from the others; empty where it is the only one.
    values : (n,), NaN where there is none.
    texts : (n,), what is read off.
    half : (n,), half the width of a band around it; None without one.
    """

    label: str
    values: np.ndarray
    texts: Sequence[str]
    half: np.ndarray | None = None


@dataclasses.dataclass(frozen=True)
class Chart:
    """Curves over one axis.

    Attributes
    ----------
    label, unit : of the values; an empty unit for numbers.
    along : label of the axis below. x : (n,), ascending.
    limits : ends of the values; without them the axis follows the numbers.
    logarithmic : whether the axis below is.
    events : words, begin and end along x, marked behind the curves.
    """

    label: str
    unit: str
    along: str
    x: np.ndarray
    series: Sequence[Series]
    limits: tuple[float, float] | None = None
    logarithmic: bool = False
    events: Sequence[tuple[str, float, float]] = ()

    def record(self) -> dict[str, object]:
        """Return it as plain data for the script."""
        return {"label": self.label, "unit": self.unit, "time": self.along, "x": _numbers(self.x),
                "limits": self.limits, "span": SMALLEST_SPAN, "logarithmic": self.logarithmic,
                "events": [list(one) for one in self.events],
                "series": [{"label": one.label, "values": _numbers(one.values), "texts": list(one.texts),
                            "half": None if one.half is None else _numbers(one.half)} for one in self.series]}


def _numbers(values: np.ndarray) -> list[float | None]:
    return [float(f"{value:.6g}") if np.isfinite(value) else None for value in values]


def charts(drawn: Sequence[Chart], root: str = "curves") -> Markup:
    """Return charts side by side; nothing without any.

    Parameters
    ----------
    root : class of the element that holds them, of which a page has one.
    """
    if not drawn:
        return Markup()
    figures = rendered(HERE / "charts.html", charts=drawn, root=root)
    return figures + called("chart.js", "showCharts", f".charts.{root}", [one.record() for one in drawn])


def chart_library() -> Markup:
    """Return what charts of a page need, once for all of them."""
    return library("uplot.min.js", style="uplot.min.css")


def chart_style() -> str:
    """Return the style of charts and bars."""
    return (HERE / "chart.css").read_text(encoding="utf-8")


@dataclasses.dataclass(frozen=True)
class Bar:
    """A line of bars: words, when in words, a remark, and pieces (begin, end, class) between 0 and 1."""

    words: str
    when: str
    pieces: Sequence[tuple[float, float, str]]
    remark: str = ""


def bars(lines: Sequence[Bar], ends: tuple[str, str]) -> Markup:
    """Return lines of bars over one axis with words at both its ends; nothing without any."""
    return rendered(HERE / "bars.html", lines=lines, ends=ends) if lines else Markup()
