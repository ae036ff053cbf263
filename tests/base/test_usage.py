"""What a process says of its frames."""
import json

import pytest

from pipeline.base import usage
from pipeline.base.errors import UserError


@pytest.fixture
def clock(monkeypatch):
    """A process of which each look finds the next of these seconds on the clock, half of them on its cores."""
    def runs(*seconds):
        left = iter(seconds)
        monkeypatch.setattr(usage, "_frames", [])
        monkeypatch.setattr(usage, "usage", lambda: {"wall": (now := next(left)), "cpu": 0.5 * now, "memory": 1e8})
    return runs


def taken(tmp_path, monkeypatch, frames):
    """What is read of a process that has finished so many frames."""
    monkeypatch.setenv(usage.ASKED, str(tmp_path / "usage.json"))
    for _ in range(frames):
        usage.frame_done()
    usage.write_if_asked()
    return usage.read_usage(tmp_path / "usage.json")


def test_the_first_frame_with_which_a_process_loads_what_it_needs_is_no_measure_of_the_others(clock, tmp_path,
                                                                                              monkeypatch):
    clock(6.0, 7.0, 9.0, 12.0)
    assert taken(tmp_path, monkeypatch, 3) == {
        "wall": 12.0, "cpu": 6.0, "memory": 1e8, "frame_wall": 1.5, "frame_cpu": 0.75}


def test_one_frame_tells_nothing_of_the_next(clock, tmp_path, monkeypatch):
    clock(6.0, 12.0)
    assert taken(tmp_path, monkeypatch, 1) == {"wall": 12.0, "cpu": 6.0, "memory": 1e8}


def test_what_is_no_number_is_an_error(tmp_path):
    (tmp_path / "usage.json").write_text(json.dumps({"wall": 1.0, "cpu": 1.0, "memory": 1.0, "frame_cpu": "x"}))
    with pytest.raises(UserError, match="does not hold what a stage took"):
        usage.read_usage(tmp_path / "usage.json")


def test_nothing_is_kept_of_a_process_that_is_not_asked(clock, monkeypatch):
    clock()
    monkeypatch.delenv(usage.ASKED, raising=False)
    usage.frame_done()
    assert usage.of_a_frame() == {}
