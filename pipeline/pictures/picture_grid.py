"""Pictures in rows and columns, for the pages of studies."""
import io

import numpy as np


def panels(rows: int, columns: int, size: tuple[float, float], margin: tuple[float, float] = (0.0, 0.0)):
    """Return a canvas and its axes, (rows, columns); panels of a size and the margin around all of them in inches."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    canvas = Figure(figsize=(size[0] * columns + margin[0], size[1] * rows + margin[1]), layout="constrained")
    return canvas, FigureCanvasAgg(canvas).figure.subplots(rows, columns, squeeze=False)


def evenly(count: int, frames: int) -> np.ndarray:
    """Indices of at most `count` frames at equal times after the first one, the last of them included."""
    return np.unique(np.rint(np.linspace(0, frames - 1, count + 1)[1:]).astype(int))


def as_png(canvas, dpi: int) -> bytes:
    """Return a canvas as PNG."""
    buffer = io.BytesIO()
    canvas.savefig(buffer, dpi=dpi, format="png")
    return buffer.getvalue()
