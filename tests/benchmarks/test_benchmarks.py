"""The benchmarks themselves are run by hand; what is written about them has to be what they have measured."""
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def check(folder: Path) -> subprocess.CompletedProcess:
    command = [sys.executable, folder / "benchmarks" / "page.py", "--check"]
    return subprocess.run(command, capture_output=True, text=True)


def test_the_page_of_the_benchmarks_is_that_of_their_tables(tmp_path):
    assert check(ROOT).returncode == 0
    for name in ("benchmarks/page.py", "benchmarks/dam_break/results.csv", "benchmarks/dam_break/sizes.csv",
                 "benchmarks/dam_break/machine.txt", "benchmarks/paper_scenes.csv", "benchmarks/backends.csv",
                 "docs/benchmarks.md"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes((ROOT / name).read_bytes())
    assert check(tmp_path).returncode == 0
    table = tmp_path / "benchmarks" / "dam_break" / "sizes.csv"
    table.write_text(table.read_text().replace(",29791,", ",29792,"))
    stale = check(tmp_path)
    assert stale.returncode == 1
    assert "older than its tables" in stale.stderr


def test_the_page_on_scale_is_that_of_the_measured_sizes():
    scale = runpy.run_path(str(ROOT / "benchmarks" / "scale.py"))
    assert f"{scale['BEGIN']}{scale['tables']()}{scale['END']}" in scale["PAGE"].read_text()
    # Steps per second of tamponade at standard, after the injection.
    assert 1.0 / scale["step_limit"](4e-4) == pytest.approx(250, rel=0.02)
