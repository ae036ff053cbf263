"""The stage plan: fills that cover a break, what cannot be covered, and wrong input as one sentence."""
import dataclasses
import functools
import re

import numpy as np
import pytest
from conftest import ROOT
from helpers import forked

from pipeline.base.errors import UserError
from pipeline.cavity.rays import interpolation
from pipeline.equilibrium.least import Resting
from pipeline.equilibrium.star_cavity import FINE
from pipeline.planning import report, search
from pipeline.planning.breaks import Break, read_break
from pipeline.planning.confirm import confirming_scene
from pipeline.planning.search import MAP, Question, Tables, answers
from pipeline.planning.settings import load_settings, postures
from pipeline.planning.touch import FILLS, LATITUDES, MERIDIANS, fills_needed, key_of, read_tables, write_tables
from pipeline.scenes.folders import scene_path
from pipeline.scenes.load import load_scene
from pipeline.scenes.model import Buckle, Eye, Landmarks
from pipeline.scenes.retina import direction

plan = functools.partial(forked.run, "pipeline.plan")


def question(place: Break, *, margin: float = 0.0, oils=("silicone_oil_1000",), chosen=("upright",),
             largest: float = 0.95) -> Question:
    settings, materials = load_settings()
    return Question(place, margin, {name: materials[name] for name in oils}, materials[settings.other_liquid],
                    tuple(chosen), settings.tension, settings.contact_angle, settings.other_angles, largest)


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    return Tables(Eye(), tmp_path_factory.mktemp("plans"))


def fill_for(tables, place, **more) -> float:
    return answers(question(place, **more), tables, 11.3e-3)[0].fill


# Where a break is

def test_clock_hours_are_those_of_an_observer_who_faces_the_patient():
    hours = np.array([0.0, 90.0, 180.0, 270.0])
    np.testing.assert_allclose(direction(hours, np.full(4, 90.0)), [[0, 1, 0], [1, 0, 0], [0, -1, 0], [-1, 0, 0]],
                               atol=1e-12)
    np.testing.assert_allclose(direction(np.zeros(1), np.zeros(1)), [[0.0, 0.0, -1.0]])
    assert "(nasal)" in read_break("3h,60deg", "1h").words("right")
    assert "(temporal)" in read_break("3h,60deg", "1h").words("left")
    assert "inferior temporal" in read_break("7:30,60deg", "1h").words("right")


@pytest.mark.parametrize(("place", "size", "expected"), [
    ("6h,60deg", "2h", Break(180.0, 60.0, 60.0, 10.0, True)),
    ("12h, 90 deg", "1h,20deg", Break(0.0, 90.0, 30.0, 20.0)),
    ("10:30,90deg", "15deg", Break(315.0, 90.0, 15.0, 15.0)),
    ("1.5h,30deg", "15deg", Break(45.0, 30.0, 30.0, 15.0)),
])
def test_breaks_are_read_as_surgeons_write_them(place, size, expected):
    found = read_break(place, size)
    assert found.height_assumed == expected.height_assumed
    np.testing.assert_allclose([found.meridian, found.latitude, found.width, found.height],
                               [expected.meridian, expected.latitude, expected.width, expected.height])


def test_a_patch_covers_the_break_and_its_margin():
    meridian, latitude = Break(350.0, 60.0, 40.0, 10.0).points(3.0)
    wide = (meridian - 350.0 + 180.0) % 360.0 - 180.0
    assert latitude.min() == 52.0 and latitude.max() == 68.0
    assert wide.max() > 20.0 + 3.0 and wide.min() < -20.0 - 3.0
    whole, _ = Break(0.0, 0.0, 360.0, 10.0).points(1.0)
    assert np.ptp(whole) > 350.0


# What covers it

