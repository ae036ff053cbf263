"""What the metrics stage makes of its table: plots and the summary page."""
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from pipeline.base import page
from pipeline.base.files import replacing_folder, write_text
from pipeline.base.tables import TIME
from pipeline.measures.rest import rest_in_words


def columns_by_metric(table: Iterable[str], metrics: Iterable) -> dict[str, dict[str, str]]:
    """Return the columns of every metric: name -> {column: what tells it from the metric's other columns}."""
    grouped: dict[str, dict[str, str]] = {metric.name: {} for metric in metrics}
    for column in table:
        name = column.partition(" [")[0]
        owners = [known for known in grouped if name == known or name.startswith(f"{known}_")]
        if owners:
            owner = max(owners, key=len)  # `time_step` is no part of `time`
            grouped[owner][column] = name.removeprefix(owner).lstrip("_")
    return grouped


def write_plots(folder: Path, table: Mapping[str, np.ndarray], metrics: Sequence, scene) -> None:
    """Draw every metric against time, one PNG each, into ``folder``, which appears by rename."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    grouped = columns_by_metric(table, metrics)
    with replacing_folder(folder) as partial:
        for metric in metrics:
            if metric.name == "time":
                continue
            figure = Figure(figsize=(8, 4.5), layout="constrained")
            axes = FigureCanvasAgg(figure).figure.subplots()
            for column, part in grouped[metric.name].items():
                marker = "." if len(table[TIME]) < 100 else ""
                axes.plot(table[TIME], table[column], marker=marker, label=part.replace("_", " "))
            unit = "" if metric.unit == "1" else f" [{metric.unit}]"
            axes.set(xlabel="simulated time [s]", ylabel=f"{metric.name.replace('_', ' ')}{unit}")
            title = f"{scene.title or scene.name} ({scene.accuracy}): {metric.name.replace('_', ' ')}"
            axes.set_title(title, loc="left", fontsize=12)
            axes.grid(alpha=0.3)
            axes.margins(x=0.02)
            axes.ticklabel_format(axis="y", useOffset=False)
            if len(grouped[metric.name]) > 1:
                figure.legend(loc="outside right upper", frameon=False)
            figure.savefig(partial / f"{metric.name}.png", dpi=120)


def write_summary(path: Path, table: Mapping[str, np.ndarray], metrics: Sequence, scene) -> None:
    """Write a page with one row per column: first, last, smallest and largest number, unit and meaning.

    Above it, whether the scene has come to rest.
    """
    meanings = {metric.name: metric.meaning for metric in metrics}
    units = {metric.name: "" if metric.unit == "1" else metric.unit for metric in metrics}
    rows = []
    for name, columns in columns_by_metric(table, metrics).items():
        for column, part in columns.items():
            numbers = table[column][np.isfinite(table[column])]
            shown = [numbers[0], numbers[-1], numbers.min(), numbers.max()] if len(numbers) else []
            cells = [f"{name} {part}".replace("_", " ").strip(), *(f"{number:.5g}" for number in shown),
                     *[""] * (4 - len(shown)), units[name], meanings[name]]
            rows.append(cells)
    heads = ("metric", "start", "end", "smallest", "largest", "unit", "meaning")
    text = page.page(f"{scene.title or scene.name}: metrics", [
        page.paragraph(scene.description),
        page.paragraph(f"{len(table['frame'])} frames, accuracy {scene.accuracy}, particle spacing "
                       f"{1e3 * scene.numerics.particle_spacing:g} mm."),
        page.paragraph(rest_in_words(table).capitalize()),
        page.table(heads, rows, words=[5, 6]),
    ], heading=scene.title or scene.name)
    write_text(path, text)
