"""Marks on pictures: text, arrows, bars, lines. Lengths in pixels of the large canvas, which is halved at the end."""
import functools
import math
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from skimage.measure import approximate_polygon, find_contours

OVERSAMPLING = 2                # marks are drawn twice as large and averaged, so that they are smooth
STRAIGHT = 0.1                  # nodes; a line of a level this near to a straight one is drawn as one
LONG_UNITS = (("week", 604800.0), ("day", 86400.0), ("hour", 3600.0), ("minute", 60.0))
SMALLEST_LETTERS = 6           # pixels
INK = (25, 30, 40)
FAINT_INK = (95, 102, 115)
WARNING_INK = (176, 52, 24)


@functools.cache
def font(size: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """DejaVu Sans of a height in pixels, from matplotlib's own files: the same on every machine."""
    import matplotlib

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name), size)


def write(draw: ImageDraw.ImageDraw, position, text: str, size: float, *, bold=False, color=INK, anchor="la",
          width: float | None = None, outline: bool = False) -> float:
    """Write one line, ``outline``d in white over colors; returns its width.

    One wider than ``width`` is set smaller, and cut where that is not enough.
    """
    size = max(int(size), SMALLEST_LETTERS)
    while width is not None and size > SMALLEST_LETTERS and font(size, bold).getlength(text) > width:
        size -= 1
    if width is not None and font(size, bold).getlength(text) > width:
        fits = next(end for end in range(len(text) - 1, -1, -1) if font(size, bold).getlength(f"{text[:end]}…") <= width
                    or not end)
        text = f"{text[:fits]}…"
    draw.text(tuple(position), text, font=font(size, bold), fill=color, anchor=anchor,
              stroke_width=round(0.12 * size) if outline else 0, stroke_fill="white")
    return font(size, bold).getlength(text)


def pretty(name: str) -> str:
    """Name of a liquid or a scheme for readers: silicone_oil_1000 -> silicone oil 1000."""
    return name.replace("_", " ")


def clock(time: float, second_means: float | None = None) -> str:
    """Simulated time (s) in words; in a time-lapse, where a second means that many, the time that it stands for."""
    if second_means is None:
        return f"t = {time:.2f} s"
    meant = time * second_means
    unit, seconds = next(((unit, seconds) for unit, seconds in LONG_UNITS if second_means >= seconds), ("s", 1.0))
    return f"{unit} {meant / seconds:.1f}" if unit != "s" else f"t = {meant:.2f} s"


def header(draw: ImageDraw.ImageDraw, size: tuple[int, int], *, title: str, time: str, subtitle: str,
           label: str) -> None:
    """Write the lines above a picture: title and the clock, below them a subtitle and the scene's label."""
    width, u = size[0], size[1] / 100.0
    write(draw, (2.0 * u, 1.6 * u), title, 4.2 * u, bold=True, width=0.6 * width)
    write(draw, (width - 2.0 * u, 1.6 * u), time, 4.2 * u, bold=True, anchor="ra")
    write(draw, (2.0 * u, 7.2 * u), subtitle, 3.0 * u, width=0.64 * width)
    if label:
        write(draw, (width - 2.0 * u, 7.2 * u), label, 3.0 * u, bold=True, color=WARNING_INK, anchor="ra",
              width=0.32 * width)


