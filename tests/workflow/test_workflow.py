"""Snakemake: every scene can be planned, one runs end to end, a killed run goes on, and wrong input is a sentence."""
import contextlib
import dataclasses
import json
import os
import re
import runpy
import shutil
import signal
import subprocess
import sys
import time
import types
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from conftest import ROOT, Project
from helpers import forked
from helpers.cases import thorough
from helpers.snakemake_output import TRACE, planned

import pipeline
from pipeline.base import digest as code_digest
from pipeline.base.checksum import checksum_at_end
from pipeline.base.digest import modules_used
from pipeline.base.errors import UserError
from pipeline.base.frame_files import find_frames, read_frame
from pipeline.base.tables import read_table
from pipeline.runs.contents import CRATE
from pipeline.scenes.folders import scene_path, scene_paths
from pipeline.scenes.load import load_accuracy_levels, load_scene
from pipeline.scenes.model import Eye, Landmarks, Region
from pipeline.simulation.cost_files import STARTED_FROM
from pipeline.workflow import digest
from pipeline.workflow.notes import jobs_of
from pipeline.workflow.scenes import Workflow

SCENES = sorted(scene_paths(ROOT / "config" / "scenes"))
LEVELS = list(load_accuracy_levels(ROOT / "config" / "accuracy.yaml"))
# Plans

@pytest.mark.thorough
@pytest.mark.parametrize("accuracy", LEVELS)
def test_every_scene_can_be_planned(project, accuracy):
    code, output = project.snakemake("-n", "all", "--config", f"scenes=[{','.join(SCENES)}]", f"accuracy={accuracy}")
    assert code == 0, output
    assert planned(output)["movie"] == len(SCENES)


@pytest.mark.thorough
def test_any_scene_is_reached_by_its_output(project):
    code, output = project.snakemake("-n", "outputs/tiny/draft/movie.mp4")
    assert code == 0, output
    scene = load_scene(ROOT / "config" / "scenes" / "tiny.yaml", "draft")
    plan = planned(output)
    assert plan["simulate"] == plan["reconstruct"] == plan["render"] == scene.segment_count
    assert plan["total"] == 4 + 3 * scene.segment_count