def test_a_break_above_needs_less_than_one_below_with_light_oil_and_more_with_heavy_oil(tables):
    above, below = read_break("12h,80deg", "1h"), read_break("6h,80deg", "1h")
    assert fill_for(tables, above) < 0.6 < 0.85 < fill_for(tables, below)
    heavy = {"oils": ("heavy_oil_densiron_68",)}
    assert fill_for(tables, below, **heavy) < 0.6 < 0.85 < fill_for(tables, above, **heavy)


def test_the_patient_who_lies_face_down_has_a_covered_macula(tables):
    macula = read_break("12h,0deg", "10deg")
    found = answers(question(macula, chosen=("supine", "prone")), tables, 11.3e-3)
    assert [answer.posture for answer in found] == ["prone", "supine"]
    assert found[0].covers(0.95) and not found[1].covers(0.95)


def test_sides_are_mirror_images(tables):
    left, right = read_break("4h,70deg", "1h"), read_break("8h,70deg", "1h")
    assert fill_for(tables, left, chosen=("left_side",)) == pytest.approx(
        fill_for(tables, right, chosen=("right_side",)), abs=2e-3)
    assert fill_for(tables, left, chosen=("right_side",)) < fill_for(tables, left, chosen=("left_side",))


def test_a_larger_break_and_a_margin_need_more(tables):
    fills = [fill_for(tables, read_break("6h,60deg", "1h")), fill_for(tables, read_break("6h,60deg", "3h,20deg")),
             fill_for(tables, read_break("6h,60deg", "3h,20deg"), margin=1e-3)]
    assert fills[0] < fills[1] < fills[2]


def test_the_range_holds_the_answer_and_is_known_for_the_default_eye(tables):
    found = answers(question(read_break("6h,60deg", "2h"), oils=load_settings()[0].oils, chosen=postures()), tables,
                    11.3e-3)
    assert len(found) == 10
    assert all(answer.low <= answer.fill <= answer.high for answer in found)


@pytest.mark.thorough
@pytest.mark.parametrize("posture", ["upright", "left_side"])
def test_the_fill_of_the_map_just_covers_the_break(tables, posture):
    place = read_break("5h,70deg", "1h")
    asked = question(place, chosen=(posture,))
    fill = answers(asked, tables, 11.3e-3)[0].fill
    resting = Resting.of(Eye())
    contact = resting.contact(resting.least(asked.liquids(*asked.oils.values()), postures()[posture], fill, FINE))
    corners, weights = interpolation(contact.cavity.wall, contact.cavity.faces, direction(*place.points()))
    margin = (contact.margin[corners] * weights).sum(axis=1)
    assert abs(margin.min()) < 0.5e-3


@pytest.mark.thorough
def test_the_map_is_that_of_the_solver():
    asked = question(read_break("12h,0deg", "1h"))
    table = read_tables(MAP)[key_of(asked.liquids(*asked.oils.values()), "upright")]
    resting = Resting.of(Eye())
    cavity = resting.cavity(FINE)
    meridian, latitude = (grid.ravel() for grid in np.meshgrid(MERIDIANS, LATITUDES))
    corners, weights = interpolation(cavity.wall, cavity.faces, direction(meridian, latitude))
    for fill in (0.75, 0.85, 0.92):
        contact = resting.contact(resting.least(asked.liquids(*asked.oils.values()), postures()["upright"], fill, FINE))
        margin = (contact.margin[corners] * weights).sum(axis=1).reshape(table.needed.shape)
        clear = np.abs(table.needed - fill) > 0.01
        assert ((margin > 0.0) == (table.needed < fill))[clear].all()
        assert 100 * table.shares_at(fill)["retina"] == pytest.approx(
            100 * contact.share(_retina(cavity)), abs=0.5)


def _retina(cavity):
    from pipeline.equilibrium.contact import retina_masks

    return retina_masks(cavity)["retina"]


