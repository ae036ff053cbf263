"""Section and map are found in the pictures of an eye, whatever their size."""
import numpy as np
import pytest
from PIL import Image, ImageDraw

from pipeline.pictures.eye_layout import columns_of, legend_of, rows_of, section_and_map


@pytest.mark.parametrize("size", [(1280, 720), (641, 400)])
def test_section_and_map_are_cut_out_without_the_texts_around(size):
    picture = Image.new("RGB", size, "red")
    columns, (top, bottom) = columns_of(size[0]), rows_of(size[1])
    draw = ImageDraw.Draw(picture)
    for column, color in ((0, "yellow"), (2, "blue")):
        draw.rectangle([columns[column], top, columns[column + 1] - 1, bottom - 1], fill=color)
    section, fundus = section_and_map(picture, 300)
    assert section.size == fundus.size and section.width == 300
    for panel, color in ((section, (255, 255, 0)), (fundus, (0, 0, 255))):
        pixels = np.asarray(panel)
        assert (pixels == color).all(axis=-1).mean() > 0.95
        assert not (pixels == (255, 0, 0)).all(axis=-1).any()
    legend = np.asarray(legend_of(picture, 60))
    assert len(legend) == 60 and (legend == (255, 0, 0)).all(axis=-1).mean() > 0.9
