"""What ./run does on computers of other kinds, which stand-ins for `uname` and Python make of this one."""
import hashlib
import math
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import psutil  # noqa: F401  before the platform is said to be another
import pytest
from conftest import ROOT

from pipeline.base.computer import computer
from pipeline.base.files import remove_left_over
from pipeline.base.usage import usage
from sim.cores import available_cores

TOOLS = ("bash", "cat", "dirname", "env", "grep", "id", "mkdir", "rm", "touch")
LINUX = ("flock", "sha256sum")  # that macOS does not have


class Computer:
    """A folder with ./run, and a PATH on which nothing is but what a computer has."""

    def __init__(self, folder, system, machine):
        self.folder, self.bin, self.called = folder / "project", folder / "bin", folder / "called"
        self.folder.mkdir()
        self.bin.mkdir()
        shutil.copy(ROOT / "run", self.folder)
        for name in ("pyproject.toml", "requirements.txt"):
            (self.folder / name).write_text(name)
        for name in (*TOOLS, *(() if system == "Darwin" else LINUX)):
            (self.bin / name).symlink_to(shutil.which(name))
        self.command("uname", f'[ "$1" = -m ] && echo {machine} || echo {system}')
        if system == "Darwin":
            self.command("shasum", f'[ "$1 $2" = "-a 256" ] && exec {shutil.which("sha256sum")}')
        for name in ("apt-get", "brew", "sudo"):
            self.command(name, f'echo {name} "$@" >>{self.called}; exit 1')

    def command(self, name, script, folder=None):
        """Add a command."""
        path = (folder or self.bin) / name
        path.write_text(f"#!{shutil.which('sh')}\n{script}\n")
        path.chmod(0o755)

    def python(self, name, version):
        """Add a Python that says to be of a version."""
        said = f"import sys; sys.version_info = ({version.replace('.', ', ')}, 0); exec(sys.argv[1])"
        self.command(name, f"[ \"$1\" = -c ] && exec {sys.executable} -c '{said}' \"$2\"")

    def run(self, *arguments, **environment):
        """Call ./run; return its code and what it said."""
        done = subprocess.run([self.folder / "run", *arguments], capture_output=True, text=True, env={
            "PATH": str(self.bin), "HOME": str(self.folder), "USER": "somebody", **environment})
        return done.returncode, done.stdout + done.stderr

    def calls(self):
        """Return the package managers that were called."""
        return self.called.read_text() if self.called.exists() else ""


REFUSED = {
    ("Linux", "aarch64"): "error: this is Linux on ARM (aarch64), for which Taichi has no wheel; take Linux on x86-64",
    ("Linux", "armv7l"): "error: this is Linux on ARM (armv7l)",
    ("Linux", "riscv64"): "error: this is Linux on riscv64, for which Taichi has no wheel",
    ("Darwin", "x86_64"): "error: this is macOS on x86_64, for which Taichi has no wheel; take a Mac with Apple",
    ("MINGW64_NT-10.0", "x86_64"): "error: this is Windows; run it in WSL",
}


@pytest.mark.parametrize("kind", REFUSED)
def test_computers_without_a_wheel_of_taichi_are_refused_in_a_sentence(tmp_path, kind):
    computer = Computer(tmp_path, *kind)
    computer.python("python3", "3.13")
    code, said = computer.run()
    assert code == 1 and said.count("\n") == 1 and said.startswith(REFUSED[kind])
    assert not computer.calls() and not (computer.folder / ".venv").exists()
    assert computer.run("--help")[0] == 0


@pytest.mark.parametrize("python", [None, "3.9", "3.14"])
def test_a_mac_without_a_python_is_told_the_line_for_brew(tmp_path, python):
    computer = Computer(tmp_path, "Darwin", "arm64")
    if python:
        computer.python("python3", python)
    code, said = computer.run()
    assert code == 1 and said.count("\n") == 1 and said.endswith("; please run: brew install python@3.13\n")
    assert (f"python3 is {python}" in said) == bool(python) and "apt-get" not in said and not computer.calls()


