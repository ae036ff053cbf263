"""Figures of Matplotlib with its own settings, whatever a user's matplotlibrc says: equal runs make equal plots."""
import functools
import logging
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from types import ModuleType

    from matplotlib.figure import Figure


@functools.cache
def library() -> "ModuleType":
    """Return Matplotlib with the settings it comes with."""
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # it complains about lines of matplotlibrc
    import matplotlib

    matplotlib.rcdefaults()
    return matplotlib


def empty_figure(size: tuple[float, float]) -> "Figure":
    """Return an empty figure of a size in inches, which is drawn into files only."""
    library()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    made = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(made)
    return made