def test_a_shell_understands_the_command_of_every_rule(project):
    # What a parameter holds may have brackets, quotes and spaces.
    project.write_scene("until", "extends: tiny\noutput: {until_rest: true}\n")
    on_request = [f"outputs/tiny/draft/{name}" for name in (
        "film.mp4", "turntable.mp4", "bodies.csv", "estimate.html", "frames/frames.pvd")]
    code, output = project.snakemake(
        "-n", "-p", "all", "explorer", "outputs/tiny/compare_draft_standard.html", "outputs/until/draft/movie.mp4",
        "outputs/studies/collision_study/draft/table.html", *on_request, "--config", "scenes=[tiny]")
    assert code == 0, output
    blocks = [block for path in (project.folder / "rules").glob("*.smk") for block in path.read_text().split("\n\n\n")]
    rules = {name for block in blocks if "\n    shell:" in block
             for name in re.findall(r"^(?:rule|checkpoint) (\w+):", block, re.MULTILINE)}
    assert len(rules) > 15 and rules <= planned(output).keys()
    commands = "\n".join(re.findall(r"^Shell command: (.*)", output, re.MULTILINE))
    assert commands.count("python -m pipeline.") > len(rules)
    done = subprocess.run(["bash", "-n"], input=commands, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_a_scene_can_start_from_the_end_of_another(project):
    project.write_scene("after", "extends: tiny\nstart_from: tiny\neffects: {injection: null}\n")
    code, output = project.snakemake("-n", "outputs/after/draft/frames/frames.pvd")
    assert code == 0, output
    tiny = load_scene(ROOT / "config" / "scenes" / "tiny.yaml", "draft")
    assert planned(output)["simulate"] == 2 * tiny.segment_count


@pytest.mark.thorough
def test_levels_of_a_scene_stand_side_by_side(project):
    levels = {}
    for level in ("draft", "standard"):
        code, output = project.snakemake(f"outputs/tiny/{level}/eye.vtp")
        assert code == 0, output
        levels[level] = {path: path.stat().st_mtime_ns for path in project.outputs("tiny", level).rglob("*.vtp")}
        assert f'"accuracy": "{level}"' in (project.outputs("tiny", level) / "scene.json").read_text()
    code, output = project.snakemake("outputs/tiny/draft/eye.vtp", "--config", "accuracy=fine")
    assert code == 0 and "Nothing to be done" in output, output
    assert all(path.stat().st_mtime_ns == date for dates in levels.values() for path, date in dates.items())


@pytest.mark.thorough
@pytest.mark.parametrize("arguments", [("all", "--config", "scenes=[tiny]"), ("tiny", "--config")])
def test_configured_level_is_that_of_all_and_of_a_scene_asked_for_by_its_name(project, arguments):
    code, output = project.snakemake("-n", *arguments, "accuracy=fine")
    assert code == 0, output
    assert "outputs/tiny/fine/movie.mp4" in output and "at draft" not in output


# Wrong input

@pytest.mark.thorough
@pytest.mark.parametrize(("arguments", "sentence"), [
    (["tinny"], 'no scene and no study is called "tinny" (did you mean tiny?)'),
    (["tiny (1)"], 'no scene and no study is called "tiny (1)" (did you mean tiny?)'),
    (["outputs/tiny (1)/draft/movie.mp4"], "tiny (1).yaml: no such file (did you mean tiny?)"),
    (["outputs/tinny/draft/movie.mp4"], "tinny.yaml: no such file (did you mean tiny?)"),
    (["outputs/studies/validation/table.html"], "ask for outputs/studies/validation/draft/table.html"),
    (["outputs/studies/validation/standard"], "ask for a file in it, such as outputs/studies/validation/standard/t"),
    (["outputs/studies/validatoin/table.html"], 'no study is called "validatoin" (did you mean validation?)'),
    (["outputs/tiny/movie.mp4"], "outputs/tiny/movie.mp4: every accuracy level has a folder of its own (draft, "
                                 "standard, fine); ask for outputs/tiny/draft/movie.mp4"),
    (["outputs/tiny/frames/frames.pvd", "--config", "accuracy=fine"], "ask for outputs/tiny/fine/frames/frames.pvd"),
    (["outputs/tiny/finest/movie.mp4"], 'no accuracy level is called "finest" (did you mean fine?)'),
    (["outputs/tiny/draft"], "ask for a file in it, such as outputs/tiny/draft/movie.mp4"),
    (["all", "--config", "scenes=[tinny]"], "tinny.yaml: no such file"),
    (["all", "--config", "scenes=tiny"], "scenes is 'tiny', but must be a list"),
    (["all", "--config", "accuracy=finest"], 'accuracy is "finest", but must be one of draft, standard, fine'),
    (["tiny", "-j0"], "-j is 0, but must be the number of cores to use, 1 at least, or all"),
    (["config/scenes/tiny.yaml"], "is a scene file, but scenes are asked for by their names (did you mean tiny?)"),
    (["outputs/tiny/draft/film.mp5"], "no rule makes this file (did you mean film.mp4?); in outputs/tiny/draft there"),
    (["outputs/tinny/draft/index.htm"], "tinny.yaml: no such file (did you mean tiny?)"),
    (["--report", "report.html"], "is not made yet, and "),
    (["all", "--config", "acuracy=fine"], "acuracy: unknown key, must be one of scenes, accuracy"),
])
def test_wrong_request_ends_with_a_sentence(project, arguments, sentence):
    code, output = project.snakemake(*arguments)
    assert code == 2
    assert sentence in output and TRACE not in output


@pytest.mark.thorough
def test_scene_with_errors_ends_with_all_of_them(project):
    project.write_scene("wrong", "extends: tiny\neffects: {injection: {fill: 101 %}}\noutput: {duratoin: 1 s}\n")
    code, output = project.snakemake("outputs/wrong/draft/movie.mp4")
    assert code == 2
    assert "fill" in output and "duratoin" in output and TRACE not in output
    assert not project.outputs("wrong").exists()


@pytest.mark.thorough
def test_outputs_that_cannot_be_written_end_with_a_sentence(project):
    (project.folder / "outputs").write_text("a file")
    code, output = project.snakemake("outputs/tiny/draft/scene.json")
    assert code == 2
    assert "error: outputs: this folder cannot be written" in output and TRACE not in output


# Digests

def test_simulation_depends_on_the_effects_of_its_scene_only():
    used = {str(path.relative_to(code_digest.ROOT)) for path in modules_used("pipeline.simulate", {"gravity"})}
    assert {"pipeline/simulate.py", "sim/solver.py", "sim/effects/gravity.py"} <= used
    assert "sim/effects/diffusion.py" not in used and "pipeline/render.py" not in used


def test_every_stage_has_a_digest_that_ignores_the_solver_where_it_is_not_run():
    for stage in ("scene", "advise", "eye", "voxelize", "reconstruct", "render", "movie", "metrics", "frames",
                  "effect_costs", "index_run"):
        used = modules_used(f"pipeline.{stage}", {"gravity"})
        assert code_digest.ROOT / "pipeline" / f"{stage}.py" in used
        assert code_digest.ROOT / "sim" / "solver.py" not in used, stage


def test_digest_counts_code_but_not_comments(tmp_path, monkeypatch):
    monkeypatch.setattr(code_digest, "ROOT", tmp_path)
    (tmp_path / "pipeline").mkdir()
    (tmp_path / "pipeline" / "movie.py").write_text("from pipeline import helper\n")
    helper = tmp_path / "pipeline" / "helper.py"
    digests = []
    for text in ('"""One."""\nx = 1\n', '"""Two."""\n\n# why\nx = 1\n', "x = 2\n"):
        helper.write_text(text)
        digests.append(digest.stage_digest("movie"))
    assert digests[0] == digests[1] != digests[2]


def test_digest_of_a_stage_counts_what_it_reads_of_the_scene(project):
    project.write_scene("red", 'extends: tiny\nlabel: red\nliquids: {aqueous: {color: "#ff0000"}}\n')
    project.write_scene("long", "extends: tiny\noutput: {duration: 1 s}\n")
    project.write_scene("thick", "extends: tiny\nliquids: {aqueous: {dynamic_viscosity: 2 mPa s}}\n")
    base, red, long, thick = (load_scene(project.folder / "config" / "scenes" / f"{name}.yaml", "draft")
                              for name in ("tiny", "red", "long", "thick"))

    def changed(scene):
        scene = dataclasses.replace(scene, name="tiny")
        return {stage for stage in digest.UNREAD
                if digest.stage_digest(stage, scene) != digest.stage_digest(stage, base)}

    assert changed(red) == {"render", "index_run", "still", "illustrate", "turntable"}      # by color, or by label
    assert changed(long) == {"advise", "cost", "estimate", "rest"}
    assert {"simulate", "metrics"} <= changed(thick) and "eye" not in changed(thick)


@pytest.mark.parametrize(("stage", "key"), [
    ("reconstruct", "output.kernel"), ("reconstruct", "output.cell_ratio"), ("reconstruct", "eye.side"),
    ("metrics", "eye.side"), ("metrics", "output.second_means"), ("rest", "eye.lens"), ("render", "eye.side"),
    ("render", "output.image_size"), ("still", "eye.side"), ("movie", "output.second_means"),
    ("simulate", "output.frame_interval"), ("simulate", "start_from"), ("voxelize", "numerics.particle_spacing"),
    ("rest", "numerics.particle_spacing"), ("metrics", "regions"), ("render", "regions"), ("illustrate", "eye.side"),
    ("turntable", "eye.side"), ("estimate", "eye.lens"), ("index_run", "regions")])
def test_a_stage_runs_again_when_what_it_reads_changes(stage, key):
    """The digests key by key, of keys that other stages do not read."""
    scene = load_scene(ROOT / "config" / "scenes" / "tiny.yaml", "draft")
    part, _, name = key.rpartition(".")
    record = getattr(scene, part) if part else scene
    other = {"kernel": lambda old: next(one for one in ("isotropic", "anisotropic") if one != old),
             "cell_ratio": lambda old: 0.9 * old, "side": lambda old: "left", "second_means": lambda old: 60.0,
             "lens": lambda old: "aphakic", "image_size": lambda old: (old[0] + 2, old[1]),
             "frame_interval": lambda old: 0.5 * old, "particle_spacing": lambda old: 0.9 * old,
             "start_from": lambda old: "still_eye", "regions": lambda old: (Region("upper", hours=(10.0, 2.0)),),
             }[name](getattr(record, name))
    assert other != getattr(record, name)
    changed = dataclasses.replace(record, **{name: other})
    changed = dataclasses.replace(scene, **{part: changed}) if part else changed
    assert digest.stage_digest(stage, changed) != digest.stage_digest(stage, scene)


def test_the_side_of_an_eye_counts_for_its_surface_where_landmarks_turn_a_mesh_or_an_image_tells_it():
    scene = load_scene(ROOT / "config" / "scenes" / "tiny.yaml", "draft")
    for more, counts in (({}, False), ({"landmarks": Landmarks(optic_disc=(5e-3, 3e-3, -10e-3))}, True),
                         ({"label": 1}, True)):
        sides = {side: digest.stage_digest("eye", dataclasses.replace(scene, eye=Eye(
            model="mesh", path="eye.stl", side=side, **more))) for side in ("right", "left")}
        assert (sides["right"] != sides["left"]) == counts


def test_a_page_shows_the_scene_file_and_those_that_it_extends_as_they_are(project, monkeypatch):
    monkeypatch.chdir(project.folder)
    wildcards = types.SimpleNamespace(scene="after")
    project.write_scene("after", "extends: tiny\n")
    texts = {Workflow.page_texts(wildcards)}
    for name, more in (("tiny", "# why\n"), ("after", "# what for\n"), ("egg_thrown", "# not shown\n")):
        file = scene_path(name, project.folder / "config" / "scenes")
        file.write_text(file.read_text() + more)
        texts.add(Workflow.page_texts(wildcards))
    assert len(texts) == 3


# A whole run

@pytest.fixture(scope="module")
def finished(tmp_path_factory, can_draw):
    """Return a project in which the scene `tiny` has been run."""
    project = Project(tmp_path_factory.mktemp("finished"))
    code, output = project.snakemake(*targets(can_draw))
    assert code == 0, output
    assert TRACE not in output
    last = [line for line in output.splitlines() if line.startswith("tiny at draft: page")]
    assert last == ["tiny at draft: page outputs/tiny/draft/index.html, movie outputs/tiny/draft/movie.mp4, pictures "
                    "outputs/tiny/draft/images"] * can_draw
    return project


def targets(can_draw):
    """Return what to make of `tiny`: all that the rule `all` asks for; pictures only where they can be drawn."""
    names = ["metrics.csv", "advice.html", "effects.html", "run.pvd"]
    return [f"outputs/tiny/draft/{name}" for name in names + ["movie.mp4", "cost.html", "index.html", CRATE] * can_draw]


@pytest.mark.thorough
def test_tiny_scene_makes_everything(finished, can_draw):
    scene = load_scene(finished.folder / "config" / "scenes" / "tiny.yaml", "draft")
    folder = finished.outputs("tiny")
    table = read_table(folder / "metrics.csv")
    assert table["frame"].tolist() == list(range(scene.frame_count))
    np.testing.assert_allclose(table["time [s]"], scene.output.frame_interval * table["frame"], atol=1e-12)
    assert np.all(table["particles_outside [1]"] == 0)
    total = table["volume_aqueous [mL]"] + table["volume_silicone_oil_1000 [mL]"]
    np.testing.assert_allclose(total, total[0], rtol=1e-4)
    for segment in range(scene.segment_count):
        for frame in scene.frames_of_segment(segment):
            assert (folder / f"frames/segment_{segment:03d}/frame_{frame:05d}.vtu").is_file()
            if can_draw:
                assert (folder / f"images/segment_{segment:03d}/frame_{frame:05d}.png").is_file()
        assert list((folder / f"surfaces/segment_{segment:03d}").glob("*.vtp"))
    assert {path.name for path in (folder / "logs").iterdir()} >= {"scene.log", "simulate_000.log", "metrics.log"}
    left_over = [path for path in folder.rglob(".*") if path.name != ".snakemake_timestamp"]
    assert not left_over
    assert "interface_tension" in (folder / "effects.csv").read_text()


@pytest.mark.thorough
def test_finished_run_has_nothing_to_do(finished, can_draw):
    code, output = finished.snakemake("-n", *targets(can_draw))
    assert code == 0 and "Nothing to be done" in output, output


@pytest.mark.thorough
def test_finished_run_is_as_its_crate_says(finished, opengl):
    done = forked.run("pipeline.verify", "outputs/tiny/draft", folder=finished.folder)
    assert done.returncode == 0 and "nothing differs from the crate" in done.stdout, done.stdout + done.stderr


@pytest.mark.thorough
def test_the_crate_is_written_last_and_again_whenever_a_file_is(finished, opengl):
    with contextlib.chdir(finished.folder):
        jobs = {job.rule: job for job in jobs_of(Path("outputs/tiny/draft"))}
    waited_for = {*jobs["crate"].inputs}
    assert {name for rule, job in jobs.items() if rule != "crate" for name in job.outputs} <= waited_for
    code, output = finished.snakemake("-n", "-R", "metrics", "--", *targets(True))
    plan = planned(output)
    assert plan["metrics"] == plan["page"] == plan["crate"] == 1 and plan["simulate"] == 0, output
    requested = finished.outputs("tiny") / "bodies.csv"
    try:
        requested.touch()
        code, output = finished.snakemake("-n", *targets(True))
    finally:
        requested.unlink()
    assert code == 0 and planned(output)["crate"] == 1 and planned(output)["page"] == 0, output


# Keys that stages read although neither their own digest counts them nor one of a stage before them.
READ_OTHERWISE = {
    "output.duration": "tells how many frames there are, which the input of a job tells Snakemake too",
    "output.until_rest": "the same",
    "accuracy": "the level is in the name of the folder",
}
HANDED_ON = {("voxelize", "schemes"), ("voxelize", "start_from")}  # to the solver's settings, of which it takes others


def stale(read, before, unread):
    """Return (stage, key) of what a stage reads of a scene while a change of it would run nothing again.

    read : stage -> keys. before : stage -> stages whose files it reads, directly or not. unread : as UNREAD.
    """
    def left_out(stage, key):
        return any(key == one or key.startswith(f"{one}.") for one in unread.get(stage, ()))

    found = {(stage, key) for stage, keys in read.items() for key in keys if key not in READ_OTHERWISE
             and all(left_out(one, key) for one in {stage, *before[stage]} if one != "scene")}
    return found - HANDED_ON


@pytest.fixture(scope="module")
def read_of_a_scene(finished, opengl, tmp_path_factory):
    """Return what stages read of the scene, and which stages are before each, by running them on a copy of the run."""
    folder = tmp_path_factory.mktemp("recorded")
    for name in ("outputs", "config", ".snakemake"):
        shutil.copytree(finished.folder / name, folder / name)
    with contextlib.chdir(folder):
        jobs = jobs_of(Path("outputs/tiny/draft"))
    first = {job.rule: job.command for job in reversed(jobs)
             if job.stage not in ("scene", "crate", "still")}  # a still takes longer than all others
    (folder / "commands.json").write_text(json.dumps([*reversed(first.values())]))
    done = subprocess.run([sys.executable, ROOT / "tests/workflow/recorded_scene.py", "commands.json", "read.json"],
                          cwd=folder, env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    made_by = {name: job for job in jobs for name in job.outputs}
    before: dict[str, set[str]] = {}
    for job in jobs:  # in the order of time
        earlier = [made_by[name].stage for name in job.inputs if name in made_by]
        before.setdefault(job.stage, set()).update(*({one, *before.get(one, ())} for one in earlier))
    return json.loads((folder / "read.json").read_text()), before


@pytest.mark.thorough
def test_no_stage_reads_a_key_of_a_scene_that_would_run_nothing_again(read_of_a_scene):
    read, before = read_of_a_scene
    assert {"simulate", "reconstruct", "render", "metrics", "page"} <= read.keys()
    assert "numerics.particle_spacing" in read["simulate"] and "output.image_size" in read["render"]
    assert stale(read, before, digest.UNREAD) == set()


@pytest.mark.parametrize("stage, key", [
    ("reconstruct", "output.kernel"), ("metrics", "eye.side"), ("metrics", "title"), ("render", "label"),
    ("metrics", "output.second_means"), ("index_run", "liquids.color"), ("simulate", "output.frame_interval")])
@pytest.mark.thorough
def test_a_key_that_is_left_out_of_a_digest_by_mistake_is_found(read_of_a_scene, stage, key):
    unread = digest.UNREAD | {stage: (*digest.UNREAD[stage], key)}
    assert any(found[0] == stage and found[1].startswith(key) for found in stale(*read_of_a_scene, unread))


@pytest.mark.thorough
def test_library_takes_what_has_been_made(finished, can_draw):
    dates = {path: path.stat().st_mtime_ns for path in finished.outputs("tiny").rglob("*.*")}
    run = pipeline.run("tiny", folder=finished.folder, want=["metrics.csv", "frames"], progress=False)
    assert dates == {path: path.stat().st_mtime_ns for path in finished.outputs("tiny").rglob("*.*")}
    assert len(run.frames) == run.scene.frame_count and run.frames[-1].time == run.metrics.time[-1] == run.times[-1]
    oil = run.surfaces(-1)["silicone_oil_1000"]
    assert oil.is_manifold and 1e6 * oil.volume == pytest.approx(run.metrics["volume_silicone_oil_1000"][-1], rel=0.2)
    assert run.wall().n_cells > 1000 and "of the retina is under oil" in run._repr_html_()
    if can_draw:
        assert run.picture(0.1).size == run.scene.output.image_size
    for ask, sentence in ((lambda: run.picture(9.0), "at most 0.2 s"), (lambda: run.surfaces(5), "tiny has 5 frames"),
                          (lambda: run.plot("nothing"), "has not been made; make it with")):
        with pytest.raises(pipeline.UserError, match=sentence):
            ask()


@pytest.mark.slow
def test_notebook_runs_as_it_is_shown(finished, opengl):
    executed = runpy.run_path(str(ROOT / "docs" / "make_notebook.py"))["executed"]
    shown = executed(finished.folder, scene="tiny")
    assert all(cell.outputs for cell in shown.cells[2:] if cell.cell_type == "code")


@pytest.mark.thorough
def test_copy_without_dates_has_nothing_to_do(finished, can_draw, tmp_path):
    copy = Project(tmp_path)
    made = [path for name in ("outputs", ".snakemake") for path in (finished.folder / name).rglob("*")]
    for path in sorted(made, reverse=True):  # in another order than they were made in
        other = tmp_path / path.relative_to(finished.folder)
        (other if path.is_dir() else other.parent).mkdir(parents=True, exist_ok=True)
        if path.is_file():
            shutil.copyfile(path, other)
    code, output = copy.snakemake("-n", *targets(can_draw))
    assert code == 0 and "Nothing to be done" in output, output
    # Where the folder is known, what somebody writes by hand counts.
    (copy.outputs("tiny") / "frames" / "segment_000" / ".snakemake_timestamp").touch()
    code, output = copy.snakemake("-n", *targets(can_draw))
    assert planned(output)["reconstruct"] == 2, output  # the second segment reads where oil came over the wall before


@pytest.mark.thorough
def test_a_film_is_made_on_request(finished, opengl):
    film = finished.outputs("tiny") / "film.mp4"
    code, output = finished.snakemake(f"outputs/tiny/draft/{film.name}", f"outputs/tiny/draft/{CRATE}")
    assert code == 0, output
    reader = imageio_ffmpeg.read_frames(film)
    about = next(reader)
    reader.close()
    assert about["source_size"] == (960, 540) and about["fps"] <= 24.0 and about["duration"] > 1.0
    assert len(list(film.parent.glob("illustrations/segment_*/frame_*.png"))) == 5


@pytest.mark.thorough
def test_changed_scene_runs_only_what_it_concerns(finished, can_draw):
    scene = scene_path("tiny", finished.folder / "config" / "scenes")
    before = scene.read_text()
    try:
        scene.write_text(before + "label: illustration\n")
        code, output = finished.snakemake("-n", *targets(can_draw))
    finally:
        scene.write_text(before)
    assert code == 0, output
    plan = planned(output)
    assert plan["simulate"] == plan["reconstruct"] == plan["eye"] == plan["metrics"] == 0
    assert plan["render"] == 2 * can_draw and plan["page"] == can_draw


@pytest.mark.thorough
def test_longer_scene_keeps_what_it_has(finished):
    scene = scene_path("tiny", finished.folder / "config" / "scenes")
    before = scene.read_text()
    try:
        scene.write_text(before.replace("duration: 0.2 s", "duration: 0.4 s"))
        code, output = finished.snakemake("-n", "outputs/tiny/draft/frames/frames.pvd")
    finally:
        scene.write_text(before)
    assert code == 0, output
    assert planned(output)["simulate"] == 2 and planned(output)["voxelize"] == 0


@pytest.mark.thorough
def test_resolved_scene_follows_its_file(project):
    resolved = project.outputs("tiny") / "scene.json"
    project.snakemake("outputs/tiny/draft/eye.vtp")
    assert '"title": "Tiny tamponade"' in resolved.read_text()
    date = (project.outputs("tiny") / "eye.vtp").stat().st_mtime_ns
    tiny = scene_path("tiny", project.folder / "config/scenes").read_text()
    project.write_scene("tiny", tiny.replace("Tiny", "Small"))
    code, output = project.snakemake("outputs/tiny/draft/initial.npz")
    assert code == 0, output
    assert '"title": "Small tamponade"' in resolved.read_text()
    assert (project.outputs("tiny") / "eye.vtp").stat().st_mtime_ns == date


@pytest.mark.thorough
def test_edited_code_runs_its_stages_again(finished, can_draw):
    code_folder = finished.own_code("pipeline")
    try:
        for name in ("measures/summary.py", "movie.py"):
            (code_folder / name).write_text((code_folder / name).read_text() + "\nADDED = 1\n")
        code, output = finished.snakemake("-n", *targets(can_draw))
    finally:
        shutil.rmtree(code_folder)
        code_folder.symlink_to(ROOT / "pipeline")
    assert code == 0, output
    plan = planned(output)
    assert plan["metrics"] == 1 and plan["movie"] == can_draw
    assert plan["simulate"] == plan["reconstruct"] == plan["render"] == 0


@pytest.mark.thorough
def test_report_is_one_page(finished, can_draw):
    """Without a number of cores, as the README has it."""
    done = forked.run("snakemake", *targets(can_draw), "--report", "report.html", folder=finished.folder)
    assert done.returncode == 0, done.stderr
    page = (finished.folder / "report.html").read_text()
    assert "metrics in short" in page and "wall_coverage" in page
    if can_draw:  # the frames are one picture, not one each
        assert "all on one page" in page and "eight moments" in page and "picture of frame" not in page


@pytest.mark.thorough
def test_killed_run_goes_on_to_the_same_frames(finished, project):
    """First the simulation alone is killed, then everything, both in the second segment."""
    target = "outputs/tiny/draft/frames/frames.pvd"
    first = project.outputs("tiny") / "checkpoints" / "segment_000.npz"
    dates = set()
    for victim in ("simulation", "everything"):
        run = project.start(target)
        wait_for(lambda: first.exists() and pids_of("pipeline.simulate", "--segment 1", project.folder), run)
        if victim == "everything":
            os.killpg(run.pid, signal.SIGKILL)
        for pid in pids_of("pipeline.simulate", "--segment 1", project.folder):
            with contextlib.suppress(ProcessLookupError):  # it has ended in the meantime
                os.kill(pid, signal.SIGKILL)
        assert run.wait() != 0
        dates.add(first.stat().st_mtime_ns)

    code, output = project.snakemake(target)
    assert code == 0, output
    assert dates == {first.stat().st_mtime_ns}
    for segment in ("segment_000", "segment_001"):
        ours, theirs = (find_frames(one.outputs("tiny") / "frames" / segment) for one in (project, finished))
        assert [path.name for path in ours] == [path.name for path in theirs]
        for one, other in zip(map(read_frame, ours), map(read_frame, theirs), strict=True):
            for name in ("id", "position", "velocity", "volume_fraction", "volume"):
                np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    costs = json.loads((project.outputs("tiny") / "costs" / "segment_001.json").read_text())
    assert costs[STARTED_FROM] == checksum_at_end(first)


@pytest.mark.thorough
def test_a_scene_ends_when_it_rests(project):
    """And what starts from it starts from there."""
    project.write_scene("resting", """extends: still_eye
numerics: {particle_spacing: 2 mm}
output: {duration: 60 s, until_rest: true, frame_interval: 0.5 s, frames_per_segment: 2}
""")
    project.write_scene("after", "extends: resting\nstart_from: resting\ninitial: null\noutput: {duration: 1 s}\n")
    target = "outputs/resting/draft/metrics.csv"
    code, output = project.snakemake(target, "outputs/resting/draft/frames/frames.pvd")
    assert code == 0, output
    assert "simulate segment 1 of at most 60" in output
    run = pipeline.open_run(project.outputs("resting"))
    said = [json.loads(path.read_text())["at_rest"] for path in sorted((run.folder / "rest").iterdir())]
    assert said == [False] * (len(said) - 1) + [True] and 2 <= len(said) < 10
    end, last = float(len(said)), f"segment_{len(said) - 1:03d}"
    assert f"after {end:g} s: nearly at rest" in output
    assert sorted(path.name for path in (run.folder / "frames").glob("segment_*"))[-1] == last
    np.testing.assert_allclose(run.times, np.arange(0.0, end + 0.1, 0.5))
    np.testing.assert_allclose(run.metrics["time [s]"], run.times)
    assert len(run.frames) == len(run.times) and run.frames[-1].time == pytest.approx(end)
    with pytest.raises(UserError, match=f"at most {end:g} s"):
        run.frame_at(end + 1.0)

    code, output = project.snakemake("-n", target)
    assert code == 0 and "Nothing to be done" in output
    code, output = project.snakemake("-n", "-p", "outputs/after/draft/frames/segment_000")
    assert code == 0 and planned(output)["simulate"] == 1
    assert f"--restart outputs/resting/draft/checkpoints/{last}.npz" in output
    (run.folder / "rest" / f"{last}.json").write_text("{")
    code, output = project.snakemake("-n", target)
    assert code == 2 and f"{last}.json: is damaged" in output and TRACE not in output


@pytest.mark.thorough
def test_second_run_at_the_same_time_is_refused(finished, project):
    run = project.start("outputs/tiny/draft/frames/frames.pvd")
    log = (project.folder / "snakemake.log").read_text
    wait_for(lambda: "check the scene" in log(), run)
    (project.folder / "first.log").write_text(log())
    code, output = project.snakemake("outputs/tiny/draft/frames/frames.pvd")
    shutil.copy(ROOT / "run", project.folder)
    at_once = subprocess.run(["bash", "run"], cwd=project.folder, capture_output=True, text=True)
    os.killpg(run.pid, signal.SIGKILL)
    run.wait()
    assert code == 2
    assert "another snakemake works in this folder" in output and TRACE not in output
    assert at_once.returncode == 1 and not (project.folder / ".venv").exists()
    assert at_once.stderr == "error: outputs: another snakemake works in this folder; wait for its end\n"


@pytest.mark.thorough
def test_interrupted_run_ends_in_a_sentence(project):
    run = project.start("outputs/tiny/draft/frames/segment_000")
    log = (project.folder / "snakemake.log").read_text
    wait_for(lambda: "check the scene" in log(), run)
    os.killpg(run.pid, signal.SIGINT)
    assert run.wait(60)
    said = log()[log().index("check the scene"):]
    assert "stopped; the same command goes on from here" in said
    assert "Error" not in said and TRACE not in said, said


def wait_for(condition, run, timeout=300.0):
    """Wait until a condition holds while ``run`` is at work."""
    end = time.monotonic() + timeout
    while not condition():
        assert run.poll() is None, "the run has ended too early"
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)


def pids_of(*words):
    """Return the processes of Python whose command line and folder contain all words."""
    found = []
    for entry in os.listdir("/proc"):
        if entry.isdigit():
            try:
                with open(f"/proc/{entry}/cmdline") as file:
                    line = file.read().replace("\0", " ") + os.readlink(f"/proc/{entry}/cwd")
            except OSError:  # it has ended in the meantime
                continue
            if line.startswith("python") and all(str(word) in line for word in words):
                found.append(int(entry))
    return found


@pytest.mark.parametrize(("effects", "before"), [
    ("{}", "outputs/longer/draft/frames/segment_000 outputs/longer/draft/frames/segment_001 "),
    thorough("{interface_tension: null}", "")])
def test_surfaces_follow_films_from_the_start_where_theory_knows_them(project, effects, before):
    project.write_scene("longer", f"extends: tiny\neffects: {effects}\noutput: {{duration: 0.5 s}}\n")
    code, output = project.snakemake("-n", "-p", "outputs/longer/draft/surfaces/segment_002")
    assert code == 0, output
    assert f" --before {before}--eye " in re.sub(r"\s+", " ", output)


def test_simulation_runs_again_when_the_code_of_its_effects_changes(project, monkeypatch):
    """And not for the code of others."""
    scene = load_scene(ROOT / "config" / "scenes" / "tiny.yaml", "draft")
    assert "injection" in scene.effects and "drift" not in scene.effects
    monkeypatch.setattr(code_digest, "ROOT", project.folder)
    before = digest.stage_digest("simulate", scene)
    effects = project.own_code("sim") / "effects"
    project.own_code("pipeline")
    for name, changes in (("drift", False), ("injection", True)):
        (effects / f"{name}.py").write_text((effects / f"{name}.py").read_text() + "\nADDED = 1\n")
        assert (digest.stage_digest("simulate", scene) != before) == changes
