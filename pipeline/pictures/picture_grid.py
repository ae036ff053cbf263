"""Pictures in rows and columns, for the pages of studies."""
import io
from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw

from pipeline.base.canvas import empty_figure
from pipeline.pictures.marks import OVERSAMPLING, reduce, write

LETTERS = 13            # pixels, of titles and captions
GAP = 8                 # pixels between pictures


def panels(rows: int, columns: int, size: tuple[float, float]):
    """Return a canvas and its axes, (rows, columns); panels of a size in inches."""
    canvas = empty_figure((size[0] * columns, size[1] * rows))
    return canvas, canvas.subplots(rows, columns, squeeze=False)


def evenly(count: int, frames: int) -> np.ndarray:
    """Indices of at most `count` frames at equal times after the first one, the last of them included."""
    return np.unique(np.rint(np.linspace(0, frames - 1, count + 1)[1:]).astype(int))


def as_png(canvas, dpi: int) -> bytes:
    """Return a canvas as PNG."""
    buffer = io.BytesIO()
    canvas.savefig(buffer, dpi=dpi, format="png")
    return buffer.getvalue()


def sheet(rows: Sequence[tuple[str, Sequence[tuple[Image.Image, str]]]], across: int = 1,
          legends: Sequence[Image.Image] = ()) -> bytes:
    """Rows of pictures as PNG, each row with a title, each picture with a caption below.

    Parameters
    ----------
    rows : title, and pictures of the large canvas with their captions; all of one width.
    across : how many rows are side by side.
    legends : pictures below all of them, from the left edge on.
    """
    gap, line = GAP * OVERSAMPLING, 1.5 * LETTERS * OVERSAMPLING
    width = rows[0][1][0][0].width
    block = max(len(row) for _, row in rows) * (width + gap) + 2 * gap
    heights = [max(picture.height for _, row in rows[first:first + across] for picture, _ in row) + round(2.5 * line)
               for first in range(0, len(rows), across)]
    end = sum(heights)
    canvas = Image.new("RGB", (across * block, end + sum(legend.height for legend in legends)), (255, 255, 255))
    draw = ImageDraw.Draw(canvas)
    for number, (title, row) in enumerate(rows):
        left, top = gap + number % across * block, sum(heights[:number // across])
        write(draw, (left, top + 0.2 * line), title, LETTERS * OVERSAMPLING, bold=True, width=block - 2 * gap)
        for place, (picture, caption) in enumerate(row):
            x = left + place * (width + gap)
            canvas.paste(picture, (x, round(top + 1.2 * line)))
            write(draw, (x + 0.5 * width, top + 1.4 * line + picture.height), caption, LETTERS * OVERSAMPLING,
                  anchor="ma", width=width)
    for legend in legends:
        canvas.paste(legend, (0, end))
        end += legend.height
    buffer = io.BytesIO()
    reduce(canvas).save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()
