"""The pipeline from Python: changes of a scene become a file, errors are one exception, results are objects."""
import dataclasses
import os
import re
import shutil
import subprocess
import sys
import tomllib

import numpy as np
import pytest
from conftest import ROOT

import pipeline
from pipeline import plan as plan_stage
from pipeline.base.project import PROJECT
from pipeline.library.changes import changed_scene
from pipeline.library.metrics_table import MetricsTable
from pipeline.measures.metric import Metric
from pipeline.scenes.load import load_scene
from pipeline.workflow.command import project_folder


@pytest.fixture
def scenes(tmp_path):
    """Return the folder of the scenes of a new project folder."""
    return project_folder(tmp_path / "lecture") / "config" / "scenes"


def changed(scenes, name=None, **changes):
    """Return the scene that changes of `tiny` give, read from its file."""
    made = changed_scene(scenes, "tiny", changes, "draft", name)
    return load_scene(scenes / f"{made}.yaml", "draft")


# Folders

def test_folder_without_scenes_gets_them_once_and_keeps_its_own(tmp_path, capsys):
    folder = project_folder(tmp_path / "lecture")
    assert "copied here" in capsys.readouterr().err
    scene = folder / "config" / "scenes" / "tests" / "tiny.yaml"
    assert scene.read_bytes() == (PROJECT / "config" / "scenes" / "tests" / "tiny.yaml").read_bytes()
    scene.write_text("title: my own\n")
    assert project_folder(folder) == folder and scene.read_text() == "title: my own\n"
    assert not capsys.readouterr().err


def test_project_is_found_from_a_folder_within(scenes, monkeypatch):
    within = scenes.parents[1] / "docs"
    within.mkdir()
    monkeypatch.chdir(within)
    assert project_folder() == scenes.parents[1]


@pytest.mark.thorough
def test_what_was_changed_in_a_folder_counts_there(scenes):
    plan = scenes.parent / "plan.yaml"
    plan.write_text(plan.read_text().replace("largest_fill: 95 %", "largest_fill: 91 %"))
    code = "from pipeline.planning.settings import load_settings; print(load_settings()[0].largest_fill)"
    done = subprocess.run([sys.executable, "-c", code], cwd=scenes, env=os.environ | {"PYTHONPATH": str(ROOT)},
                          capture_output=True, text=True)
    assert done.stdout == "0.91\n", done.stderr


def test_config_of_something_else_is_left_alone(tmp_path):
    (tmp_path / "config").mkdir()
    with pytest.raises(pipeline.UserError, match="holds no scenes of this project"):
        project_folder(tmp_path)
    assert not list((tmp_path / "config").iterdir())


# Changes

def test_dotted_and_nested_changes_are_the_same_scene(scenes):
    dotted = changed(scenes, **{"effects.injection.fill": 0.9, "output.duration": "0.1 s"})
    nested = changed(scenes, output={"duration": "0.1 s"}, effects={"injection": {"fill": np.float64(0.9)}})
    assert dotted.effects["injection"].fill == 0.9 and dotted.output.duration == 0.1
    assert dataclasses.replace(nested, name=dotted.name) == dotted
    again = changed(scenes, **{"effects.injection.fill": 0.9, "output.duration": "0.1 s"})
    assert again == dotted and again.name.startswith("tiny_changed_")
    other = changed(scenes, **{"effects.injection.fill": 0.8, "output.duration": "0.1 s"})
    assert other.name != dotted.name and other.effects["injection"].fill == 0.8


def test_none_removes_what_is_inherited(scenes):
    assert "injection" not in changed(scenes, effects={"injection": None}).effects


def test_without_changes_it_is_the_scene_itself(scenes):
    before = sorted(scenes.iterdir())
    assert changed(scenes).name == "tiny" and sorted(scenes.iterdir()) == before


def test_named_scene_follows_its_changes(scenes):
    for duration in (0.1, 0.2):
        assert changed(scenes, "short", output={"duration": duration}).output.duration == duration