def arrow(draw: ImageDraw.ImageDraw, start, end, width: float, color=INK) -> None:
    """Straight arrow with a filled head."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    along = (end - start) / max(np.linalg.norm(end - start), 1e-9)
    across = np.array([-along[1], along[0]])
    neck = end - 4.0 * width * along
    draw.line([tuple(start), tuple(neck + along)], fill=color, width=round(width))
    draw.polygon([tuple(end), tuple(neck + 2.0 * width * across), tuple(neck - 2.0 * width * across)], fill=color)


def diamond(draw: ImageDraw.ImageDraw, center, half: float, color) -> None:
    """A diamond of half a width."""
    x, y = center
    draw.polygon([(x, y - half), (x + half, y), (x, y + half), (x - half, y)], fill=color, outline=(255, 255, 255),
                 width=max(1, round(0.2 * half)))


def gravity_mark(draw: ImageDraw.ImageDraw, center, half: float, right: float, up: float, toward: float) -> str:
    """Gravity around a center, in units of its strength: an arrow in the plane, else a mark toward the reader or away.

    ``right``, ``up`` and ``toward`` are the components of a unit vector. Returned are words that say what the mark
    means; none are needed for an arrow.
    """
    center = np.asarray(center, float)
    if math.hypot(right, up) > 0.3:
        way = half * np.array([right, -up])
        arrow(draw, center - way, center + way, 0.22 * half)
        return ""
    away_mark(draw, center, 0.6 * half, 0.14 * half, toward=toward > 0)
    return "toward you" if toward > 0 else "away from you"


def away_mark(draw: ImageDraw.ImageDraw, center, radius: float, width: float, toward: bool, color=INK) -> None:
    """A circle with a dot (an arrow toward the reader) or a cross (away from the reader)."""
    x, y = center
    draw.ellipse([x - radius, y - radius, x + radius, y + radius], outline=color, width=round(width))
    if toward:
        draw.ellipse([x - width, y - width, x + width, y + width], fill=color)
    else:
        d = radius * math.sqrt(0.5)
        draw.line([x - d, y - d, x + d, y + d], fill=color, width=round(width))
        draw.line([x - d, y + d, x + d, y - d], fill=color, width=round(width))


def color_bar(draw: ImageDraw.ImageDraw, box, colors: np.ndarray, title: str, ends, size: float,
              ticks=("0.0", "0.2", "0.4", "0.6", "0.8", "1.0")) -> None:
    """Horizontal bar of the colors (256, 3) with ``ticks`` at equal distances; ``ends`` names its ends.

    ``box`` is (left, top, right, bottom).
    """
    left, top, right, bottom = (round(v) for v in box)
    for x in range(left, right):
        color = tuple(int(v) for v in colors[round((x - left) / max(right - left - 1, 1) * 255)])
        draw.line([x, top, x, bottom], fill=color)
    draw.rectangle([left, top, right, bottom], outline=INK, width=max(1, round(size / 12)))
    for k, tick in enumerate(ticks):
        x = left + (right - left) * k / (len(ticks) - 1)
        draw.line([x, bottom, x, bottom + size / 3], fill=INK, width=max(1, round(size / 12)))
        write(draw, (x, bottom + 0.4 * size), tick, 0.9 * size, anchor="ma")
    write(draw, ((left + right) / 2, top - 0.35 * size), title, size, anchor="md")
    write(draw, (left - 0.6 * size, (top + bottom) / 2), ends[0], size, anchor="rm")
    write(draw, (right + 0.6 * size, (top + bottom) / 2), ends[1], size, anchor="lm")


def level_lines(level: np.ndarray) -> list[np.ndarray]:
    """Lines (k, 2) where a level (n, m) is 0, rows and columns, without the points that a straight line needs not."""
    return [approximate_polygon(line, STRAIGHT) for line in find_contours(level, 0.0)]


def enlarged(pixels: np.ndarray, size: tuple[int, int]) -> Image.Image:
    """Pixels of the final size, (n, m, 3) or (n, m) uint8, on a large canvas of a width and a height.

    ``reduce`` gives them back.
    """
    height, width = pixels.shape[:2]
    image = Image.fromarray(pixels).resize((OVERSAMPLING * width, OVERSAMPLING * height), Image.Resampling.NEAREST)
    return image.crop((0, 0, *size))


def final_pixels(size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Places (m,) and (n,) of the columns and rows of final pixels on a large canvas of a width and a height."""
    columns, rows = (OVERSAMPLING * (np.arange(-(-length // OVERSAMPLING)) + 0.5) for length in size)
    return columns, rows


def reduce(image: Image.Image) -> Image.Image:
    """The large canvas averaged to its final size."""
    return image.reduce(OVERSAMPLING)
