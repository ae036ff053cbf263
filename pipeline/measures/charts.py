"""What a run has measured over time, for pages: curves with values on hover, and bars of what is yes or no."""
from collections.abc import Sequence

import numpy as np

from pipeline.measures.events import Event
from pipeline.measures.metric import LAST
from pipeline.measures.plots import drawn_metrics
from pipeline.measures.shown import Shown
from pipeline.web.chart import Bar, Chart, Series

MOST = 6
ALONG = "simulated time [s]"
KINDS = {1.0: "", 0.5: "uncertain"}  # of bars; what is bare has none


def curves(shown: Sequence[Shown], time: np.ndarray, events: Sequence[Event]) -> list[Chart]:
    """Return charts of the metrics that people ask for first and that change.

    Parameters
    ----------
    time : (frames,), s.
    """
    return [chart_of(one, time, events) for one in _asked_for(shown) if not one.metric.yes_or_no]


def chart_of(one: Shown, time: np.ndarray, events: Sequence[Event]) -> Chart:
    """Return the chart of a metric."""
    series = [Series(curve.part, curve.values, [curve.text(frame) for frame in range(len(time))],
                     np.where(np.isfinite(curve.uncertainty), curve.uncertainty, 0.0)
                     if (curve.uncertainty > 0.0).any() else None) for curve in one.curves if curve.known.any()]
    return Chart(one.name, one.unit, ALONG, time, series, one.metric.limits,
                 events=[(event.words, event.begin, event.end) for event in events])


def bars_of_metrics(shown: Sequence[Shown], time: np.ndarray) -> list[Bar]:
    """Return a line for every curve that is yes, no or uncertain; between frames it changes halfway."""
    length = float(time[-1] - time[0]) or 1.0
    edges = (np.concatenate([time[:1], 0.5 * (time[1:] + time[:-1]), time[-1:]]) - time[0]) / length
    lines = []
    for one in _asked_for(shown):
        for curve in one.curves if one.metric.yes_or_no else ():
            values = np.nan_to_num(curve.values, nan=0.5)
            starts = np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)
            pieces = [(float(edges[start]), float(edges[end]), KINDS[float(values[start])])
                      for start, end in zip(starts, [*starts[1:], len(values)], strict=True)
                      if float(values[start]) in KINDS]
            lines.append(Bar(f"{one.name} {curve.part}".strip(), "", pieces))
    return lines


def _asked_for(shown: Sequence[Shown]) -> list[Shown]:
    return [one for one in drawn_metrics(shown) if one.metric.place < LAST][:MOST]