@pytest.mark.parametrize(("changes", "sentence"), [
    ({"efects": {}}, "efects: is no key of a scene (did you mean effects?)"),
    ({"effects.injection.fill": "101 %"}, "effects.injection.fill is \"101 %\", but must be above 0 and at most 1"),
    ({"effects.injection.fil": 0.9}, "did you mean fill?"),
    ({"output": {"duration": 1.0}, "output.duration": 2.0}, "output.duration: gives duration a second time"),
    ({"title": object()}, "title: is a object, but must be a number (in SI units), a text"),
])
def test_wrong_changes_are_one_sentence_and_leave_no_file(scenes, changes, sentence):
    before = sorted(scenes.iterdir())
    with pytest.raises(pipeline.UserError) as error:
        pipeline.run("tiny", folder=scenes.parents[1], **changes)
    assert sentence in str(error.value)
    assert sorted(scenes.iterdir()) == before and not (scenes.parents[1] / "outputs").exists()


@pytest.mark.parametrize(("arguments", "sentence"), [
    ({"scene": "tinny"}, "tinny.yaml: no such file (did you mean tiny?)"),
    ({"scene": "tiny", "accuracy": "drat"}, "did you mean draft?"),
    ({"scene": "tiny", "name": "../mine"}, '"../mine" cannot name a scene'),
    ({"scene": "tiny", "cores": 0}, "cores is 0, but must be at least 1"),
    ({"scene": "tiny", "name": "saccades", "title": "mine"}, "was written by hand"),
])
def test_wrong_arguments_are_one_sentence(scenes, arguments, sentence):
    before = (scenes / "clinic" / "saccades.yaml").read_text()
    with pytest.raises(pipeline.UserError) as error:
        pipeline.run(folder=scenes.parents[1], **arguments)
    assert sentence in str(error.value)
    assert (scenes / "clinic" / "saccades.yaml").read_text() == before


@pytest.mark.thorough
def test_an_error_of_a_stage_is_one_exception_with_its_sentence(scenes):
    folder = scenes.parents[1]
    (folder / "outputs").write_text("a file")
    with pytest.raises(pipeline.UserError) as error:
        pipeline.run("tiny", folder=folder, want=["scene.json"], progress=False)
    assert len(error.value.messages) == 1
    assert error.value.messages[0].startswith("outputs: this folder cannot be written")


def test_folder_without_a_run_is_told(tmp_path):
    with pytest.raises(pipeline.UserError, match="holds no run; run the scene at this level first"):
        pipeline.open_run(tmp_path)


# Results

def test_a_run_is_read_anew_after_more_of_it_was_made(scenes, monkeypatch):
    project, file = scenes.parents[1], scenes / "tests" / "tiny.yaml"
    resolved = project / "outputs" / "tiny" / "draft" / "scene.json"
    resolved.parent.mkdir(parents=True)
    resolved.write_text(load_scene(file, "draft").to_json())
    run = pipeline.open_run(resolved.parent)
    before = run.times

    def make(*_, **options):
        file.write_text(file.read_text().replace("duration: 0.2 s", "duration: 0.3 s"))
        resolved.write_text(load_scene(file, "draft").to_json())

    monkeypatch.setattr("pipeline.library.run.make", make)
    run.make("metrics.csv")
    assert run.times[-1] == pytest.approx(0.3) and before[-1] == pytest.approx(0.2) and len(run.frames) == 7


def test_table_is_asked_with_and_without_units():
    columns = {"frame": [0, 1], "time [s]": [0.0, 0.5], "speed_rms [m/s]": [0.0, 2.0]}
    table = MetricsTable({name: np.array(values, float) for name, values in columns.items()},
                         [Metric("speed_rms", "m/s", "how fast <the> liquids are", dict)])
    np.testing.assert_array_equal(table["speed_rms"], table["speed_rms [m/s]"])
    assert list(table) == list(columns) and table.unit("speed_rms") == "m/s" and table.time[-1] == 0.5
    assert "how fast &lt;the&gt; liquids are" in table._repr_html_()
    with pytest.raises(KeyError, match="did you mean speed_rms"):
        table["sped_rms"]


