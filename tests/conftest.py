"""Fixtures that several test files share."""
import functools
import gc
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import pytest

from pipeline.base.surroundings import refuse_missing_backend
from sim.backend.choice import library

refuse_missing_backend()
from helpers import forked  # noqa: E402  it asks for the same

ROOT = Path(__file__).parents[1]
# Kernels once compiled are kept for all tests, for the stages that these start and for the next run: the library's
# own limit of 100 MB is less than the tests need, and what is over it would be compiled again.
COMPILED = ROOT / ".pytest_cache" / library().name
os.environ.setdefault(library().variable("offline_cache_file_path"), str(COMPILED))
os.environ.setdefault(library().variable("offline_cache_max_size_of_files"), str(2**30))
# Files of tests are taken in this order, else one of them would be left to one process at the end.
LONG_FIRST = ("workflow", "test_tutorials.py", "equilibrium", "solver", "studies", "stages")


# Where all tests are collected:
NOT_FOUND = pytest.StashKey[list[str]]()  # cases that a marker names and no test has
SHORT = pytest.StashKey[set[str]]()  # names of the tests of `./run test`, with their parameters


@pytest.hookimpl(tryfirst=True)  # before -m is looked at
def pytest_collection_modifyitems(config, items):
    """Mark the cases that `thorough_cases` names as thorough, and take the rooms with long tests first."""
    named, found = set(), set()
    for item in items:
        for marker in item.iter_markers("thorough_cases"):
            test, case = item.nodeid.partition("[")[0], item.callspec.id
            named |= {(test, name) for name in marker.args}
            if case in marker.args:
                item.add_marker(pytest.mark.thorough)
                found.add((test, case))
    if config.args_source is config.ArgsSource.TESTPATHS:  # all tests are here
        config.stash[NOT_FOUND] = sorted(f"{test}[{case}]" for test, case in named - found)
        config.stash[SHORT] = {item.name for item in items
                               if not any(map(item.get_closest_marker, ("thorough", "slow")))}

    def place(item) -> int:
        room = item.nodeid.removeprefix("tests/").partition("/")[0]
        return LONG_FIRST.index(room) if room in LONG_FIRST else len(LONG_FIRST)

    items.sort(key=place)


def pytest_collection_finish():
    """Leave all that was imported to itself: looking for solvers that are no longer in use is a matter of ms then."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="module")
def taichi():
    """Return Taichi in double precision, started anew for every file: one start holds 512 groups of fields at most.

    With one thread: for a few hundred particles two cost more than twice as much. That they give the same bits is
    tested.
    """
    from sim.backend import ti
    from sim.backend.runtime import initialize, shut_down

    shut_down()
    initialize("f64", 1)
    return ti


@pytest.fixture
def nothing_planned() -> Iterator[None]:
    """Let no study be known from the folder of another test: a process keeps what it has read."""
    from pipeline.studies import plan

    kept = plan.cached_study, plan.cached_scene, plan.project_materials, plan._scene_text, plan._code_digest
    for one in kept:
        one.cache_clear()
    yield
    for one in kept:
        one.cache_clear()


@pytest.fixture
def anew(taichi) -> None:
    """Start Taichi anew for a test, so that its kernels are those of the last run, whatever was tested before.

    A compiled kernel is found again only where its fields have the same numbers, which count from the start.
    """
    from sim.backend.runtime import restart

    restart()


@pytest.fixture(scope="session")
def can_draw() -> bool:
    """Return whether this machine has OpenGL; asked in a child process, because a missing library is a crash."""
    ask = [sys.executable, "-m", "pipeline.pictures.opengl"]
    return not subprocess.run(ask, cwd=ROOT, capture_output=True).returncode


@pytest.fixture(scope="session")
def opengl(can_draw) -> None:
    """Fail the test on a machine without OpenGL, which `./run test` looks for before."""
    if not can_draw:
        pytest.fail("no OpenGL on this machine: install libosmesa6 (./run test does, or tells how)")


def hear_interrupts() -> None:
    """What a script starts with `&` ignores Ctrl-C, and so would its children."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


