"""Fixtures that several test files share."""
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="session")
def taichi():
    """Return Taichi in double precision, started once per process; another precision needs a process of its own."""
    import taichi as ti

    from sim.runtime import initialize

    initialize("f64")
    return ti


@pytest.fixture(scope="session")
def opengl() -> None:
    """Skip the test on a machine that cannot draw; asked in a child process, because a missing library is a crash."""
    check = subprocess.run([sys.executable, "-m", "pipeline.opengl"], cwd=ROOT, capture_output=True, text=True)
    if check.returncode:
        pytest.skip(f"no OpenGL: {check.stderr.strip().splitlines()[-1:]}")


class Project:
    """A copy of the project in a temporary folder: its own configuration and outputs, the code itself linked."""

    LINKED = ("pipeline", "sim", "docs")
    COPIED = ("config", "profiles", "Snakefile")

    def __init__(self, folder: Path):
        self.folder = folder
        for name in self.LINKED:
            (folder / name).symlink_to(ROOT / name)
        for name in self.COPIED:
            copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
            copy(ROOT / name, folder / name)

    def command(self, *arguments: str) -> list[str]:
        return [sys.executable, "-m", "snakemake", "-j2", *arguments]

    def snakemake(self, *arguments: str) -> subprocess.CompletedProcess:
        """Run Snakemake in the copy; its exit code and all that it printed."""
        return subprocess.run(self.command(*arguments), cwd=self.folder, env=self.environment(), text=True,
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT)

    def environment(self) -> dict[str, str]:
        return os.environ | {"PYTHONPATH": str(self.folder)}

    def write_scene(self, name: str, text: str) -> None:
        (self.folder / "config" / "scenes" / f"{name}.yaml").write_text(text)


@pytest.fixture
def project(tmp_path) -> Project:
    """Return a copy of the project that a test may change and run."""
    return Project(tmp_path)
