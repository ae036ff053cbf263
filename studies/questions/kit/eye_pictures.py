"""Pictures of eyes on the pages of surgeons: sections, and maps of the fundus side by side.

Cases of studies draw them; they are apart from the pages, so that a better page runs no case again.
"""
import io
import itertools
from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw

from pipeline.cavity.rays import interpolation
from pipeline.equilibrium.rest import Rest
from pipeline.pictures.marks import FAINT_INK, INK, OVERSAMPLING, reduce, write
from pipeline.pictures.paint import OF_OIL, css
from studies.questions.kit.words import posture_words

MAPS_HEAD, MAPS_SIDE, MAPS_FOOT = 54, 118, 66   # pixels of a picture of maps: above, at the left, and below
SIZE, GAP, SIDE, HEAD = 168, 6, 150, 34     # pixels: of a picture, between them, of the names, of the heads
RAYS = 360                                  # of a section
SECTION_REACH = 17e-3                       # m, half the width of a section: of the longest eye


def fundus_picture(maps: Sequence[Sequence[Image.Image]], postures: Sequence[str], fills: Sequence[float],
                   tamponade: str) -> Image.Image:
    """Return maps of a right eye, a row for every posture and a column for every fill, as one picture."""
    width, height = maps[0][0].size
    size = (MAPS_SIDE + len(fills) * (width + GAP), MAPS_HEAD + len(postures) * (height + GAP) + MAPS_FOOT)
    image = Image.new("RGB", size, "white")
    pen = ImageDraw.Draw(image)
    for column, fill in enumerate(fills):
        middle = MAPS_SIDE + column * (width + GAP) + width / 2
        write(pen, (middle, MAPS_HEAD / 2), f"{100 * fill:g} %", 18, bold=True, color=INK, anchor="mm")
    write(pen, (4, MAPS_HEAD / 2), "fill", 16, color=FAINT_INK, anchor="lm")
    for row, (posture, line) in enumerate(zip(postures, maps, strict=True)):
        top = MAPS_HEAD + row * (height + GAP)
        write(pen, (4, top + height / 2), posture_words(posture), 16, bold=True, color=INK, anchor="lm",
              width=MAPS_SIDE - 8)
        for column, one in enumerate(line):
            left = MAPS_SIDE + column * (width + GAP)
            image.paste(one, (left, top))
            if row == 0:
                for side, letter, anchor in ((6, "T", "lt"), (width - 6, "N", "rt")):
                    write(pen, (left + side, top + 2), letter, 15, bold=True, color=INK, anchor=anchor)
    _legend_of_maps(image, tamponade, size[1] - MAPS_FOOT + 6)
    return image


def _legend_of_maps(image: Image.Image, tamponade: str, top: int) -> None:
    """Write below maps of the fundus what colors, lines and letters mean."""
    pen, left, middle = ImageDraw.Draw(image), float(MAPS_SIDE), top + 12
    for colors, words in (((OF_OIL.covered,), f"touched by {tamponade}"), ((OF_OIL.bare,), "not touched: aqueous"),
                          ((OF_OIL.covered, OF_OIL.bare), "depends on the contact angle")):
        box = (round(left), top, round(left) + 34, top + 24)
        pen.rectangle(box, fill=css(colors[-1]), outline=FAINT_INK)
        for stripe in range(0, 34, 6) if len(colors) > 1 else ():
            pen.rectangle((box[0] + stripe, top + 1, box[0] + stripe + 2, top + 23), fill=css(colors[0]))
        left += 44 + 32 + write(pen, (left + 44, middle), words, 16, color=INK, anchor="lm")
    write(pen, (left, middle), "pale rim: before the ora serrata, no retina", 16, color=INK, anchor="lm",
          width=image.width - left)
    write(pen, (MAPS_SIDE, middle + 32), "T temporal, N nasal: a right eye as the examiner sees it who faces the "
          "patient. Circles: macula (beside it the optic disc), equator, ora serrata.", 16, color=INK, anchor="lm",
          width=image.width - MAPS_SIDE)


def as_png_file(image: Image.Image) -> bytes:
    """Return a picture as PNG."""
    buffer = io.BytesIO()
    image.save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def section_of_eye(rest: Rest) -> Image.Image:
    """Return the section of an eye and its oil in the plane x = 0 of the viewpoint, front on the left."""
    angle = 2.0 * np.pi * np.arange(RAYS) / RAYS
    ray = np.stack([np.zeros(RAYS), np.sin(angle), np.cos(angle)], axis=-1)
    cavity = rest.cavity
    corners, weights = interpolation(cavity.wall - cavity.viewpoint, cavity.faces, ray)
    side = OVERSAMPLING * SIZE
    image = Image.new("RGB", (side, side), "white")
    pen = ImageDraw.Draw(image)
    wall = (cavity.radius[corners] * weights).sum(axis=1)
    scale = 0.5 * side / SECTION_REACH
    for distance, color, width in ((wall, tuple(OF_OIL.bare), 0), ((rest.distance[corners] * weights).sum(axis=1),
                                                            tuple(OF_OIL.covered), 0), (wall, None, 2 * OVERSAMPLING)):
        point = cavity.viewpoint + distance[:, None] * ray
        pixels = [(0.5 * side - scale * z, 0.5 * side - scale * y) for _, y, z in point]
        if color is None:
            pen.line([*pixels, pixels[0]], fill=INK, width=width)
        else:
            pen.polygon(pixels, fill=color)
    return reduce(image)


def row_of_pictures(pictures: Sequence[Image.Image]) -> Image.Image:
    """Return pictures side by side."""
    image = Image.new("RGB", (len(pictures) * (SIZE + GAP) - GAP, SIZE), "white")
    for column, one in enumerate(pictures):
        image.paste(one, (column * (SIZE + GAP), 0))
    return image


def all_eyes(names: Sequence[str], rows: Sequence[Image.Image], postures: Sequence[str]) -> Image.Image:
    """Return the rows of all eyes below each other, in two columns, as one picture."""
    width, lines = SIDE + rows[0].width + 3 * GAP, -(-len(rows) // 2)
    image = Image.new("RGB", (2 * width, HEAD + lines * (SIZE + GAP)), "white")
    pen = ImageDraw.Draw(image)
    for column, line in itertools.product(range(2), range(lines)):
        left, index = column * width, column * lines + line
        if line == 0:
            for place, head in enumerate(("from the side", *map(posture_words, postures))):
                middle = left + SIDE + place * (SIZE + GAP) + SIZE / 2
                write(pen, (middle, HEAD / 2), head, 16, color=FAINT_INK, anchor="mm")
        if index < len(rows):
            top = HEAD + line * (SIZE + GAP)
            words = names[index].split(", ")
            for number, word in enumerate(words):
                height = top + SIZE / 2 + 20 * (number - 0.5 * (len(words) - 1))
                write(pen, (left + 4, height), word, 16, bold=number == 0, color=INK, anchor="lm", width=SIDE - 8)
            image.paste(rows[index], (left + SIDE, top))
    return image
