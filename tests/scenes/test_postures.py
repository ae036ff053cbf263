"""Postures of real life: angles, turns in bed, sequences of a day, and the orientation of a head from a CSV file."""
import itertools
import json
import math

import numpy as np
import pytest
from conftest import ROOT

from pipeline.advice.report import report_of
from pipeline.base.errors import UserError
from pipeline.scenes.folders import scene_path
from pipeline.scenes.load import load_resolved, load_scene
from pipeline.scenes.value_files import head_orientation
from sim.effects.gravity import Gravity, GravityParameters, Turn
from sim.effects.parts.postures import POSTURES, direction_of, words_of


def deg(*angles):
    return np.radians(angles)


@pytest.mark.parametrize(("posture", "head_up", "roll", "same"), [
    ("supine", 90.0, 0.0, "upright"), ("prone", 90.0, 0.0, "upright"), ("supine", 0.0, 90.0, "left_side"),
    ("supine", 0.0, -90.0, "right_side"), ("supine", 0.0, 180.0, "prone"), ("left_side", 0.0, 90.0, "prone")])
def test_angles_lead_from_one_posture_to_another(posture, head_up, roll, same):
    np.testing.assert_allclose(direction_of(posture, *deg(head_up, roll)), POSTURES[same], atol=1e-12)


def test_a_raised_head_is_between_lying_and_sitting():
    down = direction_of("supine", *deg(30.0))
    np.testing.assert_allclose(down, [0.0, -0.5, -math.sqrt(0.75)], atol=1e-12)
    assert words_of(down) == "head up 30 deg, face up" and words_of(direction_of("prone")) == "prone"


def day():
    return GravityParameters(posture="supine", second_means=3600.0, turns=(
        Turn(2 * 3600.0, "supine", roll=-math.pi / 2, duration=360.0), Turn(6 * 3600.0, "upright", duration=360.0),
        Turn(8 * 3600.0, "supine", head_up=math.radians(30.0), duration=360.0)))


def test_a_day_is_hurried_and_turns_smoothly():
    course = day().course
    for time, expected in ((1.9, "supine"), (3.0, "right_side"), (7.0, "upright")):
        np.testing.assert_allclose(course.at(time), POSTURES[expected], atol=1e-12)
    np.testing.assert_allclose(course.at(2.05), direction_of("supine", roll=-math.pi / 4), atol=1e-12)
    assert np.dot(course.at(2.01), POSTURES["supine"]) > 0.999  # it begins at rest
    assert [(round(begin, 3), round(end, 3), words) for begin, end, _, words in course.held(10.0)] == [
        (0.0, 2.0, "supine"), (2.1, 6.0, "supine, turned 90 deg to the right"), (6.1, 8.0, "upright"),
        (8.1, 10.0, "supine, head up 30 deg")]
    assert [words for words, *_ in Gravity.events(day(), {}, 1.0)][-1] == "turn to supine, head up 30 deg"


def test_what_a_time_lapse_hurries_is_no_acceleration_of_a_head():
    class Scales:
        duration, length = 10.0, 0.011

    assert 0.0 < Gravity.omitted_acceleration(day(), Scales) < 1e-5


# Files

def written(folder, text):
    path = folder / "head.csv"
    path.write_text(text)
    return path


def test_angles_and_gravity_say_the_same(tmp_path):
    lines = [(0, 0, 0), (1, 90, 0), (2, 0, 90), (3, 0, 0), (4, -90, 0), (5, -45, 0)]
    angles = written(tmp_path, "time [min],pitch [deg],roll [deg],yaw [deg]\n" + "".join(
        f"{time},{pitch},{roll},17\n" for time, pitch, roll in lines))
    found = np.array(head_orientation(angles))
    assert found[:, 0].tolist() == [0.0, 60.0, 120.0, 180.0, 240.0, 300.0]
    expected = [POSTURES[name] for name in ("upright", "supine", "right_side", "upright", "prone")]
    np.testing.assert_allclose(found[:5, 1:], expected, atol=1e-12)
    gravity = written(tmp_path, "\ufefftime [s],gravity_x [m/s2],gravity_y [m/s2],gravity_z [m/s2]\n" + "".join(
        f"{row[0]},{9.81 * row[1]},{9.81 * row[2]},{9.81 * row[3]}\n" for row in found))
    np.testing.assert_allclose(head_orientation(gravity), found, atol=1e-9)


ANGLES = "time [s],pitch [deg],roll [deg]\n"