def test_the_fill_needed_is_the_last_that_leaves_a_point_bare():
    margin = np.full((len(FILLS), 4), -1.0)
    margin[3:, 0] = 1.0      # touched from the fourth fill on
    margin[:, 1] = 1.0       # always
    margin[5:8, 2] = 1.0     # touched in between only
    np.testing.assert_allclose(fills_needed(margin), [0.5 * (FILLS[2] + FILLS[3]), FILLS[0], 1.0, 1.0])


def test_the_side_of_an_eye_asks_for_tables_of_its_own_where_landmarks_turn_a_mesh(tmp_path):
    for landmarks, apart in ((None, False), (Landmarks(optic_disc=(5e-3, 3e-3, -10e-3)), True)):
        folders = {Tables(Eye(model="mesh", path="eye.stl", side=side, landmarks=landmarks), tmp_path)._folder
                   for side in ("right", "left")}
        assert (len(folders) == 2) == apart


def test_tables_come_back_from_their_files(tmp_path):
    written = dict(list(read_tables(MAP).items())[:2])
    write_tables(tmp_path, written)
    read = read_tables(tmp_path)
    assert read.keys() == written.keys()
    for key, table in written.items():
        for name in ("needed", "needed_by_both", "shares"):
            np.testing.assert_allclose(getattr(read[key], name), getattr(table, name))


# What is said

def test_a_plan_is_told_oil_by_oil_in_words(tables):
    """As a surgeon asks: light oil upright first, whatever needs least; the edge of the tables is a bound."""
    asked = question(read_break("6h,60deg", "2h"), margin=0.5e-3, oils=load_settings()[0].oils, chosen=postures())
    found = answers(asked, tables, 11.3e-3)
    least, light, heavy = report.verdicts(asked, found)
    assert least == ("Least of all: heavy oil (Densiron 68), patient upright: 50 % of the cavity is enough (less was "
                     "not looked at).")
    assert light == ("Light oil (silicone oil 1000, 1300, 2000 and 5000), patient upright: 93 % (92 to 96 %) of the "
                     "cavity, perhaps more than 95 %, the most that is assumed to get filled; least when prone, 67 % "
                     "(62 to 74 %) of the cavity; borderline with 95 % when supine.")
    assert heavy == ("Heavy oil (Densiron 68), patient upright: 50 % of the cavity is enough (less was not looked at); "
                     "borderline with 95 % when prone.")
    assert report.reading(asked, found).startswith("At exactly a smallest fill the edge of the oil lies 0.5 mm beyond")
    lines = report.rows(asked, found)
    assert [line[0].partition(" (")[0] for line in lines] == 5 * ["light oil"] + 5 * ["heavy oil"]
    assert lines[0][1:5] == ("prone", "covered", "67 %", "62 to 74 %")
    assert [line[2] for line in lines] == [*3 * ["covered"], *2 * ["borderline"], *4 * ["covered"], "borderline"]
    assert report.table(asked, found).count('class="marked"') == 3
    assert not any("_" in cell for line in lines for cell in line)
    shown = [answer.posture for same in report.by_oil(asked, found).values()
             for answer in report.shown_first(asked, same)]
    assert shown == ["upright", "prone", "upright"]


def test_a_plan_without_a_fill_that_surely_covers_says_whether_it_is_uncertain(tables):
    for place, posture, said in (
            (read_break("6h,60deg", "2h"), "supine", "It is uncertain whether the break can be covered: "),
            (read_break("6h,100deg", "3h"), "upright", "The break cannot be covered: ")):
        asked = question(place, margin=0.5e-3, chosen=(posture,))
        found = answers(asked, tables, 11.3e-3)
        sentence, = report.verdicts(asked, found)
        assert sentence.startswith(said) and not report.reading(asked, found)
    assert "2 clock hours wide" in read_break("6h,60deg", "2h").words("right")
    assert "1 clock hour wide" in read_break("6h,60deg", "1h").words("right")


