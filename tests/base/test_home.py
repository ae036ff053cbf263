"""A home that cannot be written stops no stage, and not the command `eye-oil`."""
import os
import subprocess
import sys

import pytest
from conftest import ROOT

from sim.backend.choice import library

OWN = ("XDG_CACHE_HOME", "USER", "LOGNAME", library().variable("offline_cache_file_path"))
SHOW = "import os; run(lambda: print(os.environ['XDG_CACHE_HOME'], os.environ['USER']))"

TAICHI = """
def main():
    from sim.backend import ti
    from sim.backend.runtime import initialize
    initialize("f32", 1, "cpu")
    ti.field(int, 3).fill(1)
run(main)
"""


def run_without_home(tmp_path, code: str, **environment: str) -> subprocess.CompletedProcess:
    """Run Python where the home is no folder: even root cannot write there."""
    kept = {name: value for name, value in os.environ.items() if name not in OWN}
    return subprocess.run([sys.executable, "-c", f"from pipeline.base.cli import run\n{code}"], cwd=ROOT,
                          capture_output=True, text=True,
                          env=kept | {"HOME": "/dev/null", "TMPDIR": str(tmp_path)} | environment)


def test_caches_are_kept_elsewhere_for_this_user_alone(tmp_path):
    for _ in range(2):
        done = run_without_home(tmp_path, SHOW)
        assert done.stdout.split() == [f"{tmp_path}/eye-oil-pipeline-{os.getuid()}", str(os.getuid())], done.stderr
    assert (tmp_path / f"eye-oil-pipeline-{os.getuid()}").stat().st_mode & 0o777 == 0o700


def test_a_cache_that_can_be_written_stays(tmp_path):
    done = run_without_home(tmp_path, SHOW, XDG_CACHE_HOME=str(tmp_path / "mine"), USER="ada")
    assert done.stdout.split() == [str(tmp_path / "mine"), "ada"] and (tmp_path / "mine").is_dir()


@pytest.mark.thorough
def test_taichi_runs_without_a_home(tmp_path):
    """It crashed at its end, when it could not keep what it had compiled."""
    done = run_without_home(tmp_path, TAICHI)
    assert done.returncode == 0, done.stderr
    assert list((tmp_path / f"eye-oil-pipeline-{os.getuid()}" / library().word.lower()).rglob("*.*"))