class Project:
    """A copy of the project: its own configuration and outputs, the code itself linked."""

    LINKED = ("pipeline", "sim", "studies", "docs")
    COPIED = ("config", "profiles", "rules", "Snakefile")

    def __init__(self, folder: Path):
        self.folder = folder
        folder.mkdir(exist_ok=True)
        for name in self.LINKED:
            (folder / name).symlink_to(ROOT / name)
        for name in self.COPIED:
            copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
            copy(ROOT / name, folder / name)

    def outputs(self, scene: str, level: str = "draft") -> Path:
        """Return the folder of a scene's results at an accuracy level."""
        return self.folder / "outputs" / scene / level

    def write_scene(self, name: str, text: str) -> None:
        """Add or replace a scene."""
        scenes = self.folder / "config" / "scenes"
        next(scenes.glob(f"*/{name}.yaml"), scenes / f"{name}.yaml").write_text(text)

    def own_code(self, package: str) -> Path:
        """Give the project a copy of a package, to be edited; return its folder."""
        folder = self.folder / package
        folder.unlink()
        shutil.copytree(ROOT / package, folder, ignore=shutil.ignore_patterns("__pycache__"))
        return folder

    def start(self, *arguments: str, environment: Mapping[str, str] = os.environ) -> subprocess.Popen:
        """Start Snakemake in a process group of its own; what it prints goes to ``snakemake.log``."""
        with (self.folder / "snakemake.log").open("w") as log:
            return subprocess.Popen([sys.executable, "-m", "snakemake", "-j2", *arguments], cwd=self.folder,
                                    env={**environment, "PYTHONPATH": str(self.folder)}, stdin=subprocess.DEVNULL,
                                    stdout=log, stderr=subprocess.STDOUT, start_new_session=True,
                                    preexec_fn=hear_interrupts)

    def snakemake(self, *arguments: str) -> tuple[int, str]:
        """Run Snakemake to its end; return its exit code and all that it printed."""
        log = self.folder / "snakemake.log"
        code = forked.snakemake(self.folder, arguments, log)
        return code, log.read_text()


@pytest.fixture
def project(tmp_path) -> Project:
    """Return a copy of the project that one test may change and run."""
    return Project(tmp_path)


@pytest.fixture(scope="session")
def circle() -> dict[str, np.ndarray]:
    """Return the arrays of a packed circle of ten spacings."""
    from helpers.cavities import RADIUS, cavity

    from sim.backend.runtime import initialize

    initialize("f64", 1)
    return cavity("circle", RADIUS)


def _bare():
    from helpers.cavities import RADIUS, build, cavity

    solver = build(cavity("circle", RADIUS))
    return solver, solver.state()


@pytest.fixture
def bare(taichi):
    """Return a solver without any effect in the circle, and its state at rest."""
    from helpers.cavities import shared

    return shared(_bare)


@pytest.fixture(scope="session")
def elsewhere(circle, tmp_path_factory):
    """Return a function that advances a case of ``cavities`` in a process of its own and returns its results."""
    folder = tmp_path_factory.mktemp("elsewhere")
    np.savez(folder / "circle.npz", **circle)

    def advanced(precision: str, threads: int, case: str) -> dict[str, np.ndarray]:
        target = folder / f"{precision}_{threads}_{case}.npz"
        subprocess.run([sys.executable, "-m", "helpers.cavities", precision, str(threads), folder / "circle.npz",
                        target, case], env=os.environ | {"PYTHONPATH": f"{ROOT}:{ROOT / 'tests'}"}, check=True)
        return dict(np.load(target))

    return advanced


@pytest.fixture(scope="session")
def single_precision(elsewhere):
    """Return a function that returns the results of a case of ``cavities`` in single precision."""
    return functools.partial(elsewhere, "f32", 0)
