"""What Snakemake is told, without it: which files of which level and segments are read, and what makes them anew."""
import base64
import json
import os
import types
from pathlib import Path

import pytest

from pipeline.base import digest as code_digest
from pipeline.forecast import retina_error
from pipeline.forecast.expected_error import COLUMNS, ORDERS
from pipeline.scenes.folders import scene_path
from pipeline.scenes.load import load_scene
from pipeline.studies import plan
from pipeline.workflow.copied import restore_dates
from pipeline.workflow.digest import stage_digest
from pipeline.workflow.notes import NOTES
from pipeline.workflow.scenes import Workflow, room_texts
from pipeline.workflow.studies import Studies

UNTIL = "extends: tiny\noutput: {duration: 1 s, until_rest: true}\n"
LEVELED = """
import dataclasses

from pipeline.studies.family import Family
from pipeline.studies.model import Outcome
from sim.parameters import parameter


@dataclasses.dataclass(frozen=True)
class Parameters:
    accuracy: str = parameter(meaning="level of the run that is read")


def run(case, runs):
    return Outcome()


FAMILY = Family(__name__, Parameters, run, scenes=lambda case: ("until",))
"""
RESTED = {"draft": 2, "standard": 3}  # segments after which the scene `until` is at rest; unknown at other levels


@pytest.fixture
def project(project, monkeypatch):
    """Return a copy of the project, which is the current folder, with a scene that ends at rest and one after it."""
    monkeypatch.chdir(project.folder)
    project.write_scene("until", UNTIL)
    project.write_scene("after", "extends: tiny\nstart_from: until\neffects: {injection: null}\n")
    for level, count in RESTED.items():
        folder = project.outputs("until", level) / "rest"
        folder.mkdir(parents=True)
        for segment in range(count + 1):  # the last one is of a longer run
            (folder / f"segment_{segment:03d}.json").write_text(f'{{"at_rest": {str(segment == count - 1).lower()}}}')
    return project


def flow():
    """What a new call of Snakemake asks."""
    return Workflow({"scenes": ["tiny"], "accuracy": "draft"})


def asked(scene="tiny", **more):
    """The wildcards of a job at draft."""
    return types.SimpleNamespace(scene=scene, level="draft", **more)


def names(count):
    return [f"{segment:03d}" for segment in range(count)]


# Levels and segments

@pytest.mark.parametrize("level", RESTED)
def test_a_scene_that_ends_at_rest_has_the_segments_of_its_level(project, level):
    last = f"outputs/until/{level}/checkpoints/segment_{RESTED[level] - 1:03d}.npz"
    assert flow().segments("until", level) == names(RESTED[level])
    assert flow().start("after", level, "000") == flow().known_start("after", level) == [last]


def test_every_segment_starts_where_the_one_before_ends(project):
    project.write_scene("longer", "extends: tiny\noutput: {duration: 0.5 s}\n")
    segments = load_scene(scene_path("longer"), "draft").segment_names
    assert len(segments) > 2 and [flow().start("longer", "draft", segment) for segment in segments] == [
        [], *([f"outputs/longer/draft/checkpoints/segment_{segment}.npz"] for segment in segments[:-1])]


@pytest.mark.parametrize("level", ["draft", "standard"])
def test_start_is_the_same_level_of_the_other_scene(project, level):
    project.write_scene("after", "extends: tiny\nstart_from: tiny\neffects: {injection: null}\n")
    last = load_scene(scene_path("tiny"), level).segment_names[-1]
    assert flow().start("after", level, "000") == [f"outputs/tiny/{level}/checkpoints/segment_{last}.npz"]


def test_a_comparison_reads_the_own_segments_of_all_its_levels(project):
    files = flow().compared("until", "draft_standard_fine")
    every = {level: len(load_scene(scene_path("until"), level).segment_names) for level in ("fine",)} | RESTED
    assert every["fine"] > 3
    for level, count in every.items():
        assert [file for file in files if f"/{level}/" in file and "segment_" in file] == [
            f"outputs/until/{level}/{kind}" for kind in [*(f"images/segment_{name}" for name in names(count)),
                                                         *(f"costs/segment_{name}.json" for name in names(count))]]
        assert f"outputs/until/{level}/metrics.csv" in files


