"""What is done to the eye of a scene, and when: told of what a scene inherits too."""
import shutil

import pytest
from conftest import ROOT

from pipeline import scene as stage
from pipeline.scenes.folders import scene_path
from pipeline.scenes.load import load_scene
from pipeline.scenes.timeline import MOST, in_words, inherited, timeline_in_words, timeline_of
from pipeline.scenes.yaml_files import scene_files

VOLUME = 5.054e-6  # m3


def loaded(name):
    return load_scene(scene_path(name), "draft")


@pytest.mark.parametrize(("name", "words"), [
    ("tamponade", "silicone oil 1000 flows in until 2.17 s; supine until 2.3 s; turn to upright 2.3 to 2.8 s; "
                  "upright from 2.8 s"),
    ("saccades", "upright throughout; saccades 0.05 to 0.87 s"),
    ("coupling_2d", ""),
])
def test_a_timeline_tells_postures_turns_injection_and_saccades(name, words):
    assert timeline_in_words(loaded(name), lambda scene: VOLUME) == words


def test_postures_of_a_time_lapse_tell_both_times_and_a_lapse_of_mixing_leaves_them_alone():
    words = timeline_in_words(loaded("day_of_postures"), lambda scene: VOLUME)
    assert words.startswith("supine, head up 30 deg until 8 s (8 h); turn to upright 8 to 8.03 s (8 h to 8.03 h)")
    words = timeline_in_words(loaded("emulsification"), lambda scene: VOLUME)
    assert words.startswith("upright until 0.5 s; turn to prone 0.5 to 1 s")


@pytest.fixture
def scenes(tmp_path):
    """Return `config/scenes` of a copy of the configuration."""
    return shutil.copytree(ROOT / "config", tmp_path / "config", ignore=shutil.ignore_patterns("*.npz")) / "scenes"


def test_a_check_tells_a_turn_that_is_inherited(scenes, capsys):
    (scenes / "mine.yaml").write_text("extends: tamponade\neffects:\n  injection: {fill: 90 %}\n")
    stage.main([str(scenes / "mine.yaml"), "--check"])
    assert "turn to upright 2.3 to 2.8 s; upright from 2.8 s" in capsys.readouterr().out


def test_what_another_file_says_is_told_with_that_file():
    files = scene_files(ROOT / "config" / "scenes" / "tests" / "tiny.yaml")
    assert inherited(files)["gravity"] == "from tamponade.yaml"
    chain = {"a.yaml": "effects: {injection: null, gravity: {posture: prone}, eye_rotation: {oscillation: {}}}",
             "b.yaml": "effects: {injection: {fill: 1}, gravity: {turns: []}}", "c.yaml": "title: none"}
    assert inherited(chain) == {"gravity": "turns from b.yaml"}
    assert inherited({"a.yaml": "effects: {injection: {fill: 1}}", "b.yaml": "effects: {injection: {flow: 1, drain: 2, "
                      "cannula: 3}}"}) == {"injection": "in part from b.yaml"}


def test_a_scene_that_ended_early_is_told_to_its_end():
    scene = loaded("tamponade")
    spans = timeline_of(scene, {"aqueous": 1.0}, VOLUME, end=2.5)
    assert in_words(spans, 2.5).endswith("supine until 2.3 s; turn to upright from 2.3 s")


def test_many_postures_are_told_together(scenes):
    turns = ", ".join(f"{{start: {0.1 * k + 0.05:g} s, to: {('upright', 'prone')[k % 2]}, duration: 0.02 s}}"
                      for k in range(MOST))
    (scenes / "restless.yaml").write_text(f"extends: still_eye\neffects: {{gravity: {{turns: [{turns}]}}}}\n")
    words = timeline_in_words(load_scene(scenes / "restless.yaml", "draft"), lambda scene: VOLUME)
    assert "postures and movements: upright first" in words and words.count(";") == 0
