"""Where the parts of a picture of an eye are: the section, the opened eye, the map of the fundus, and the legend."""
import numpy as np
from PIL import Image

HEADER, CAPTIONS, FOOTER = 0.12, 0.065, 0.105       # of the height
COLUMNS, COLUMNS_WITHOUT_VIEW = (0.37, 0.25, 0.38), (0.5, 0.5)     # of the width


def rows_of(height: int) -> tuple[int, int]:
    """Return where the panels begin and end, in pixels from the top.

    >>> rows_of(1000)
    (185, 895)
    """
    return round((HEADER + CAPTIONS) * height), round((1.0 - FOOTER) * height)


def columns_of(width: int, *, opened: bool = True) -> list[int]:
    """Return where each panel begins, and where the last one ends; ``opened``: the opened eye is one of them.

    >>> columns_of(1000)
    [0, 370, 620, 1000]
    """
    return [round(width * share) for share in np.cumsum([0.0, *(COLUMNS if opened else COLUMNS_WITHOUT_VIEW)])]


def legend_of(picture: Image.Image, height: int) -> Image.Image:
    """Return the legend below the panels of a picture, of a height in pixels."""
    legend = picture.crop((0, rows_of(picture.height)[1], *picture.size))
    return legend.resize((round(legend.width * height / legend.height), height), Image.Resampling.LANCZOS)


def section_and_map(picture: Image.Image, width: int) -> list[Image.Image]:
    """Return the section and the map of the fundus out of a picture, each of a width in pixels, without its texts."""
    columns, (top, bottom) = columns_of(picture.width), rows_of(picture.height)
    panels = [picture.crop((columns[first], top, columns[first + 1], bottom)) for first in (0, 2)]
    height = round(width * (bottom - top) / max(panel.width for panel in panels))
    made = []
    for panel in panels:
        canvas = Image.new("RGB", (width, height), "white")
        panel = panel.resize((round(panel.width * height / panel.height), height), Image.Resampling.LANCZOS)
        canvas.paste(panel, ((width - panel.width) // 2, 0))
        made.append(canvas)
    return made
