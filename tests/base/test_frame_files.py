"""Frames open in VTK, pyvista and meshio; frames and checkpoints come back as they were written."""
import base64
import io
import os
from types import SimpleNamespace

import meshio
import numpy as np
import pytest
import pyvista
import trimesh
from helpers.synthetic_frames import make_frame

from pipeline import frames as stage
from pipeline.base import files
from pipeline.base import frame_files as frames
from pipeline.base.checksum import LENGTH, DamagedFile, append_checksum
from pipeline.base.errors import UserError
from pipeline.base.files import replacing_folder
from pipeline.base.numpy_files import write_arrays
from pipeline.base.progress import PlainProgress
from pipeline.base.vtk_files import text_of
from pipeline.cavity.initial_state import NAMES, load_initial, save_initial
from pipeline.cavity.surface import read_mesh, write_mesh
from pipeline.simulation.runner import restore, unlike


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


def ends_at_a_padding() -> bool:
    """Whether base64 of this Python does: meshio 5.3 finds the end of an array so. That of 3.13.5 does not."""
    try:
        return base64.b64decode(b"AA==AAAA") == b"\0"
    except ValueError:
        return False


@pytest.mark.skipif(not ends_at_a_padding(), reason="meshio 5.3 reads no VTU with this Python")
def test_meshio_opens_frames_with_names_and_units(tmp_path):
    frame = make_frame()
    path = frames.frame_path(tmp_path, 0)
    frames.write_frame(path, frame)
    mesh = meshio.read(path)
    np.testing.assert_array_equal(mesh.points, frame.position)
    np.testing.assert_array_equal(mesh.point_data["volume_fraction"], frame.volume_fraction)
    np.testing.assert_array_equal(mesh.field_data["gravity"].ravel(), frame.gravity)
    assert bytes(mesh.field_data["liquids"]).decode() == "aqueous\nsilicone_oil_1000"
    assert "velocity: m/s" in bytes(mesh.field_data["units"]).decode()


def test_pyvista_opens_frames_with_names_and_units(tmp_path):
    frame = make_frame()
    path = frames.frame_path(tmp_path, 0)
    frames.write_frame(path, frame)
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
    for segment, allowed in ((0, "segment_000"), (1, "segment_000 to segment_001")):
        frames.write_frame(frames.frame_path(tmp_path / f"segment_{segment:03d}", segment), make_frame())
        with pytest.raises(UserError, match=f"give one of them, {allowed}$"):
            frames.find_frames(tmp_path)
    assert len(frames.find_frames(tmp_path / "segment_001")) == 1


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