@pytest.mark.usefixtures("nothing_planned")
def test_a_case_waits_for_all_that_it_reads_of_its_scenes_at_its_own_level(project):
    folder = project.folder / "config" / "studies"
    (folder / "leveled.py").write_text(LEVELED)
    (folder / "small.yaml").write_text("cases:\n  leveled: {accuracy: [draft, standard]}\n")
    studies = Studies(flow())
    for level, count in RESTED.items():
        own = f"outputs/until/{level}"
        assert sorted(studies.inputs("small", "draft", f"leveled-{level}")) == sorted([
            *(f"{own}/{file}" for file in ("scene.json", "initial.npz", "metrics.csv")),
            *(f"{own}/frames/segment_{name}" for name in names(count))])
    (effects,) = studies.study("effects_study", "draft").cases
    inputs = studies.inputs("effects_study", "draft", effects)
    assert {f"outputs/{scene}/draft/effects.csv" for scene in plan.cached_study(
        "effects_study", "draft").case(effects).folders()} <= {*inputs}


# What makes files anew

def test_a_segment_is_simulated_again_when_it_gets_more_frames(project):
    file = scene_path("tiny")
    told = {}
    for duration in ("0.15 s", "0.2 s", "0.3 s"):
        file.write_text(file.read_text().replace("duration: 0.2 s", f"duration: {duration}"))
        parameter = flow().depends("simulate")
        told[duration] = [parameter(asked(segment=name)) for name in ("000", "001")]
        file.write_text(file.read_text().replace(f"duration: {duration}", "duration: 0.2 s"))
    assert len({first for first, _ in told.values()}) == 1
    assert told["0.15 s"][1] != told["0.2 s"][1] == told["0.3 s"][1]


def test_the_surface_of_an_eye_follows_what_its_mesh_holds(project):
    project.write_scene("meshed", "extends: tiny\neye: {model: mesh, path: eye.stl, unit: mm}\n")
    file = scene_path("meshed").parent / "eye.stl"
    told = []
    for content in (b"one", b"one", b"two"):
        file.write_bytes(content)
        told.append(flow().depends("eye")(asked("meshed")))
    assert told[0] == told[1] != told[2]


def test_the_resolved_scene_is_that_of_its_file_before_any_stage_reads_it(project):
    resolved = project.outputs("tiny") / "scene.json"
    resolved.parent.mkdir(parents=True)
    resolved.write_text("of an older version")
    new = flow()
    new.scene("tiny", "draft")
    new.prepare_outputs()
    assert resolved.read_text() == load_scene(scene_path("tiny"), "draft").to_json()


def test_the_crate_is_made_anew_with_anything_in_the_scene_and_whatever_somebody_asked_for(project):
    before = flow().crate_depends(asked())
    project.write_scene("tiny", scene_path("tiny").read_text() + "label: sketch\n")
    assert flow().crate_depends(asked()) != before
    file = project.outputs("tiny") / "bodies.csv"
    file.parent.mkdir(parents=True)
    told = [flow().requested(asked())]
    for content in ("1", "2"):
        file.write_text(content)
        told.append(flow().requested(asked()))
    assert told[0] == [] and told[1] != told[2]


def test_what_is_said_of_errors_follows_both_tables_of_errors(project, monkeypatch, tmp_path):
    told = [Workflow.expected_errors()]
    ORDERS.parent.mkdir(parents=True)
    ORDERS.write_text(",".join(COLUMNS) + "\n")
    told.append(Workflow.expected_errors())
    monkeypatch.setattr(retina_error, "SHIPPED", tmp_path / "eye_errors.csv")
    retina_error.SHIPPED.write_text("other errors")
    assert len({*told, Workflow.expected_errors()}) == 3


@pytest.mark.parametrize("kind", ["css", "html", "js"])
def test_a_page_follows_its_styles_templates_and_scripts(tmp_path, monkeypatch, kind):
    monkeypatch.setattr(code_digest, "ROOT", tmp_path)
    (tmp_path / "pipeline" / "web").mkdir(parents=True)
    for name in ("page", "web/chart"):
        (tmp_path / "pipeline" / f"{name}.py").write_text("from pipeline.web import chart\n")
    told = []
    for text in ("one", "two"):
        (tmp_path / "pipeline" / "web" / f"chart.{kind}").write_text(text)
        told.append((stage_digest("page"), room_texts("web")))
    assert all(one != other for one, other in zip(*told, strict=True))


def test_a_copy_gets_its_dates_back_once_and_what_is_written_by_hand_then_counts(project):
    made = Path("outputs/tiny/draft/eye.vtp")
    made.parent.mkdir(parents=True)
    made.touch()
    NOTES.mkdir(parents=True)
    (NOTES / base64.urlsafe_b64encode(bytes(made)).decode()).write_text(json.dumps({"endtime": 1.7e9}))
    assert restore_dates() == 1 and made.stat().st_mtime == 1.7e9
    os.utime(made)
    assert restore_dates() == 0 and made.stat().st_mtime > 1.7e9
