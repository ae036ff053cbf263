"""The page of the metrics in short."""
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from markupsafe import Markup

from pipeline.base import page
from pipeline.base.files import write_text
from pipeline.base.tables import TIME
from pipeline.measures.charts import curves
from pipeline.measures.events import Event
from pipeline.measures.place_course import EXPLAINED, HEADS, IN_A_LAPSE, Course
from pipeline.measures.shown import Curve, Shown
from pipeline.scenes.effects import illustration_in_words
from pipeline.scenes.model import Scene
from pipeline.web.chart import chart_library, chart_style, charts
from pipeline.web.scripts import POLICY


def write_summary(path: Path, shown: Sequence[Shown], table: Mapping[str, np.ndarray], scene: Scene,
                  events: Sequence[Event] = (), courses: Sequence[Course] = (), rest: str = "") -> None:
    """Write a page with one row per column that changes, and a table of those that do not.

    Parameters
    ----------
    shown : metrics in the order of interest.
    events : what happens in the scene.
    courses : of the breaks of the scene.
    rest : whether it is at rest at its end, in words.
    """
    title, illustrated = scene.title or scene.name, illustration_in_words(scene)
    body = page.filled(
        __file__, scene=scene, illustrated=illustrated, frames=len(table["frame"]),
        spacing=f"{1e3 * scene.numerics.particle_spacing:g}", rest=f"{rest[:1].upper()}{rest[1:]}",
        breaks=breaks_over_time(courses), curves=charts(curves(shown, table[TIME], events)), changing=changing(shown),
        constant=constant(shown) if any(one.constant for one in shown) else "")
    write_text(path, page.page(f"{title}: metrics", [chart_library(), body], path=path,
                               style=chart_style(), head=POLICY))


def breaks_over_time(courses: Sequence[Course]) -> list[Markup]:
    """Return a table of when breaks were covered, and what its numbers are; nothing without any."""
    if not courses:
        return []
    lapse = any(course.second_means not in (None, 1.0) for course in courses)
    return [page.table(HEADS, [course.cells() for course in courses], words=(1,)),
            page.paragraph(EXPLAINED, IN_A_LAPSE if lapse else "")]


def changing(shown: Sequence[Shown]) -> Markup:
    """Return the table of the metrics that change, one row per column."""
    rows = [[name, *curve.texts(), unit, meaning] for name, curve, unit, meaning in _curves(shown, constant=False)]
    return page.table(("metric", "start", "end", "smallest", "largest", "unit", "meaning"), rows, words=[5, 6])


def constant(shown: Sequence[Shown]) -> Markup:
    """Return the table of those that do not."""
    rows = [[name, curve.texts()[-1] or "not measured", unit, meaning]
            for name, curve, unit, meaning in _curves(shown, constant=True)]
    return page.table(("metric", "value", "unit", "meaning"), rows, words=[2, 3])


def _curves(shown: Sequence[Shown], constant: bool) -> Iterator[tuple[str, Curve, str, str]]:
    """Yield name, curve, unit and meaning, told once, of the metrics that are constant or of the others."""
    for one in shown:
        for number, curve in enumerate(one.curves if one.constant == constant else ()):
            yield f"{one.name} {curve.part}".strip(), curve, one.unit, "" if number else one.metric.meaning