@pytest.mark.parametrize(("text", "sentence"), [
    ("", "it has no lines of numbers below a header of time [s], [min] or [h]"),
    ("time,pitch [deg],roll [deg]\n0,0,0\n", 'its column "time" has no unit, but must be time [s] or time [min]'),
    ("time [s],pitch [turns],roll [deg]\n0,0,0\n", "must be pitch [deg] or pitch [rad]"),
    ("time [s],pitch [deg],roll [deg],mood [1]\n0,0,0,1\n", 'it has the column "mood [1]" that is not known; allowed'),
    ("time [s],pitch [deg],pitch [deg]\n0,0,0\n", "twice"),
    ("time [s],pitch [deg]\n0,0\n", "its columns are time, pitch, but must be"),
    (ANGLES + "0,0,0\n1,,0\n", "its line 3 has a gap: pitch is empty"),
    (ANGLES + "0,0,0\n1,nan,0\n", 'its line 3 has a gap: pitch is "nan"'),
    (ANGLES + "0,0,0\n\n,,\n2,0,0\n1,0,0\n", "its line 6 is at 1 s"),
    (ANGLES + "0,0,0\n1,0\n", "its line 3 has 2 cells, but must have 3"),
    (ANGLES + "0,0,0\n2,0,0\n1,0,0\n", "its line 4 is at 1 s, but must be later than the line before, at 2 s"),
    (ANGLES + "5,0,0\n6,0,0\n", "its first line is at 5 s, but must be at 0"),
    (ANGLES + "0,90,0\n1,-90,0\n", "is turned by 180 deg from the line before, but at most 170 deg"),
    (ANGLES + "".join(f"{time},{pitch},0\n" for time, pitch in ((0, 0), (1, 0), (2, 0), (60, 90), (61, 90))),
     "it has a gap of 58 s before its line 5, in which the head turns by 90 deg, but at most 10 s"),
    ("time [s],gravity_x [1],gravity_y [1],gravity_z [1]\n0,0,-1,0\n1,0,-1,-1\n",
     "its line 3 has a gravity of 1.41 g, but its length must be 1 g (within 5 %)"),
])
def test_what_is_wrong_in_a_file_is_one_sentence(tmp_path, text, sentence):
    with pytest.raises(UserError) as raised:
        head_orientation(written(tmp_path, text))
    assert len(raised.value.messages) == 1 and sentence in raised.value.messages[0]


def test_a_hold_is_no_gap(tmp_path):
    head_orientation(written(tmp_path, ANGLES + "0,0,0\n1,0,0\n2,0,0\n600,0,0\n601,45,0\n"))


# Scenes

@pytest.fixture
def folder(tmp_path):
    scenes = tmp_path / "scenes"
    scenes.mkdir()
    for name in ("resting_eye", "still_eye", "tamponade"):
        (scenes / f"{name}.yaml").write_text(scene_path(name, ROOT / "config" / "scenes").read_text())
    return scenes


def load(folder, text):
    path = folder / "scene.yaml"
    path.write_text(f"extends: resting_eye\n{text}")
    return load_scene(path, "draft", ROOT / "config")


def test_a_scene_reads_the_file_and_keeps_its_lines(folder):
    written(folder, ANGLES + "0,0,0\n1,30,0\n2,60,0\n3,90,0\n10,90,0\n")
    scene = load(folder, "effects: {gravity: {orientation: head.csv}}")
    gravity = scene.effects["gravity"]
    np.testing.assert_allclose(gravity.course.at(1.5), direction_of("supine", *deg(45.0)), atol=1e-9)
    np.testing.assert_allclose(gravity.course.at(50.0), POSTURES["supine"], atol=1e-9)
    assert [words for words, *_ in Gravity.events(gravity, {}, 1.0)] == ["turn to supine"]
    assert [(begin, end, words) for begin, end, _, words in gravity.course.held(8.0)] == [(3.0, 8.0, "supine")]
    resolved = folder / "scene.json"
    resolved.write_text(scene.to_json())
    assert load_resolved(resolved).effects["gravity"] == gravity
    assert len(json.loads(scene.to_json())["effects"]["gravity"]["orientation"]) == 5


