"""Frames, surfaces and pictures that were deleted or added in the middle of a run are told by what reads them."""
import shutil
from unittest import mock

import numpy as np
import pytest
import pyvista
from conftest import ROOT
from helpers.synthetic_frames import make_frame
from PIL import Image

from pipeline import bodies, frames, metrics, movie, reconstruct, rest
from pipeline.base.errors import UserError
from pipeline.base.frame_files import find_frames, frame_path, frames_of, write_frame
from pipeline.base.sequences import in_sequence, without_others
from pipeline.measures.rest import course_of_coverage
from pipeline.render import render_frames
from pipeline.runs.segments import check_segments
from pipeline.scenes.load import load_scene
from pipeline.surfaces.contour import TriangleMesh
from pipeline.surfaces.saved_frame import frames_with_surfaces
from pipeline.surfaces.surface_files import read_surface, surface_path, write_surface, write_wall


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A run of `tiny`, two segments, as far as names go: frames, surfaces and pictures."""
    folder = tmp_path_factory.mktemp("run")
    scene = load_scene(ROOT / "config/scenes/tiny.yaml", "draft")
    (folder / "scene.json").write_text(scene.to_json())
    for segment, numbers in (("segment_000", (0, 1, 2)), ("segment_001", (3, 4))):
        for number in numbers:
            write_frame(frame_path(folder / "frames" / segment, number), make_frame(time=0.05 * number))
            for kind, suffix, text in (("surfaces", ".json", f'{{"time": {0.05 * number}}}'), ("images", ".png", "")):
                path = frame_path(folder / kind / segment, number, suffix)
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(text)
                if kind == "images":
                    Image.new("RGB", (32, 32)).save(path)
    return folder


@pytest.fixture
def run(whole, tmp_path):
    """A copy of it, which a test spoils."""
    return shutil.copytree(whole, tmp_path / "run")


def segments(run, kind):
    return [str(run / kind / name) for name in ("segment_000", "segment_001")]


READERS = {  # what reads a kind of files: of which it is, and what is called
    "metrics": ("frames", lambda run: metrics.main([str(run / "scene.json"), str(run / "initial.npz"),
                                                    *segments(run, "frames"), "--output", str(run / "m.csv")])),
    "rest": ("frames", lambda run: rest.main([str(run / "scene.json"), str(run / "initial.npz"),
                                              *segments(run, "frames"), "--output", str(run / "r.json")])),
    "frames": ("frames", lambda run: frames.main(["pvd", *segments(run, "frames"), "--output", str(run / "f.pvd")])),
    "index_run": ("frames", lambda run: frames_with_surfaces(segments(run, "frames"), (
        run / "surfaces" / name for name in ("segment_000", "segment_001")))),
    "bodies": ("surfaces", lambda run: bodies.measure(load_scene(ROOT / "config/scenes/tiny.yaml", "draft"),
                                                      segments(run, "surfaces"))),
    "movie": ("images", lambda run: movie.main([*segments(run, "images"), "--output", str(run / "movie.mp4"),
                                                "--scene", str(run / "scene.json")])),
}
SUFFIXES = {"frames": ".vtu", "surfaces": ".json", "images": ".png"}


@pytest.mark.parametrize("missing", [1, 2])
@pytest.mark.parametrize("reader", READERS)
def test_a_file_that_is_missing_between_others_is_told(run, reader, missing, monkeypatch):
    monkeypatch.setattr("pipeline.metrics.load_initial", lambda path: {})
    monkeypatch.setattr("pipeline.rest.load_initial", lambda path: {})
    kind, read = READERS[reader]
    frame_path(run / kind / "segment_000", missing, SUFFIXES[kind]).unlink()
    with pytest.raises(UserError, match=rf"segment_000: frame_0000{missing} is missing among the others; remove the "
                                        r"folder and run the \w+ stage again"):
        read(run)


@pytest.mark.parametrize("reader", ["metrics", "rest", "bodies", "movie"])
def test_the_last_one_is_missed_too_where_the_scene_tells(run, reader, monkeypatch):
    monkeypatch.setattr("pipeline.metrics.load_initial", lambda path: {})
    monkeypatch.setattr("pipeline.rest.load_initial", lambda path: {})
    kind, read = READERS[reader]
    frame_path(run / kind / "segment_001", 4, SUFFIXES[kind]).unlink()
    with pytest.raises(UserError, match="segment_001: frame_00004 is missing"):
        read(run)


@pytest.mark.parametrize("kind", SUFFIXES)
def test_added_files_are_told(run, kind):
    suffix, folder = SUFFIXES[kind], run / kind / "segment_000"
    paths = [run / kind / "segment_000" / f"frame_{number:05d}{suffix}" for number in range(3)]
    shutil.copy(paths[1], folder / f"frame_00001 (copy){suffix}")
    with pytest.raises(UserError, match="is none of the run's files, which are named frame_00000"):
        in_sequence(folder.glob(f"*{suffix}"), "")
    (folder / f"frame_00001 (copy){suffix}").rename(run / kind / "segment_001" / paths[1].name)
    with pytest.raises(UserError, match="is there twice, as "):
        in_sequence((run / kind).glob(f"*/*{suffix}"), "")


def test_frames_are_told_by_folder(run):
    assert [path.stem for path in frames_of(segments(run, "frames"))] == [f"frame_{n:05d}" for n in range(5)]
    shutil.copy(frame_path(run / "frames/segment_000", 2), frame_path(run / "frames/segment_000", 99))
    with pytest.raises(UserError, match="frame_00003, frame_00004, frame_00005 and 93 more are missing"):
        find_frames(run / "frames/segment_000")


def test_surfaces_without_a_frame_are_told(run):
    scene = load_scene(ROOT / "config/scenes/tiny.yaml", "draft")
    shutil.copy(run / "surfaces/segment_000/frame_00002.json", run / "surfaces/segment_000/frame_00003.json")
    frame = run / "frames/segment_000"
    with pytest.raises(UserError, match=r"frame_00003\.json: is of a frame that is missing among the others"):
        render_frames(scene, 5e-6, None, frame, run / "surfaces/segment_000", run / "new")
    with pytest.raises(UserError, match=r"frame_00003"):
        without_others(frame.glob("*.vtu"), (run / "surfaces/segment_000").glob("*.json"), "")


def test_whole_and_longer_runs_are_read(run):
    """A scene that was made shorter reads what is there, and folders of other names are not held against it."""
    scene = load_scene(ROOT / "config/scenes/tiny.yaml", "draft")
    check_segments(scene, frames_of(segments(run, "frames")), "")
    write_frame(frame_path(run / "frames/segment_001", 5), make_frame(time=0.25))
    check_segments(scene, frames_of(segments(run, "frames")), "")
    (run / "frames/segment_000").rename(run / "some")
    check_segments(scene, [run / "some/frame_00001.vtu"], "")


def surfaces_of(run, folder):
    reconstruct.main([str(run / "scene.json"), str(run / "initial.npz"), str(folder), "--output", str(run / "new")])


OTHER_FRAMES = {  # how a stage reads the frames of a folder
    "metrics": lambda scene, run, folder: metrics.measure(scene, {"cavity_volume": 5e-6}, find_frames(folder)),
    "rest": lambda scene, run, folder: course_of_coverage(scene, {}, find_frames(folder)),
    "reconstruct": lambda scene, run, folder: surfaces_of(run, folder),
    "render": lambda scene, run, folder: render_frames(scene, 5e-6, None, folder, run / "surfaces/segment_001",
                                                       run / "new"),
}


@pytest.mark.parametrize("stage", OTHER_FRAMES)
def test_a_frame_under_the_name_of_another_is_told(run, stage, monkeypatch):
    """As after a copy: it is whole, and its checksum fits, but a course over time would stand still or go back."""
    folder = run / "frames/segment_001"
    shutil.copy(folder / "frame_00003.vtu", folder / "frame_00004.vtu")
    monkeypatch.setattr("pipeline.metrics.metrics_of", lambda scene: ())
    monkeypatch.setattr("pipeline.measures.rest.row_of_coverage", lambda state: {})
    for name in ("metrics.Measured", "measures.rest.Measured", "reconstruct.load_initial", "reconstruct.Reconstructor",
                 "reconstruct.write_surfaces", "render.Renderer", "render.read_surfaces", "render.read_section",
                 "render.read_wall", "render.read_retina"):
        monkeypatch.setattr(f"pipeline.{name}", mock.MagicMock())
    monkeypatch.setattr("sim.backend.runtime.initialize", lambda *_, **__: None)  # it may run already, and is not used
    with pytest.raises(UserError, match=r"frame_00004\.vtu: is the frame of 0\.15 s, but the one before it is"):
        OTHER_FRAMES[stage](load_scene(ROOT / "config/scenes/tiny.yaml", "draft"), run, folder)
    assert not (run / "new").exists()


def test_surfaces_under_the_name_of_another_frame_are_told(run, monkeypatch):
    """A picture, a list of bodies and a mesh for other programs would show one time twice."""
    scene, folder = load_scene(ROOT / "config/scenes/tiny.yaml", "draft"), run / "surfaces/segment_001"
    wall, at = pyvista.Sphere(), {"contact_distance": np.zeros(842), "oil_fraction": np.zeros((842, 2))}
    drop = TriangleMesh(np.asarray(wall.points), wall.regular_faces)
    for number in (3, 4):
        name, time = f"frame_{number:05d}", 0.05 * number
        write_surface(surface_path(folder, name, "oil"), drop, time=time, liquid="oil", depth=np.ones(842))
        write_wall(folder / f"{name}_wall.vtp", wall, **at, time=time)
    for file in ("frame_00003_oil.vtp", "frame_00003_wall.vtp"):
        read_surface(folder / file)
        other = folder / file.replace("3", "4")
        shutil.copy(folder / file, other)
        with pytest.raises(UserError, match=rf"{other.name}: is of 0\.15 s, but its frame is that of 0\.2 s, as after "
                                            "a copy .* run the reconstruct stage again"):
            read_surface(other)
    shutil.copy(folder / "frame_00003.json", folder / "frame_00004.json")
    monkeypatch.setattr("pipeline.render.Renderer", mock.MagicMock())
    for name in ("read_surfaces", "read_section", "read_wall", "read_retina"):
        monkeypatch.setattr(f"pipeline.render.{name}", mock.MagicMock())
    with pytest.raises(UserError, match=r"frame_00004\.json: is of 0\.15 s, but its frame is that of 0\.2 s"):
        render_frames(scene, 5e-6, None, run / "frames/segment_001", folder, run / "new")
