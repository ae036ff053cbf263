"""Words on an illustration: names with lines to what they name, time, gravity, scale, and what is not shown."""
import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from PIL import Image, ImageDraw

from pipeline.illustration.view import View
from pipeline.pictures.marks import FAINT_INK, INK, OVERSAMPLING, WARNING_INK, arrow, font, reduce, write

LEFT, RIGHT = 0.2, 0.8          # of the width: where the names end and begin
HEAD = 0.44                     # of the width: where the title ends, before the optic nerve of a prone patient
LINE = 4.4                      # percent of the height, of a second line of the title
LOWEST, HIGHEST = 0.78, 0.13    # of the height, between which names stand
APART, PAIR = 0.062, 0.098      # of the height: from a name to the next, from one with a second line
NOTES = 0.72                    # of the width: what is below leaves the corners to the pace of a film
SCALE = 5.0                     # mm


@dataclasses.dataclass(frozen=True)
class Name:
    """A name of a place (3,) in mm, with a second line where there is more to say."""

    text: str
    place: np.ndarray
    more: str = ""


def lettered(picture: Image.Image, view: View, names: Sequence[Name], *, legend: Sequence[tuple], title: str,
             time: str, label: str, posture: str, notes: Sequence[str]) -> Image.Image:
    """An illustration with its words.

    Parameters
    ----------
    legend : pairs of a color and a name.
    posture : of the patient; empty without gravity.
    notes : sentences below the picture.
    """
    canvas = picture.resize((OVERSAMPLING * picture.width, OVERSAMPLING * picture.height), Image.Resampling.NEAREST)
    draw, size = ImageDraw.Draw(canvas), canvas.size
    u = size[1] / 100.0
    lines = in_two_lines(title, lambda text: font(int(3.4 * u), True).getlength(text) <= HEAD * size[0])
    for row, line in enumerate(lines):
        write(draw, (2.4 * u, (2.2 + LINE * row) * u), line, 3.4 * u, bold=True, width=HEAD * size[0])
    lower = LINE * (len(lines) - 1)
    write(draw, (2.4 * u, (7.0 + lower) * u), time, 2.6 * u, color=FAINT_INK)
    if label:
        write(draw, (size[0] - 2.4 * u, 2.2 * u), label, 2.6 * u, bold=True, color=WARNING_INK, anchor="ra",
              width=0.34 * size[0])
    for row, (color, text) in enumerate(legend):
        y = (14.0 + lower + 5.0 * row) * u
        draw.rectangle([2.4 * u, y - 1.3 * u, 6.0 * u, y + 1.3 * u], fill=color, outline=FAINT_INK)
        write(draw, (7.2 * u, y), text, 2.6 * u, anchor="lm")
    middle = view.pixel(view.middle, size)[0]
    sides: dict[bool, list] = {True: [], False: []}
    for name in names:
        place = view.pixel(name.place, size)
        sides[bool(place[0] < middle)].append((place, name))
    for left, column in sides.items():
        _column(draw, size, column, left, HIGHEST + 0.01 * lower if left else HIGHEST)
    _gravity(draw, view, posture, u, size)
    per_mm = float(np.linalg.norm(view.pixel(view.middle + view.axes[0], size) - view.pixel(view.middle, size)))
    end, base = size[0] - 4.0 * u, size[1] - 8.2 * u
    draw.rectangle([end - SCALE * per_mm, base, end, base + 0.5 * u], fill=INK)
    write(draw, (end - 0.5 * SCALE * per_mm, base - 0.8 * u), f"{SCALE:g} mm", 2.4 * u, anchor="md")
    below = in_lines(" ".join(notes), lambda text: font(int(2.0 * u)).getlength(text) <= NOTES * size[0])
    for row, line in enumerate(reversed(below)):
        write(draw, (0.5 * size[0], size[1] - (1.4 + 2.8 * row) * u), line, 2.0 * u, color=FAINT_INK, anchor="md")
    return reduce(canvas)


def in_two_lines(text: str, fits: Callable[[str], bool]) -> list[str]:
    """A text as it is where it fits, else parted at the space after which the longer line is shortest."""
    if fits(text) or " " not in text:
        return [text]
    words = text.split(" ")
    return min(([" ".join(words[:k]), " ".join(words[k:])] for k in range(1, len(words))),
               key=lambda lines: max(map(len, lines)))


def in_lines(text: str, fits: Callable[[str], bool]) -> list[str]:
    """A text parted at spaces, each line as long as fits."""
    lines: list[str] = []
    for word in text.split():
        if lines and fits(f"{lines[-1]} {word}"):
            lines[-1] += f" {word}"
        else:
            lines.append(word)
    return lines


def _column(draw: ImageDraw.ImageDraw, size: tuple[int, int], column: list, left: bool, highest: float) -> None:
    """Names on one side below a height, a share of the picture's.

    They stand in the order of what they name, so that no line crosses another.
    """
    u = size[1] / 100.0
    column = sorted(column, key=lambda entry: entry[0][1])
    heights = spread([entry[0][1] / size[1] for entry in column],
                     [PAIR if entry[1].more else APART for entry in column], highest)
    edge = (LEFT if left else RIGHT) * size[0]
    for (place, name), height in zip(column, heights, strict=True):
        y = height * size[1]
        start = (edge + (1.0 if left else -1.0) * u, y)
        for ink, thick in (((255, 255, 255), 0.62), (INK, 0.24)):
            draw.line([start, tuple(place)], fill=ink, width=max(1, round(thick * u)))
        x, y0 = place
        draw.ellipse([x - 0.75 * u, y0 - 0.75 * u, x + 0.75 * u, y0 + 0.75 * u], fill=(255, 255, 255))
        draw.ellipse([x - 0.5 * u, y0 - 0.5 * u, x + 0.5 * u, y0 + 0.5 * u], fill=INK)
        room = edge - 2.0 * u if left else size[0] - edge - 2.0 * u
        write(draw, (edge, y), name.text, 2.9 * u, bold=True, anchor="rm" if left else "lm", width=room)
        if name.more:
            write(draw, (edge, y + 3.2 * u), name.more, 2.1 * u, color=FAINT_INK, anchor="rm" if left else "lm",
                  width=room)


def spread(heights: Sequence[float], gaps: Sequence[float], highest: float = HIGHEST) -> list[float]:
    """Heights in rising order, moved apart by at least ``gaps`` (each to the next), as little as needed.

    All stay between ``highest`` and ``LOWEST`` as long as there is room.
    """
    placed = [max(highest, height) for height in heights]
    for k in range(1, len(placed)):
        placed[k] = max(placed[k], placed[k - 1] + gaps[k - 1])
    limit = LOWEST
    for k in range(len(placed) - 1, -1, -1):
        placed[k] = min(placed[k], limit)
        limit = placed[k] - (gaps[k - 1] if k else 0.0)
    return placed


def _gravity(draw: ImageDraw.ImageDraw, view: View, posture: str, u: float, size: tuple[int, int]) -> None:
    if not posture:
        write(draw, (4.0 * u, size[1] - 12.0 * u), "no gravity", 2.4 * u)
        return
    arrow(draw, (5.0 * u, size[1] - 17.0 * u), (5.0 * u, size[1] - 8.0 * u), 0.5 * u)
    write(draw, (7.2 * u, size[1] - 15.2 * u), "gravity", 2.4 * u, anchor="lm")
    write(draw, (7.2 * u, size[1] - 12.0 * u), posture, 2.4 * u, color=FAINT_INK, anchor="lm")
