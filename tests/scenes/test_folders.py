"""Scenes lie in folders, and are called by their names."""
import shutil

import pytest
from conftest import ROOT

from pipeline import scene as stage
from pipeline.base.errors import UserError
from pipeline.scenes.folders import scene_file, scene_path, scene_paths
from pipeline.scenes.listing import entries_of, markdown_of, text_of
from pipeline.scenes.load import load_scene
from pipeline.scenes.materials import load_materials
from pipeline.scenes.yaml_files import scene_files

SCENES = ROOT / "config" / "scenes"


@pytest.fixture
def scenes(tmp_path):
    """Return `config/scenes` of a copy of the configuration."""
    return shutil.copytree(ROOT / "config", tmp_path / "config") / "scenes"


def test_names_find_scenes_in_any_folder_and_in_none(scenes, monkeypatch):
    (scenes / "mine.yaml").write_text("extends: tamponade\n")
    (scenes / "wards").mkdir()
    (scenes / "wards" / "hers.yaml").write_text("extends: mine\nstart_from: mine\n")
    monkeypatch.chdir(scenes.parents[1])
    for given in ("hers", "config/scenes/hers.yaml", "config/scenes/wards/hers.yaml", scenes / "hers.yaml"):
        scene = load_scene(scene_file(given), "draft")
        assert (scene.name, scene.start_from, scene.title) == ("hers", "mine", "Silicone oil tamponade")
    assert list(scene_files(scene_path("hers"))) == ["hers.yaml", "mine.yaml", "tamponade.yaml"]
    assert {"hers", "mine", "tiny", "pbf_dam"} <= scene_paths().keys()
    monkeypatch.chdir(scenes / "clinic")
    assert load_scene("saccades.yaml", "draft").start_from == "tamponade"
    assert load_scene("hers", "draft").name == "hers"


def test_two_scenes_of_one_name_are_refused(scenes):
    (scenes / "tiny.yaml").write_text("extends: tamponade\n")
    for ask in (lambda: scene_paths(scenes), lambda: scene_path("tiny", scenes)):
        with pytest.raises(UserError, match=r"^\S*tests/tiny\.yaml and \S*scenes/tiny\.yaml: have the same name, by "
                                            "which alone scenes are called; rename or remove one of them$"):
            ask()


def test_an_unknown_name_is_answered_by_the_nearest_and_the_list(scenes):
    with pytest.raises(UserError, match=r"tamponad\.yaml: no such file \(did you mean tamponade\?\); `python -m "
                                        r"pipeline\.scene --scenes` lists all$"):
        load_scene(scenes / "tamponad.yaml")


@pytest.mark.parametrize("text", ["extends: []", "extends: {tamponade: 1}", "extends: tamponade\nstart_from: [tiny]"])
def test_a_list_is_no_name_of_a_scene(scenes, text):
    (scenes / "mine.yaml").write_text(text + "\n")
    with pytest.raises(UserError, match=r"(extends|start_from) is a (list|mapping), but must be "):
        load_scene(scenes / "mine.yaml", "draft")


def test_folders_beside_a_scene_elsewhere_are_none_of_its_business(tmp_path):
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "base.yaml").write_text("title: x\n")
    (tmp_path / "case.yaml").write_text("extends: base\n")
    with pytest.raises(UserError, match=r'extends is "base", but must be the name of a scene'):
        load_scene(tmp_path / "case.yaml", "draft", ROOT / "config")


def test_a_file_is_looked_for_where_it_was_named(scenes):
    (scenes / "clinic" / "head.csv").write_text("time [s],pitch [deg],roll [deg]\n0,0,0\n1,30,0\n")
    (scenes / "clinic" / "nods.yaml").write_text(
        "extends: tamponade\neffects: {gravity: {posture: null, turns: null, orientation: head.csv}}\n")
    (scenes / "mine.yaml").write_text("extends: nods\ntitle: Mine\n")
    assert load_scene(scenes / "mine.yaml", "draft").effects["gravity"].orientation[-1][0] == 1.0


# What a scene shows

@pytest.mark.parametrize(("text", "told"), [
    ("title: Mine\n", "up to 85 % of the cavity; then the patient sits up."),
    ("liquids: [aqueous, silicone_oil_5000]\neffects:\n  injection: {liquid: silicone_oil_5000, fill: 95 %}\n"
     "  gravity: {turns: [{start: 2.5 s, to: left_side, duration: 0.5 s}, {start: 4 s, to: prone, duration: 0.5 s}]}\n",
     "Aqueous in an eye. Silicone oil 5000 flows in until it holds 95 %. Supine until 2.5 s, on the left side from 3 "
     "to 4 s, prone from 4.5 s. Effects: injection, gravity, interface tension, wall film, viscosity implicit."),
    ("effects: {injection: {fill: 90 %}}\ndescription: Mine.\n", "Mine."),
    ("start_from: tamponade\neffects: {injection: null, gravity: {posture: prone, turns: null}}\n",
     "Goes on from the end of tamponade. Prone throughout. Effects: gravity,"),
])
def test_a_changed_story_is_told_from_the_scene_and_not_inherited(scenes, text, told):
    (scenes / "mine.yaml").write_text(f"extends: tamponade\n{text}")
    assert told in load_scene(scenes / "mine.yaml", "draft").description


def test_the_log_tells_the_postures(tmp_path, capsys):
    stage.main(["tamponade", "--accuracy", "draft", "--output", str(tmp_path / "scene.json")])
    assert capsys.readouterr().out == "tamponade: supine until 2.3 s, upright from 2.8 s\n"


# The list

def test_the_list_has_a_line_for_every_scene(scenes):
    (scenes / "mine.yaml").write_text("extends: tamponade\n")
    (scenes / "wrong.yaml").write_text("title: x\n")
    lines = text_of(entries_of(scene_paths(scenes), scenes)).splitlines()
    assert [line.split()[0] for line in lines if line.startswith("  ")] == [
        *sorted(("mine", "wrong")), *sorted(path.stem for path in scenes.glob("clinic/*.yaml")),
        *(path.stem for folder in ("papers", "studies", "tests") for path in sorted(scenes.glob(f"{folder}/*.yaml")))]
    found = {line.split()[0]: line for line in lines if line.startswith("  ")}
    assert found["tamponade"].split(maxsplit=4)[1:] == ["3D", "10", "s", "Silicone oil tamponade"]
    assert "wrong.yaml: " in found["wrong"]
    assert max(len(line) for line in lines if line != found["wrong"]) <= 120


def test_the_page_of_scenes_is_not_older_than_they_and_their_liquids_are():
    paths = {name: path for name, path in scene_paths(SCENES).items() if path.parent != SCENES}
    liquids = load_materials(ROOT / "config" / "materials.yaml")
    assert (ROOT / "docs" / "scenes.md").read_text() == markdown_of(entries_of(paths, SCENES), liquids), \
        "python -m pipeline.scene --scenes --output docs/scenes.md"
