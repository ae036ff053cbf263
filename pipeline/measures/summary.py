"""The page of the metrics in short."""
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from pipeline.base import page
from pipeline.base.files import write_text
from pipeline.measures.rest import rest_in_words
from pipeline.measures.shown import Shown
from pipeline.scenes.model import Scene


def write_summary(path: Path, shown: Sequence[Shown], table: Mapping[str, np.ndarray], scene: Scene,
                  sheet: bytes) -> None:
    """Write a page with one row per column that changes, and a table of those that do not.

    Parameters
    ----------
    shown : metrics in the order of interest.
    sheet : the plots that matter most, as PNG.
    """
    rows, still = [], []
    for one in shown:
        meaning = one.metric.meaning
        for curve in one.curves:
            name = f"{one.name} {curve.part}".strip()
            if one.constant:
                still.append([name, curve.texts()[-1] or "not measured", one.unit, meaning])
            else:
                rows.append([name, *curve.texts(), one.unit, meaning])
            meaning = ""
    title = scene.title or scene.name
    write_text(path, page.page(f"{title}: metrics", [
        page.paragraph(scene.description),
        page.paragraph(f"{len(table['frame'])} frames, accuracy {scene.accuracy}, particle spacing "
                       f"{1e3 * scene.numerics.particle_spacing:g} mm."),
        page.paragraph(rest_in_words(table).capitalize()),
        page.picture(sheet, f"{title}: the metrics that matter most over time"),
        page.paragraph("What changes, the most interesting first. ± is half of what is within one particle spacing of "
                       "the contact line, as are the bands in the plots."),
        page.table(("metric", "start", "end", "smallest", "largest", "unit", "meaning"), rows, words=[5, 6]),
        *([page.section("Constant"),
           page.paragraph("Within the digits shown these do not change, and have no plot."),
           page.table(("metric", "value", "unit", "meaning"), still, words=[2, 3])] if still else []),
    ], heading=title))