@pytest.mark.parametrize(("text", "sentence"), [
    ("effects: {gravity: {orientation: nowhere.csv}}", "orientation is \"nowhere.csv\", but there is no such file"),
    ("effects: {gravity: {orientation: ../../../head.csv}}", "lies outside of the project"),
    ("effects: {gravity: {orientation: [[0, 0, -1, 0], [1, 0, -2, 0]]}}", "of length 2, but it must be 1"),
    ("effects: {gravity: {orientation: [[0, 0, -1, 0], [0, 0, -1, 0]]}}", "must be later than the line before"),
    ("effects: {gravity: {orientation: [[0, 0, -1, 0]], turns: [{start: 1 s, to: prone}]}}", "together with turns"),
    ("effects: {gravity: {posture: prone, orientation: [[0, 0, -1, 0]]}}", "posture is prone, but orientation begins"),
    ("effects: {gravity: {head_up: 30 deg}}", "is upright, but head_up or roll is told"),
    ("effects: {gravity: {posture: sitting}}", "must be one of upright, supine, prone, left_side, right_side"),
    ("effects: {gravity: {turns: [{start: 1 s, to: supine, head_up: 100 deg}]}}",
     "head_up is \"100 deg\", but must be"),
    ("effects: {gravity: {second_means: 1 h}}", "output.second_means is 1 s; both must be the same"),
    ("effects: {gravity: {second_means: 1 h, jolts: [{start: 0 s, acceleration: [1, 0, 0]}]}}\n"
     "output: {second_means: 1 h}", "a jolt cannot be told in a time-lapse"),
    ("initial: {fill: {silicone_oil_1000: 120 %, aqueous: 15 %}}", "silicone_oil_1000 is \"120 %\", but must be"),
    ("breaks: [{name: tear, hour: 6, latitude: 110 deg, width: 1, height: 20 deg}]",
     "reaches from 100 to 120 deg from the posterior pole, but the retina ends at 115 deg (ora serrata)"),
    ("breaks: [{name: tear, hour: 6, latitude: 130 deg, width: 1}]", "latitude is \"130 deg\", but must be"),
    ("breaks: [{name: tear, hour: 13, latitude: 60 deg, width: 1}]", "hour is 13, but must be above 0 h and at"),
    ("breaks: [{name: tear, hour: 6, latitude: 60 deg}]", "has neither width nor diameter"),
    ("breaks: [{name: tear, hour: 6, latitude: 60 deg, width: 1, diameter: 1 mm}]", "has both width and diameter"),
    ("breaks: [{name: tear, hour: 6, latitude: 60 deg, height: 9 deg, diameter: 1 mm}]", "both diameter and height"),
    ("breaks: [{name: a, hour: 6, latitude: 60 deg, width: 1}, {name: a, hour: 3, latitude: 60 deg, width: 1}]",
     "as another one is named already"),
    ("breaks: [{name: lower tear, hour: 6, latitude: 60 deg, width: 1}]", "must be made of letters, digits and _"),
    ("regions: [{name: low, latitudes: [90 deg, 60 deg]}]", "the first must be the smaller one"),
    ("regions: [{name: low, part: inferior, hours: [4, 8]}]", "gives both hours and part"),
    ("regions: [{name: low, part: lower}]", "must be one of superior, nasal, inferior, temporal"),
])
def test_wrong_places_and_postures_are_one_sentence(folder, text, sentence):
    with pytest.raises(UserError) as raised:
        load(folder, text)
    assert len(raised.value.messages) == 1 and sentence in raised.value.messages[0]


def test_places_are_parts_of_an_eye_in_space(folder):
    for text in ("dimension: 2\neye: null\ncontainer: {size: [10 mm, 10 mm]}", ):
        with pytest.raises(UserError, match="are parts of the wall of an eye"):
            load(folder, f"{text}\nregions: [{{name: low}}]")


def test_the_day_of_the_scenes_turns_within_its_hours():
    scene = load_scene(ROOT / "config" / "scenes" / "day_of_postures.yaml", "draft")
    held = scene.effects["gravity"].course.held(scene.output.duration)
    assert [words for *_, words in held] == ["supine, head up 30 deg", "upright", "prone"]
    assert all(after[0] > before[1] for before, after in itertools.pairwise(held))
    assert held[-1][1] * scene.output.second_means == pytest.approx(24 * 3600.0)


@pytest.mark.parametrize(("hours", "expected"), [(8.0, "ends as a patient has it"), (1.0, "do not come to rest")])
def test_a_time_lapse_tells_whether_postures_come_to_rest(folder, hours, expected):
    turns = ", ".join(f"{{start: {count * hours} h, to: {to}, duration: 1 min}}"
                      for count, to in ((1, "upright"), (2, "prone")))
    scene = load(folder, f"effects: {{gravity: {{second_means: 1 h, posture: supine, turns: [{turns}]}}}}\n"
                         f"output: {{duration: {3 * hours} s, second_means: 1 h}}")
    sentences = [one.sentence for one in report_of(scene, 5.06e-6).advice if one.effect == "gravity"]
    assert any("a time-lapse" in one and expected in one for one in sentences)
