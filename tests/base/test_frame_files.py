"""Frames open in VTK, pyvista and meshio; frames and checkpoints come back as they were written."""
import io

import meshio
import numpy as np
import pytest
import pyvista
from synthetic_frames import make_frame

from pipeline import frames as stage
from pipeline.base import frame_files as frames
from pipeline.base.errors import UserError
from pipeline.base.files import replacing_folder
from pipeline.base.progress import PlainProgress
from pipeline.base.vtk_files import text_of


def assert_same(one, other):
    for field in frames.dataclasses.fields(one):
        a, b = getattr(one, field.name), getattr(other, field.name)
        if isinstance(a, dict):
            assert a.keys() == b.keys()
            for key in a:
                np.testing.assert_array_equal(a[key], b[key], err_msg=key)
        else:
            np.testing.assert_array_equal(a, b, err_msg=field.name)


@pytest.mark.parametrize("suffix", frames.FRAME_SUFFIXES)
@pytest.mark.parametrize("options", [{}, {"dimension": 2}, {"liquids": ("water",)}, {"count": 0}])
def test_frame_round_trip(tmp_path, suffix, options):
    frame = make_frame(**options)
    path = frames.frame_path(tmp_path, 3, suffix)
    frames.write_frame(path, frame)
    assert_same(frame, frames.read_frame(path))
    assert [p.name for p in tmp_path.iterdir()] == [f"frame_00003{suffix}"]


def test_meshio_and_pyvista_open_frames_with_names_and_units(tmp_path):
    frame = make_frame()
    path = frames.frame_path(tmp_path, 0)
    frames.write_frame(path, frame)

    mesh = meshio.read(path)
    np.testing.assert_array_equal(mesh.points, frame.position)
    np.testing.assert_array_equal(mesh.point_data["volume_fraction"], frame.volume_fraction)
    np.testing.assert_array_equal(mesh.field_data["gravity"].ravel(), frame.gravity)
    assert bytes(mesh.field_data["liquids"]).decode() == "aqueous\nsilicone_oil_1000"
    assert "velocity: m/s" in bytes(mesh.field_data["units"]).decode()

    grid = pyvista.read(path)
    assert grid.n_cells == grid.n_points == len(frame.position)
    assert grid.field_data["time"][0] == frame.time
    array = grid.GetPointData().GetArray("volume_fraction")
    assert [array.GetComponentName(i) for i in range(2)] == list(frame.liquids)
    velocity = grid.GetPointData().GetArray("velocity")
    assert velocity.GetInformation().Get(type(velocity).UNITS_LABEL()) == "m/s"
    assert [velocity.GetComponentName(i) for i in range(3)] == ["X", "Y", "Z"]
    assert text_of(grid, "liquids").split("\n") == list(frame.liquids)


def test_pvd_lists_all_segments_in_time(tmp_path):
    for segment, times in enumerate([(0.0, 0.1), (0.2,)]):
        for index, time in enumerate(times):
            frames.write_frame(frames.frame_path(tmp_path / f"segment_{segment:03d}", 2 * segment + index),
                               make_frame(time=time))
    stage.main(["pvd", str(tmp_path / "segment_001"), str(tmp_path / "segment_000"),
                 "--output", str(tmp_path / "frames.pvd")])
    reader = pyvista.PVDReader(tmp_path / "frames.pvd")
    assert reader.time_values == [0.0, 0.1, 0.2]
    reader.set_active_time_value(0.2)
    assert reader.read()[0].field_data["time"][0] == 0.2


@pytest.mark.parametrize("keep", [0, 200, -100])
def test_damaged_files_are_named(tmp_path, keep):
    path = frames.frame_path(tmp_path, 0)
    frames.write_frame(path, make_frame())
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(UserError, match=r"frame_00000.vtu: is damaged"):
        frames.read_frame(path)


def test_missing_frames_are_named(tmp_path):
    with pytest.raises(UserError, match="no such frame"):
        frames.read_frame(tmp_path / "frame_00000.vtu")
    with pytest.raises(UserError, match="no frames"):
        frames.find_frames(tmp_path)


def test_checkpoint_keeps_every_bit(tmp_path):
    state = {"position": np.array([[1 / 3, np.nan], [-0.0, np.inf]], np.float32), "time": 0.1 + 0.2, "step": 2**40,
             "scene": "demo", "flag": np.array([True, False]), "empty": np.zeros((0, 3)), "precise": np.float32(1 / 3)}
    frames.save_checkpoint(tmp_path / "checkpoint.npz", state)
    back = frames.load_checkpoint(tmp_path / "checkpoint.npz")
    assert back.keys() == state.keys()
    for name, value in state.items():
        assert np.asarray(value).dtype == np.asarray(back[name]).dtype
        assert np.asarray(value).tobytes() == np.asarray(back[name]).tobytes(), name


def test_checkpoint_errors_are_sentences(tmp_path):
    path = tmp_path / "checkpoint.npz"
    with pytest.raises(UserError, match="no such checkpoint"):
        frames.load_checkpoint(path)
    frames.save_checkpoint(path, {"position": np.arange(1000.0)})
    whole = path.read_bytes()
    for damaged in (b"", whole[:-50], whole[:300], whole[:500] + b"x" + whole[501:]):
        path.write_bytes(damaged)
        with pytest.raises(UserError, match="is damaged"):
            frames.load_checkpoint(path)
    with pytest.raises(TypeError, match="'state'"):
        frames.save_checkpoint(path, {"state": None})


def test_failed_write_leaves_the_old_folder(tmp_path):
    (tmp_path / "frames").mkdir()
    (tmp_path / "frames" / "old").touch()
    with pytest.raises(RuntimeError), replacing_folder(tmp_path / "frames") as partial:
        (partial / "new").touch()
        raise RuntimeError
    assert [p.name for p in tmp_path.rglob("*")] == ["frames", "old"]
    with replacing_folder(tmp_path / "frames") as partial:
        (partial / "new").touch()
    assert [p.name for p in tmp_path.rglob("*")] == ["frames", "new"]


def test_plain_progress_ends_with_the_total():
    stream = io.StringIO()
    bar = PlainProgress(4, "simulate", stream=stream, interval=0.0)
    for _ in range(4):
        bar.update()
    lines = stream.getvalue().splitlines()
    assert len(lines) == 4 and lines[-1].startswith("simulate: 4/4 frames")
