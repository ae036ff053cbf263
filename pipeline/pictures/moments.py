"""Pictures of a run for slides and papers: an animation that loops, and moments side by side."""
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from PIL import Image

from pipeline.base.errors import UserError
from pipeline.base.files import replacing
from pipeline.pictures.pace import HOLD, Pace

ANIMATION_BYTES = 4 * 2**20  # slides that are sent around
ANIMATION_WIDTHS = (800, 640, 480, 320, 240, 160)
ANIMATION_PICTURES = 80
MOMENTS, COLUMNS, MOMENT_WIDTH, GAP = 8, 4, 640, 8  # of the sheet; pixels

Item = TypeVar("Item")


def read_picture(path: Path) -> Image.Image:
    """Read a picture in RGB.

    Raises
    ------
    UserError : it is none.
    """
    try:
        with Image.open(path) as image:
            return image.convert("RGB")
    except OSError as error:        # PIL.UnidentifiedImageError is one
        raise UserError(f"{path}: is no picture ({error}); run the render stage again") from error


def evenly_chosen(images: Sequence[Item], count: int) -> list[Item]:
    """Return at most so many pictures at equal times, the first and the last of them included."""
    return [images[index] for index in np.unique(np.rint(np.linspace(0, len(images) - 1, count)).astype(int))]


def scaled(picture: Image.Image, width: int) -> Image.Image:
    """Return a picture of a width in pixels at most."""
    if picture.width <= width:
        return picture
    return picture.resize((width, round(picture.height * width / picture.width)), Image.Resampling.LANCZOS)


def write_moments(images: Sequence[Path], output: Path) -> None:
    """Write moments at equal times on one sheet, in rows."""
    moments = [scaled(read_picture(path), MOMENT_WIDTH) for path in evenly_chosen(images, MOMENTS)]
    width, height = moments[0].width + GAP, moments[0].height + GAP
    columns = min(COLUMNS, len(moments))
    sheet = Image.new("RGB", (columns * width - GAP, -(-len(moments) // columns) * height - GAP), (255, 255, 255))
    for number, moment in enumerate(moments):
        sheet.paste(moment, (number % columns * width, number // columns * height))
    with replacing(output) as partial:
        sheet.save(partial, optimize=True)


def in_one_palette(pictures: Sequence[Image.Image]) -> list[Image.Image]:
    """Return pictures of one size in 256 colors found on some of them: a palette for each takes 30 times as long.

    An octree keeps the colors of small marks, which a median cut loses.
    """
    chosen = evenly_chosen(pictures, MOMENTS)
    sheet = Image.new("RGB", (chosen[0].width, len(chosen) * chosen[0].height))
    for row, picture in enumerate(chosen):
        sheet.paste(picture, (0, row * picture.height))
    palette = sheet.quantize(256, method=Image.Quantize.FASTOCTREE)
    return [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]


def write_animation(images: Sequence[Path], output: Path, pace: Pace,
                    mark: Callable[[Image.Image], object]) -> None:
    """Write a GIF or WebP that loops, as wide as `ANIMATION_BYTES` allow.

    Parameters
    ----------
    mark : draws on every picture.
    """
    step = -(-len(images) // ANIMATION_PICTURES)
    numbers = list(range(len(images) - 1, -1, -step))[::-1]  # the last one is there
    pictures = []
    for number in numbers:
        picture = read_picture(images[number])
        mark(picture)
        pictures.append(picture)
    shown = [round(1e3 * step / pace.rate)] * len(pictures)
    shown[-1] = max(shown[-1], round(1e3 * HOLD))
    with replacing(output) as partial:
        for width in ANIMATION_WIDTHS:
            small = [scaled(picture, width) for picture in pictures]
            options: dict[str, Any] = {"quality": 80, "method": 4}
            if output.suffix == ".gif":
                small, options = in_one_palette(small), {"optimize": False}
            small[0].save(partial, save_all=True, append_images=small[1:], duration=shown, loop=0, **options)
            if partial.stat().st_size <= ANIMATION_BYTES:
                break