@pytest.mark.parametrize("kind", ["frame", "checkpoint", "initial state", "surface"])
def test_every_flipped_bit_is_found_and_named(tmp_path, kind):
    """Of 200 bits anywhere in the file, the last bytes among them."""
    path, read = WRITERS[kind](tmp_path)
    whole, random = path.read_bytes(), np.random.default_rng(1)
    read(path)
    for bit in [*random.integers(0, 8 * len(whole), 200), 8 * len(whole) - 1, 0]:
        spoiled = bytearray(whole)
        spoiled[bit // 8] ^= 1 << bit % 8
        path.write_bytes(spoiled)
        with pytest.raises(DamagedFile, match=f"^{path}: is damaged"):
            read(path)


def _written_frame(folder):
    frames.write_frame(frames.frame_path(folder, 0), make_frame())
    return frames.frame_path(folder, 0), frames.read_frame


def _written_checkpoint(folder):
    frames.save_checkpoint(folder / "segment_000.npz", {"position": np.arange(30.0), "time": 0.5})
    return folder / "segment_000.npz", frames.load_checkpoint


def _written_initial_state(folder):
    save_initial(folder / "initial.npz", dict.fromkeys(NAMES, 0.0))
    return folder / "initial.npz", load_initial


def _written_surface(folder):
    write_mesh(trimesh.creation.icosphere(1), folder / "eye.vtp")
    return folder / "eye.vtp", read_mesh


WRITERS = {"frame": _written_frame, "checkpoint": _written_checkpoint, "initial state": _written_initial_state,
           "surface": _written_surface}


def test_equal_states_make_equal_files(tmp_path):
    for kind, write in WRITERS.items():
        contents = []
        for name in ("one", "other"):
            (tmp_path / kind / name).mkdir(parents=True)
            contents.append(write(tmp_path / kind / name)[0].read_bytes())
        assert contents[0] == contents[1], kind


def test_no_file_of_a_run_can_run_code(tmp_path):
    """Objects in an archive of NumPy are Python's own format, which runs what it is told to."""
    class Harm:
        def __reduce__(self):
            return (tmp_path / "harm").touch, ()

    path = tmp_path / "checkpoint.npz"
    write_arrays(path, {"position": np.array([Harm()], dtype=object)})
    with pytest.raises(DamagedFile, match="allow_pickle"):
        frames.load_checkpoint(path)
    assert not (tmp_path / "harm").exists()


def test_a_file_is_on_the_disk_before_it_gets_its_name(tmp_path, monkeypatch):
    """Else a loss of power may leave an empty file of that name; `benchmarks/faults/power_loss.py` takes it away."""
    done = []

    def record(name, what):
        function = getattr(os, name)
        monkeypatch.setattr(files.os, name, lambda *given: (done.append(what(*given)), function(*given))[1])

    record("fsync", lambda descriptor: ("disk", os.readlink(f"/proc/self/fd/{descriptor}").rpartition("/")[2]))
    record("replace", lambda old, new: ("rename", str(new).rpartition("/")[2]))
    files.write_text(tmp_path / "table.csv", "1")
    assert done == [("disk", f".table.{os.getpid()}.csv"), ("rename", "table.csv"), ("disk", tmp_path.name)]
    done.clear()
    with files.replacing_folder(tmp_path / "frames") as folder:
        (folder / "one").touch()
    temporary = f".frames.{os.getpid()}"
    assert done == [("disk", "one"), ("disk", temporary), ("rename", "frames"), ("disk", tmp_path.name)]


STATE = {"particles.id": np.arange(4), "particles.position": np.arange(12.0).reshape(4, 3), "time": 0.5,
         "particles.acceleration": np.zeros((4, 3)), "scheme.wall_compression_rest": np.ones(7)}


@pytest.mark.parametrize(("name", "place", "value", "reason"), [
    ("particles.acceleration", (2, 1), np.nan, "particles.acceleration is not finite at particle 2"),
    ("scheme.wall_compression_rest", 3, np.inf, "scheme.wall_compression_rest is not finite at place 3"),
    ("particles.position", 3, [3.0, 4.0, 5.0], "particles 1 and 3 are at one place"),
    ("particles.id", 3, 0, "particles 0 and 0 have one number"),
    ("particles.acceleration", None, np.zeros((3, 3)), r"of the shape \(3, 3\), but must have the shape \(4, 3\)"),
    ("scheme.wall_compression_rest", None, np.array(["x"] * 7), "is <U1 of the shape"),
])
def test_what_no_run_leaves_in_a_checkpoint_is_named(tmp_path, name, place, value, reason):
    state = {key: np.copy(values) for key, values in STATE.items()}
    assert unlike(state, STATE) == ""
    if place is None:
        state[name] = value
    else:
        state[name][place] = value
    runner = SimpleNamespace(solver=SimpleNamespace(state=lambda: STATE))
    with pytest.raises(UserError, match=reason) as caught:
        restore(runner, state, tmp_path / "segment_000.npz", begins=False)
    assert str(caught.value).startswith(f"{tmp_path}/segment_000.npz: is no checkpoint that this scene can start from")


@pytest.mark.parametrize("suffix", frames.FRAME_SUFFIXES)
@pytest.mark.parametrize(("before", "after", "reason"), [
    (b'NumberOfPoints="100"', b'NumberOfPoints="99999999999999999999"', "larger than the file"),
    (b'NumberOfPoints="100"', b'NumberOfPoints="-1"', "larger than the file"),
    (b'NumberOfPoints="100"', b'NumberOfPoints="99"', "another size than its head says"),
    (b'NumberOfPoints="100"', b'NumberOfPoints="1e308"', "invalid literal"),
    (b'type="Float64" Name="pressure"', b'type="Float32" Name="pressure"', "pressure has another size"),
    (b'Name="liquids"', b'Name="solids"', "without liquids"),
    (b'NumberOfComponents="3"', b'NumberOfComponents="0"', "larger than the file"),
    (b'offset="0"', b'offset="-9999"', "larger than the file"),
    (b'encoding="raw"', b'encoding="base64"', "no head of VTK"),
    (b"<VTKFile", b'<!DOCTYPE a [<!ENTITY b "bb">]><VTKFile', "no head of VTK"),
    (b"<FieldData>", b"<Field>", "mismatched tag"),
])
def test_a_frame_that_was_forged_is_a_sentence(tmp_path, suffix, before, after, reason):
    """With a checksum that fits: the reader of VTK crashed on the first of them."""
    path = frames.frame_path(tmp_path, 0, suffix)
    frames.write_frame(path, make_frame(count=100))
    content = path.read_bytes()[:-LENGTH]
    assert before in content
    path.write_bytes(content.replace(before, after, 1))
    append_checksum(path)
    with pytest.raises(UserError, match=f"^{path}: is no frame of this pipeline .*{reason}.*; run its segment again$"):
        frames.read_frame(path)


def test_a_checkpoint_that_was_forged_allocates_nothing(tmp_path):
    path = tmp_path / "checkpoint.npz"
    frames.save_checkpoint(path, {"position": np.arange(1000.0)})
    content = path.read_bytes()[:-LENGTH]
    path.write_bytes(content.replace(b"(1000,), }    ", b"(99999999,), }"))
    append_checksum(path)
    with pytest.raises(DamagedFile, match="larger than the file"):
        frames.load_checkpoint(path)


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
