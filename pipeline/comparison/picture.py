"""The picture of a comparison: the last picture that all levels have, above their curves over time."""
import math
from collections.abc import Sequence

import numpy as np

from pipeline.base.canvas import empty_figure
from pipeline.base.palette import curve_style
from pipeline.base.tables import TIME
from pipeline.comparison.levels import Change, last_pictures, of_level
from pipeline.measures.least_energy import RESTING
from pipeline.pictures.picture_grid import as_png
from pipeline.runs.run_folder import RunFolder

ACROSS = 3          # curves in a row
WIDTH = 16.0        # inches


def picture_of(runs: Sequence[RunFolder], rows: Sequence[np.ndarray], found: Sequence[Change]) -> bytes:
    """Return the pictures of all levels above the curves of all `HEADLINES`, as PNG."""
    from matplotlib.image import imread

    frame, paths = last_pictures(runs, runs[0].table["frame"][rows[0]])
    pictures = [imread(path) for path in paths]
    high = WIDTH / len(runs) * max(picture.shape[0] / picture.shape[1] for picture in pictures) + 0.5
    drawn = [one for one in found if one.drawn]
    lines = math.ceil(len(drawn) / ACROSS)
    canvas = empty_figure((WIDTH, high + 2.6 * lines))
    top, *below = canvas.subfigures(1 + bool(lines), 1, squeeze=False,
                                    height_ratios=[high, 2.6 * lines][:1 + bool(lines)])[:, 0]
    time = runs[0].table[TIME][np.flatnonzero(runs[0].table["frame"] == frame)[0]]
    for number, (axes, each, picture) in enumerate(zip(top.subplots(1, len(runs)), runs, pictures, strict=True)):
        axes.imshow(picture)
        axes.axis("off")
        axes.set_title(f"{of_level(each)}, {time:g} s", color=curve_style(number)["color"], fontsize=13,
                       fontweight="bold")
    panels = list(below[0].subplots(lines, ACROSS, squeeze=False).flat) if below else []
    starts = np.cumsum([0, *(len(run.table[TIME]) for run in runs)])
    for axes, one in zip(panels, drawn, strict=False):
        for number, each in enumerate(runs):
            axes.plot(each.table[TIME], one.curve.values[starts[number]:starts[number + 1]], lw=1.6, label=each.level,
                      **curve_style(number))
        if one.at_rest is not None:
            axes.axhline(one.at_rest, color="black", lw=1.0, ls=":", label=RESTING)
        axes.set_title(f"{one.name}{one.unit and f' [{one.unit}]'}", loc="left", fontsize=10)
        axes.grid(alpha=0.3)
        axes.margins(x=0.02)
        axes.tick_params(labelsize=8)
    for axes in panels[len(drawn):]:
        axes.axis("off")
    if below:
        panels[0].legend(frameon=False, fontsize=9)
        below[0].supxlabel("simulated time [s]", fontsize=9)
    return as_png(canvas, dpi=110)
