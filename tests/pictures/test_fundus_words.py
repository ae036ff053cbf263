"""The words of a map that stands alone: large enough on a page, and off breaks and the edge of the oil."""
import numpy as np
import pytest
import pyvista
from PIL import ImageDraw

from pipeline.pictures.fundus_map import FundusMap
from pipeline.planning.chart import SIZE
from pipeline.scenes.retina import Patch

RADIUS = 11e-3
SHOWN = 380.0       # pixels, of a map on a page of 1400 with three side by side


@pytest.fixture
def written(monkeypatch):
    """Words that were drawn: text -> place and size in pixels."""
    found, plain = {}, ImageDraw.ImageDraw.text

    def text(pen, xy, text, *rest, font, **options):
        found[text] = np.array(xy), font.size, font.getlength(text)
        return plain(pen, xy, text, *rest, font=font, **options)

    monkeypatch.setattr(ImageDraw.ImageDraw, "text", text)
    return found


def drawn(level, alone, **outlines):
    """Draw a ball whose oil ends where a level of its directions is zero."""
    points = np.asarray(pyvista.Icosphere(radius=RADIUS, nsub=4).points)
    wall = pyvista.PolyData(points)
    wall.point_data["contact_distance"] = RADIUS * level(points / RADIUS)
    for name, value in (("oil_fraction_covered", 1.0), ("oil_fraction_bare", 0.0)):
        wall.point_data[name] = np.full(len(points), value)
    chart = FundusMap(points, (2 * SIZE[0], 2 * SIZE[1]), outlines=outlines, alone=alone)
    chart.draw(wall, uncertain=0.3e-3)
    return chart


def test_words_can_be_read_where_maps_stand_side_by_side(written):
    drawn(lambda place: place[:, 1], True)
    assert {"macula", "disc", "equator", "ora serrata", "superior", "temporal", "12"} <= written.keys()
    assert min(size for _, size, _ in written.values()) * 0.5 * SHOWN / SIZE[0] > 10.0


def test_the_name_of_the_macula_is_off_the_edge_of_the_oil_and_stays_in_a_movie(written):
    def level(place):
        return -np.sin(np.radians(20.0)) - place[:, 1]      # where the name stands else

    for alone in (False, True):
        chart = drawn(level, alone)
        place, size, _ = written["macula"]
        edge = chart.place(np.array([0.0, -np.sin(np.radians(20.0)), -np.cos(np.radians(20.0))]))
        assert (abs(place[1] - edge[1]) > size) == alone


def test_no_landmark_is_named_over_a_break(written):
    tear = Patch(165.0, 82.0, 30.0, 10.0)
    chart = drawn(lambda place: place[:, 1] + 0.9, True, lower_tear=tear.outline())
    inside = np.array([chart.place(point) for point in tear.outline()])
    for name in ("equator", "ora serrata", "lower tear"):
        place, size, length = written[name]
        assert not (np.abs(inside - place) < 0.5 * np.array([length, size])).all(axis=1).any(), name
