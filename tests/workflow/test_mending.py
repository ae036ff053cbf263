"""Damaged files make way for new ones, dates of a wrong clock are put right, and a disk without locks will do."""
import errno
import fcntl
import os
import time

import numpy as np
import pytest
from helpers.snakemake_output import TRACE
from helpers.synthetic_frames import make_frame

from pipeline.base.frame_files import frame_path, save_checkpoint, write_frame
from pipeline.workflow.mending import changes, end_future, hold, logs_below, set_aside_damaged


def flip(path, place=-200):
    content = bytearray(path.read_bytes())
    content[place] ^= 1
    path.write_bytes(content)


def test_damaged_files_are_set_aside_as_snakemake_knows_them(tmp_path):
    frames = tmp_path / "frames" / "segment_000"
    for number in range(2):
        write_frame(frame_path(frames, number), make_frame())
    for segment in range(3):
        save_checkpoint(tmp_path / "checkpoints" / f"segment_{segment:03d}.npz", {"time": np.arange(9.0)})
    files = [frame_path(frames, 1), *sorted((tmp_path / "checkpoints").iterdir())]
    for path in (files[0], files[1], files[3]):
        flip(path)
    told = [f"{path}: is damaged" for path in files[:3]] + ["scene.json: is no scene", f"{frames}: no frames"]
    moved = set_aside_damaged(tmp_path, told)
    assert len(moved) == 2 and moved[1].startswith(f"{frames}: is set aside as {tmp_path}/damaged/frames/segment_000")
    assert sorted(path.name for path in (tmp_path / "checkpoints").iterdir()) == ["segment_001.npz", "segment_002.npz"]
    assert len(list((tmp_path / "damaged/frames/segment_000").iterdir())) == 2 and not frames.exists()


@pytest.mark.thorough
def test_a_run_makes_a_damaged_file_anew(project):
    """What stops the run is one sentence; the same command then goes on."""
    eye = project.outputs("tiny") / "eye.vtp"
    code, output = project.snakemake("outputs/tiny/draft/eye.vtp")
    assert code == 0, output
    whole = eye.read_bytes()
    flip(eye)
    code, output = project.snakemake("outputs/tiny/draft/initial.npz")
    assert code == 1 and TRACE not in output
    assert "error: outputs/tiny/draft/eye.vtp: is damaged (it differs from its checksum" in output
    assert "outputs/tiny/draft/eye.vtp: is set aside as outputs/tiny/draft/damaged/eye.vtp" in output
    code, output = project.snakemake("outputs/tiny/draft/eye.vtp")
    assert code == 0, output
    assert eye.read_bytes() == whole


def test_dates_in_the_future_end(tmp_path):
    now = time.time()
    for name, date in (("old", now - 1e6), ("ahead", now + 1e6)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "file").touch()
        os.utime(tmp_path / name / "file", (date, date))
    end_future(tmp_path)
    assert (tmp_path / "old/file").stat().st_mtime == pytest.approx(now - 1e6)
    assert now - 1.0 <= (tmp_path / "ahead/file").stat().st_mtime <= time.time() + 1.0


def test_logs_of_scenes_and_studies_are_known(tmp_path):
    logs = {tmp_path / name for name in ("logs/software.log", "eye/logs/compare_draft_fine.log",
                                         "eye/draft/logs/eye.log", "studies/validation/draft/logs/couette-2.log")}
    for log in logs:
        log.parent.mkdir(parents=True)
        log.touch()
    assert set(logs_below(tmp_path)) == logs


def test_logs_written_under_a_clock_that_was_put_back_are_seen(tmp_path):
    log = tmp_path / "eye.log"
    log.write_text("before")
    before = changes([log])
    log.write_text("afterwards")
    os.utime(log, (1.0, 1.0))
    assert changes([log]) != before and changes([log]) == changes([log])


@pytest.mark.parametrize("code", [errno.ENOLCK, errno.EOPNOTSUPP])
def test_a_disk_without_locks_is_told(tmp_path, monkeypatch, capsys, code):
    def refuse(*_):
        raise OSError(code, os.strerror(code))
    monkeypatch.setattr(fcntl, "flock", refuse)
    os.close(hold(tmp_path))
    assert "this disk has no locks" in capsys.readouterr().out


def test_a_folder_is_held_once(tmp_path):
    held = hold(tmp_path)
    with pytest.raises(BlockingIOError):
        hold(tmp_path)
    os.close(held)
    os.close(hold(tmp_path))
