"""Which library compiles the kernels, and what is said of one that is not there."""
import importlib.util
import os
import subprocess
import sys

import pytest
from conftest import ROOT

from sim.backend import choice
from sim.backend.choice import DEFAULT, LIBRARIES, VARIABLE, NoBackend, backend_version, chosen


@pytest.fixture
def only_default(monkeypatch):
    """Let no library be installed but the default one."""
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: name == LIBRARIES[DEFAULT].module or None)


@pytest.mark.parametrize(("name", "sentence"), [
    ("quadrant", 'EYE_OIL_BACKEND is "quadrant", but must be one of taichi, quadrants, taichi-forge (did you mean '
                 "quadrants?)"),
    ("Taichi_Forge", 'EYE_OIL_BACKEND is "Taichi_Forge", but must be one of taichi, quadrants, taichi-forge (did you '
                     "mean taichi-forge?)"),
    ("jax", 'EYE_OIL_BACKEND is "jax", but must be one of taichi, quadrants, taichi-forge'),
    ("quadrants", f"EYE_OIL_BACKEND is quadrants, which is not installed here; install it by `{sys.executable} -m pip "
                  "install quadrants==1.3.3`, or take taichi"),
])
def test_a_library_that_is_not_there_is_one_sentence(only_default, name, sentence):
    with pytest.raises(NoBackend) as caught:
        chosen(name)
    assert str(caught.value) == sentence


def test_the_environment_names_another_one(monkeypatch):
    for value, expected in ((None, DEFAULT), ("", DEFAULT), ("taichi-forge", "taichi-forge")):
        choice.library.cache_clear()
        monkeypatch.setattr(choice.Library, "is_installed", lambda library: True)
        monkeypatch.delenv(VARIABLE, raising=False)
        if value is not None:
            monkeypatch.setenv(VARIABLE, value)
        assert choice.library().name == expected
    choice.library.cache_clear()


def test_every_stage_ends_in_the_sentence():
    done = subprocess.run([sys.executable, "-m", "pipeline.movie", "--help"], cwd=ROOT, capture_output=True, text=True,
                          env=os.environ | {VARIABLE: "quadrans"})
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == ('error: EYE_OIL_BACKEND is "quadrans", but must be one of taichi, quadrants, taichi-forge '
                           "(did you mean quadrants?)\n")


def test_settings_for_other_programs_of_the_library_change_nothing():
    """They gave other results in silence, a traceback or a crash."""
    code = ("from sim.backend import runtime, private\nruntime.initialize()\nconfig = private.current_config()\n"
            "print(config.fast_math, config.debug, config.advanced_optimization, runtime.device())")
    said = {subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True,
                           env=os.environ | settings).stdout
            for settings in ({}, {choice.library().variable(name): value for name, value in (
                ("arch", "vulkan"), ("fast_math", "0"), ("debug", "1"), ("advanced_optimization", "0"))})}
    assert len(said) == 1


def test_version_is_that_of_the_package():
    """As it is installed, not as it was last tried."""
    name, version = backend_version().split()
    assert name == choice.library().name and version.count(".") >= 2
    assert sys.modules.get(choice.library().module) is None or version.startswith(
        ".".join(map(str, sys.modules[choice.library().module].__version__)))


def test_asking_for_devices_imports_no_library():
    """It takes half a second; nor does it need one to tell its version."""
    code = ("import sys\nimport sim.backend.devices, pipeline.base.digest\n"
            f"print({ {one.module for one in LIBRARIES.values()}!r} & sys.modules.keys())")
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"
