"""Curves of a run over time for its page, with what happens when behind them."""
import io
from collections.abc import Iterator, Sequence

import numpy as np

from pipeline.base.canvas import empty_figure, library
from pipeline.measures.events import Event
from pipeline.measures.metric import LAST
from pipeline.measures.plots import draw, drawn_metrics
from pipeline.measures.shown import Shown

MOST = 6
SIZE = (4.8, 3.0)  # inches: letters can be read on a phone


def curves(shown: Sequence[Shown], time: np.ndarray, events: Sequence[Event]) -> Iterator[tuple[str, bytes]]:
    """Yield name and SVG of the metrics that people ask for first and that change.

    Parameters
    ----------
    time : (frames,), s.
    """
    asked_for = [one for one in drawn_metrics(shown) if one.metric.place < LAST]
    for one in asked_for[:MOST]:
        with library().rc_context({"svg.hashsalt": one.name, "font.size": 9}):
            canvas = empty_figure(SIZE)
            axes = canvas.subplots()
            draw(axes, one, time, events)
            axes.set_xlabel("simulated time [s]")
            axes.set_title(one.label, loc="left", fontsize=10)
            if len(one.curves) > 1 and not one.metric.yes_or_no:
                canvas.legend(loc="outside lower left", ncols=3, frameon=False, fontsize=8)
            file = io.BytesIO()
            canvas.savefig(file, format="svg", metadata={"Date": None})
        yield one.name, file.getvalue()
