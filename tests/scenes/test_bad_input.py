"""A disk that is full or broken and processes that were killed: one sentence, and nothing that was there is harmed."""
import os
import resource
import subprocess
import sys

import pytest
from conftest import ROOT
from helpers.synthetic_frames import make_frame
from PIL import Image

from pipeline.base import cli, files
from pipeline.base.frame_files import frame_path, write_frame
from pipeline.scenes.load import load_scene

LIMIT = 600  # bytes that a file may have: less than any result


def stage(name, *arguments):
    """Run a stage that cannot write more than ``LIMIT`` bytes; return its exit code and the lines on stderr."""
    done = subprocess.run([sys.executable, "-m", f"pipeline.{name}", *map(str, arguments)], cwd=ROOT,
                          capture_output=True, text=True,
                          preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (LIMIT, LIMIT)))
    return done.returncode, done.stderr.splitlines()


@pytest.fixture
def inputs(tmp_path):
    """Return a folder with a resolved scene, frames and pictures."""
    (tmp_path / "scene.json").write_text(load_scene(ROOT / "config/scenes/tiny.yaml", "draft").to_json())
    for index in range(12):
        write_frame(frame_path(tmp_path / "frames", index), make_frame(time=0.1 * index))
    (tmp_path / "images").mkdir()
    for index in range(3):
        Image.effect_noise((64, 48), 50).save(tmp_path / "images" / f"frame_{index:05d}.png")
    return tmp_path


CASES = {
    "scene": ("scene.json", lambda folder: [ROOT / "config/scenes/tiny.yaml", "--accuracy", "draft"]),
    "eye": ("eye.vtp", lambda folder: [folder / "scene.json", "--report", folder / "eye.json"]),
    "frames": ("frames.pvd", lambda folder: ["pvd", folder / "frames"]),
    "movie": ("movie.mp4", lambda folder: [folder / "images"]),
}


@pytest.mark.thorough_cases("eye", "scene")
@pytest.mark.parametrize("name", CASES)
def test_full_disk_is_one_sentence_that_names_the_file(name, inputs):
    target, arguments = CASES[name]
    output = inputs / "results" / target
    output.parent.mkdir()
    output.write_text("old")
    code, lines = stage(name, *arguments(inputs), "--output", output)
    assert code == cli.FAILED
    sentence, = [line for line in lines if "frames, 0 s" not in line]
    assert sentence.startswith("error: ") and target in sentence
    assert output.read_text() == "old" and os.listdir(output.parent) == [target]


def test_full_disk_keeps_an_old_folder(tmp_path):
    folder = tmp_path / "frames"
    folder.mkdir()
    (folder / "old").touch()
    with pytest.raises(OSError) as caught, files.replacing_folder(folder):
        raise OSError(28, "No space left on device")
    assert cli.describe(caught.value).startswith(f"{folder}: the disk is full")
    assert [path.name for path in tmp_path.rglob("*")] == ["frames", "old"]


def test_left_over_of_killed_processes_is_removed(tmp_path):
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    for folder in (f".segment_000.{ended.pid}", f".segment_000.{os.getpid()}", "segment_001"):
        (tmp_path / "frames" / folder).mkdir(parents=True)
    for name in (f".eye.{ended.pid}.vtp", f".eye.{os.getpid()}.vtp", "eye.vtp", ".snakemake_timestamp"):
        (tmp_path / name).touch()
    files.remove_left_over(tmp_path)
    assert sorted(path.name for path in tmp_path.rglob("*")) == sorted([
        "frames", f".segment_000.{os.getpid()}", "segment_001", f".eye.{os.getpid()}.vtp", "eye.vtp",
        ".snakemake_timestamp"])


@pytest.mark.thorough
def test_snakemake_repeats_the_sentence_at_the_end(project):
    (project.folder / "config/scenes/eye.stl").write_text("nothing")
    project.write_scene("broken", "extends: tiny\neye: {model: mesh, path: eye.stl}\n")
    code, output = project.snakemake("outputs/broken/draft/eye.vtp")
    assert code == 1 and "Traceback" not in output
    sentence = "error: config/scenes/eye.stl (eye.path): is a text file, but no STL"
    assert output.count(sentence) == 2 and output.rfind(sentence) > output.rfind("Error in rule eye")


@pytest.mark.thorough
def test_scene_with_a_hyphen_can_be_planned(project):
    project.write_scene("my-eye", "extends: tiny\n")
    code, output = project.snakemake("-n", "outputs/my-eye/draft/movie.mp4")
    assert code == 0, output