@pytest.mark.thorough
def test_oil_at_rest_is_a_shape_and_what_it_touches():
    rest = pipeline.oil_at_rest("heavy_oil_densiron_68", "60 %", "upright")
    assert rest.shares["inferior"] > 0.6 and rest.shares["superior"] < 0.2
    whole = rest.wall.volume
    assert rest.surface.volume == pytest.approx(0.6 * whole, rel=1e-5)
    lowest = rest.wall.points[:, 1].argmin()
    assert rest.wall.point_data["contact_distance"][lowest] > 0.0
    html = rest._repr_html_()
    assert "not for decisions on a patient" in html and "data:image/png" in html


@pytest.mark.parametrize(("arguments", "sentence"), [
    ({"posture": "uprigth"}, "did you mean upright?"), ({"oil": "olive"}, 'oil is "olive", but must be one of'),
    ({"fill": "120 %"}, "fill is \"120 %\", but must be at least 0.01 and at most 0.999"),
    ({"oil": "aqueous"}, 'oil is "aqueous", but must be another liquid than the one that it leaves room for'),
    ({"eye": {"axial_length": "3 mm"}}, "axial_length is \"3 mm\", but must be at least 0.015 m"),
])
def test_oil_that_cannot_rest_is_one_sentence(arguments, sentence):
    with pytest.raises(pipeline.UserError) as error:
        pipeline.oil_at_rest(**arguments)
    assert sentence in str(error.value)


def test_plan_is_that_of_the_command(capsys):
    plan = pipeline.plan_fill("6h,60deg", "2h", oils=["silicone_oil_1000"])
    plan_stage.main(["--break", "6h,60deg", "--size", "2h", "--oil", "silicone_oil_1000"])
    assert capsys.readouterr().out == plan.text() and plan.best.covers(plan.question.largest_fill)
    assert plan._repr_html_().count("<tr") == 1 + len(plan.answers)


@pytest.mark.thorough
def test_stages_start_without_the_library():
    code = ("import sys, pipeline.scene; heavy = ('pipeline.library', 'snakemake', 'pyvista'); "
            "assert not [name for name in sys.modules if name.startswith(heavy)]")
    assert not subprocess.run([sys.executable, "-c", code], cwd=ROOT).returncode


# As a wheel

def test_containers_get_all_that_a_wheel_is_made_of():
    wheel = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["wheel"]
    parts = {name.lstrip("/") for name in (*wheel["include"], *wheel["force-include"])}
    assert {"pipeline", "sim", "studies"} <= parts
    let_in = {line.lstrip("!") for line in (ROOT / ".dockerignore").read_text().splitlines()}
    packed = set((ROOT / "container" / "in_debian").read_text().partition("tar -C")[2].partition("|")[0].split())
    assert parts <= let_in and parts <= packed
    of_wheel = re.findall(r"(?:CODE|REST)=\((.*?)\)", (ROOT / "tests" / "of_wheel").read_text())
    assert {*" ".join(of_wheel).split()} == parts - {"docs/report"}


@pytest.mark.thorough
def test_installed_files_run_outside_the_project(tmp_path):
    """The layout of a wheel: packages, and in one of them what is no Python."""
    site, home = tmp_path / "site", tmp_path / "home"
    home.mkdir()
    ignore = shutil.ignore_patterns("__pycache__")
    for name in ("pipeline", "sim", "studies"):
        shutil.copytree(ROOT / name, site / name, ignore=ignore)
    for name in ("config", "profiles", "rules"):
        shutil.copytree(ROOT / name, site / "pipeline" / "project" / name)
    shutil.copy(ROOT / "Snakefile", site / "pipeline" / "project")
    code = (f"import sys; sys.path.insert(0, {str(site)!r}); import pipeline.scene; from pathlib import Path; "
            "from pipeline.workflow.command import project_folder, snakemake_command; "
            "folder = project_folder(Path.cwd()); "
            "pipeline.scene.main(['tiny', '--check']); "
            "print(pipeline.__file__, *snakemake_command(folder))")
    done = subprocess.run([sys.executable, "-c", code], cwd=home, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert str(site / "pipeline" / "project" / "Snakefile") in done.stdout
    assert (home / "config" / "scenes" / "tests" / "tiny.yaml").is_file()