@pytest.mark.parametrize("python", ["3.10", "3.14"])
def test_a_python_without_a_wheel_is_told(tmp_path, python):
    """Debian's packages would not help: its python3 is this one."""
    computer = Computer(tmp_path, "Linux", "x86_64")
    computer.python("python3", python)
    code, said = computer.run()
    assert code == 1 and said.count("\n") == 1 and not computer.calls()
    assert "Python 3.11, 3.12 or 3.13 is needed, for which Taichi has wheels, and python3 is " + python in said


def test_a_python_that_is_named_is_not_passed_over(tmp_path):
    computer = Computer(tmp_path, "Linux", "x86_64")
    computer.python("python3", "3.13")
    computer.python("mine", "3.14")
    code, said = computer.run(PYTHON="mine")
    assert code == 1 and "and mine is 3.14" in said and not (computer.folder / ".venv").exists()


@pytest.mark.parametrize("system", ["Darwin", "Linux"])
def test_an_environment_that_is_there_is_used(tmp_path, system):
    """On a Mac without the commands that it lacks, and without a word on packages of Debian."""
    computer = Computer(tmp_path, system, {"Darwin": "arm64", "Linux": "x86_64"}[system])
    (computer.folder / ".venv/bin").mkdir(parents=True)
    started = tmp_path / "started"
    computer.command("python", f'echo "$@" >>{started}', computer.folder / ".venv/bin")
    wanted = hashlib.sha256(b"pyproject.tomlrequirements.txt").hexdigest()
    (computer.folder / ".venv/installed").write_text(f"{wanted}  -\n")
    code, said = computer.run("tiny")
    assert (code, said) == (0, ""), said
    calls = started.read_text().splitlines()
    assert calls[-1] == "-m pipeline.workflow.start -j2 tiny" and "-m pipeline.pictures.opengl" in calls
    assert ("libX11" in started.read_text()) == (system == "Linux")
    assert not computer.calls()


@pytest.mark.skipif(os.geteuid() != 0, reason="others than root are told the line, see ./run")
def test_debian_installs_a_python_where_there_is_none(tmp_path):
    computer = Computer(tmp_path, "Linux", "x86_64")
    code, said = computer.run()
    assert code == 1 and "apt-get install -y -q --no-install-recommends python3 python3-venv" in computer.calls()
    assert "please run: sudo apt-get install -y python3 python3-venv" in said


def test_what_linux_alone_tells_is_not_needed(monkeypatch):
    """As on a Mac, where processes are bound to no cores and /proc is not there."""
    monkeypatch.setattr("sys.platform", "darwin")
    monkeypatch.delattr("os.sched_getaffinity", raising=False)
    monkeypatch.setattr("pipeline.base.computer.subprocess.run", lambda *_, **__: SimpleNamespace(stdout="Apple M2\n"))
    monkeypatch.setattr(Path, "read_text", lambda *_, **__: pytest.fail("a file of Linux was read"))
    monkeypatch.setattr("sim.cores.granted_cores", lambda: math.inf)
    monkeypatch.setattr("pipeline.base.computer.memory_of_computer", lambda: 2.0**34)
    taken = usage()
    assert taken["cpu"] > 0.0 and 0.0 < taken["wall"] < 1e5
    assert available_cores() == os.cpu_count()
    assert computer().startswith("Apple M2, ") and "16 GiB" in computer()


def test_only_what_ended_processes_left_half_written_is_removed(tmp_path):
    ended = subprocess.Popen(["true"])
    ended.wait()
    names = {process: tmp_path / f".frame.{process}.vtu" for process in (ended.pid, os.getpid(), 1)}
    for path in names.values():
        path.touch()
    remove_left_over(tmp_path)
    assert {process for process, path in names.items() if path.exists()} == {os.getpid(), 1}
