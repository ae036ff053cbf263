"""What oil at rest may touch: the hatched zone of a map holds all that is uncertain, and verdicts are what it shows."""
import dataclasses

import numpy as np
import pytest
import pyvista
from PIL import Image, ImageDraw

from pipeline.equilibrium.least import Resting
from pipeline.pictures.fundus_map import FundusMap
from pipeline.planning import report
from pipeline.planning.bracket import BORDERLINE, COVERED, NOT_COVERED, Bracket, bracket_of, verdict
from pipeline.planning.breaks import read_break
from pipeline.planning.plan import plan_fill
from pipeline.planning.search import FILL_ERROR
from pipeline.planning.settings import load_settings, postures
from pipeline.scenes.model import Eye

PLACE = read_break("6h,60deg", "2h")
LIGHT, HEAVY = "silicone_oil_1000", "heavy_oil_densiron_68"


@pytest.fixture(scope="module")
def resting():
    return Resting.of(Eye())


@pytest.fixture(scope="module")
def plan():
    return plan_fill("6h,60deg", "2h", margin="0 mm", oils=[LIGHT, HEAVY])


def bracket(resting, plan, oil, posture, fill):
    asked = plan.question
    return bracket_of(resting, asked.liquids(asked.oils[oil]), postures()[posture], fill, asked.other_angles,
                      FILL_ERROR)


def pixels_of_the_break(found):
    """Pixels of a map that lie in the break, (n, 3) each: with what is uncertain, and without."""
    wall = pyvista.PolyData(found.contact.cavity.wall)
    wall.point_data["contact_distance"] = found.contact.margin
    for name, value in (("oil_fraction_covered", 1.0), ("oil_fraction_bare", 0.0)):
        wall.point_data[name] = np.full(wall.n_points, value)
    chart = FundusMap(found.contact.cavity.wall, (800, 800), captions=False)
    mask = Image.new("1", chart.size)
    ImageDraw.Draw(mask).polygon([tuple(chart.place(one)) for one in PLACE.outline()], fill=1)
    return [np.asarray(chart.draw(wall, uncertain=one)).astype(int)[np.asarray(mask)]
            for one in ((found.low, found.high), 0.0)]


@pytest.mark.parametrize(("oil", "fill", "expected"), [
    (LIGHT, 0.931, BORDERLINE), (LIGHT, 0.98, COVERED), (LIGHT, 0.8, NOT_COVERED), (HEAVY, 0.5, COVERED)])
def test_a_break_is_borderline_exactly_when_the_hatched_zone_crosses_it(resting, plan, oil, fill, expected):
    found = bracket(resting, plan, oil, "upright", fill)
    margin, low, high = found.beyond(PLACE)
    assert low < margin < high and verdict(low, high) == expected
    hatched, plain = pixels_of_the_break(found)
    assert (np.abs(hatched - plain).max() > 30) == (expected == BORDERLINE)


@pytest.mark.thorough
@pytest.mark.parametrize("posture", ["upright", "prone"])
def test_a_map_is_borderline_within_the_range_of_the_fill_and_certain_beyond(resting, plan, posture):
    """The hatched zone holds all of the range beside the map: contact angles, shapes at rest, the error of tables."""
    answer = next(one for one in plan.answers if one.posture == posture and one.oils == (LIGHT,))
    inside = np.linspace(answer.low + FILL_ERROR, answer.high - FILL_ERROR, 3)
    for fill, expected in ((answer.low - 0.02, NOT_COVERED), *((fill, BORDERLINE) for fill in inside),
                           (answer.high + 0.01, COVERED)):
        assert answer.verdict(fill) == expected
        assert verdict(*bracket(resting, plan, LIGHT, posture, fill).beyond(PLACE)[1:]) == expected, fill


def test_shapes_with_other_contact_angles_lie_in_the_hatched_zone(resting, plan):
    liquids, down = plan.question.liquids(plan.question.oils[LIGHT]), postures()["upright"]
    found = bracket_of(resting, liquids, down, 0.85, load_settings()[0].other_angles)
    for angle in (*load_settings()[0].other_angles, np.radians(14.0)):
        other = resting.least(dataclasses.replace(liquids, contact_angle=angle), down, 0.85)
        margin = resting.contact(other, beyond=True).margin
        sure = (found.low > 0.2e-3) | (found.high < -0.2e-3)
        assert 0.5 < sure.mean() < 0.95
        assert ((margin > 0.0) == (found.low > 0.0))[sure].all()


def test_another_shape_at_rest_is_told_and_hatched(resting, plan):
    """Light oil of a supine patient may lean on the wall or hang on the lens."""
    found = bracket(resting, plan, LIGHT, "supine", 0.6)
    assert found.others and "the one with least energy is drawn" in found.other_words()
    whole = 100 * min(one["retina"] for one in found.others)
    assert f"{whole:.0f} " in found.other_words()
    alone = dataclasses.replace(found, others=())
    assert isinstance(alone, Bracket) and not alone.other_words()
    drawn = found.contact.margin > 0.5e-3
    assert (found.low[drawn] < 0.0).mean() > 0.3, "where one shape touches and another does not is uncertain"


def test_what_is_known_of_no_other_contact_angle_is_uncertain_by_the_error_of_shapes(plan):
    answer = dataclasses.replace(plan.answers[-1], fill=0.9, low=None, high=None)
    assert [answer.verdict(fill) for fill in (0.88, 0.895, 0.905, 0.92)] == [
        NOT_COVERED, BORDERLINE, BORDERLINE, COVERED]
    assert report.span_words(answer) == report.NOTHING