def test_what_an_eye_without_tables_takes_is_said_before_it_begins(tmp_path, monkeypatch, capsys):
    made = []

    def touch_of(resting, liquids, down, advance):
        assert "90 shapes of oil at rest, about" in capsys.readouterr().err or made
        made.append(down)
        return next(iter(read_tables(MAP).values()))

    monkeypatch.setattr(search, "touch_of", touch_of)
    asked = question(read_break("6h,60deg", "2h"), chosen=("upright", "prone", "supine", "left_side"))
    tables = Tables(dataclasses.replace(Eye(), axial_length=25e-3), tmp_path)
    answers(asked, tables, 11.3e-3)
    assert len(made) == 6, "four postures, and the best of them with two other contact angles"
    answers(asked, tables, 11.3e-3)
    assert capsys.readouterr().err.count("shapes of oil at rest, about") == 0


def test_a_fill_between_those_of_the_tables_is_looked_at_in_an_eye_that_is_not_the_shipped_one(tmp_path, monkeypatch):
    """The edge of the oil may jump in a mesh, and a map must not show bare what the answer calls covered."""
    shipped = next(iter(read_tables(MAP).values()))
    monkeypatch.setattr(search, "touch_of", lambda *rest: shipped)
    asked, looked = question(read_break("6h,60deg", "2h")), []

    def covers(self, case, points, fill):
        looked.append(fill)
        return fill > 0.935

    monkeypatch.setattr(Tables, "covers", covers)
    case = asked.liquids(*asked.oils.values()), "upright"
    points = asked.place.points(0.0)
    first = shipped.fill_for(*points)
    found = Tables(dataclasses.replace(Eye(), axial_length=25e-3), tmp_path).fill_for(case, points)
    assert looked[0] == first < 0.935 < found < 0.935 + 0.5 * search.FILL_ERROR
    answer, = answers(asked, Tables(dataclasses.replace(Eye(), axial_length=25e-3), tmp_path), 11.3e-3)
    assert answer.fill == found and answer.low < answer.fill < answer.high
    count = len(looked)
    assert Tables(Eye(), tmp_path).fill_for(case, points) < 0.935 and len(looked) == count, "tables of a smooth eye"
    monkeypatch.setattr(Tables, "covers", lambda *rest: False)
    assert Tables(dataclasses.replace(Eye(), axial_length=25e-3), tmp_path).fill_for(case, points) == 1.0


# The stage

@pytest.mark.thorough
def test_the_stage_answers_in_words_and_as_a_page(project, tmp_path):
    done = plan("--break", "6h,60deg", "--size", "2h", "--oil", "silicone_oil_1000", "--postures", "upright,prone")
    assert done.returncode == 0, done.stderr
    assert re.search(r"Light oil \(silicone oil 1000\), patient upright: 93 % \(\d+ to \d+ %\) of the cavity, perhaps "
                     r"more than 95 %, the most that is assumed to get filled; least when prone, 67 % ", done.stdout)
    assert "not for decisions on a patient" in done.stdout
    done = plan("--break", "6h,60deg", "--postures", "upright", "--oil", "silicone_oil_1000", "--output",
                tmp_path / "plan.html", "--confirm", "config/scenes/confirming.yaml", folder=project.folder)
    assert done.returncode == 0, done.stderr
    assert load_scene(project.folder / "config" / "scenes" / "confirming.yaml").breaks[0].name == "planned"
    html = (tmp_path / "plan.html").read_text()
    assert "not for decisions on a patient" in html and html.count("data:image/webp") == 1
    assert "right eye, light oil, upright: " in html and "on the map: <b>borderline at " in html
    assert "not the inverted view of indirect ophthalmoscopy" in html
    places = [html.index(words) for words in ("patient upright: ", "<figure>", "<details", "<table>", "was assumed")]
    assert places == sorted(places), "the answer, the map, and all else on a click"


@pytest.mark.parametrize(("place", "meridian"), [("12:30,60deg", 15.0), ("0:30,60deg", 15.0), ("12:00,60deg", 0.0),
                                                 ("6:30, 60 deg", 195.0), ("12h,60deg", 0.0)])
def test_clock_hours_go_around_at_twelve(place, meridian):
    assert read_break(place, "1h").meridian == pytest.approx(meridian)
    with pytest.raises(UserError, match="must be above 0 and at most 12"):
        read_break("13:30,60deg", "1h")


@pytest.mark.thorough
def test_what_cannot_be_covered_is_said():
    done = plan("--break", "6h,100deg", "--size", "3h", "--oil", "silicone_oil_1000", "--postures", "upright")
    assert done.returncode == 0, done.stderr
    assert "The break cannot be covered" in done.stdout and "At exactly" not in done.stdout


def test_a_confirming_scene_is_a_scene(tables, tmp_path):
    asked = question(read_break("6h,60deg", "1h"), oils=("heavy_oil_densiron_68",), chosen=("prone",))
    answer = answers(asked, tables, 11.3e-3)[0]
    scenes = tmp_path / "scenes"
    scenes.mkdir()
    for name in ("resting_eye", "still_eye", "tamponade"):
        (scenes / f"{name}.yaml").write_text(scene_path(name, ROOT / "config" / "scenes").read_text())
    path, buckled = scenes / "confirming.yaml", Eye(lens="pseudophakic", buckle=Buckle(0.002, clock_hours=(10.0, 2.0)))
    path.write_text(confirming_scene(asked, answer, buckled, "resting_eye"))
    scene = load_scene(path, "draft", ROOT / "config")
    assert scene.eye == buckled and [liquid.name for liquid in scene.liquids][1] == "heavy_oil_densiron_68"
    assert scene.initial.fill["heavy_oil_densiron_68"] == pytest.approx(min(answer.fill, 0.95), abs=1e-4)
    assert scene.effects["gravity"].posture == "prone"
    assert scene.effects["interface_tension"].coefficient == asked.tension
    assert scene.effects["interface_tension"].contact_angle == pytest.approx(asked.contact_angle)


@pytest.mark.thorough
@pytest.mark.parametrize(("arguments", "sentence"), [
    (["--break", "6h,120deg"], "the retina reaches from 0 (posterior pole) to 115 deg"),
    (["--break", "6h,110deg", "--size", "1h,20deg"], "reaches from 100 to 120 deg"),
    (["--break", "13h,60deg"], "a clock hour must be above 0 and at most 12"),
    (["--break", "6h,60"], "without a unit"),
    (["--break", "below"], "must be a clock hour and an angle"),
    (["--break", "6h,60deg", "--size", "big"], "such as 60deg"),
    (["--break", "6h,60deg", "--postures", "sitting"], "known are upright, supine, prone, left_side, right_side"),
    (["--break", "6h,60deg", "--oil", "silicone_oil_100"], "(did you mean silicone_oil_1000?)"),
    (["--break", "6h,60deg", "--axial-length", "24"], 'error: axial_length is "24", but must be at least'),
    (["--break", "6h,60deg", "--largest-fill", "101 %"], 'error: largest_fill is "101 %", but must be'),
    (["--break", "6h,60deg", "--confirm", "my_plan.yaml"], "my_plan.yaml, but must be a file in"),
    (["--break", "6h,60deg", "--confirm", "config/scenes/my plan.yaml"], 'letters, digits, "_" and "-"'),
    (["--break", "6h,60deg", "--confirm", "config/scenes/tamponade.yaml"], "a scene that confirms no plan"),
    (["--break", "6h,60deg", "--mesh", "nowhere.stl"], "nowhere.stl"),
])
def test_wrong_input_is_one_sentence(arguments, sentence):
    done = plan(*arguments)
    assert done.returncode == 2 and done.stdout == ""
    assert len(done.stderr.splitlines()) == 1 and sentence in done.stderr
