"""Devices: which one is taken, what is refused, and that Vulkan computes what the CPU computes."""
import ctypes
import os
import subprocess
import sys

import numpy as np
import pytest
from cavities import SPACING, part
from conftest import ROOT
from on_device import HEIGHT, STEPS

from pipeline import devices as chosen
from pipeline import workflow
from pipeline.errors import UserError
from pipeline.scene import load_scene
from sim import devices
from sim.devices import ABSENT, SHORT

# What is taken, and what is refused


@pytest.fixture
def here(monkeypatch):
    """Return a function that says what trials of devices come to (0 where one can be used), and of a driver."""
    def there(driver: bool = False, **codes: int) -> None:
        monkeypatch.setattr(devices, "_trial", lambda device: codes.get(device, ABSENT))
        monkeypatch.setattr(ctypes, "CDLL", lambda name: None if driver else ctypes.cdll.LoadLibrary("no such file"))
    return there


@pytest.mark.parametrize(("found", "expected"), [
    ({}, "cpu"), ({"vulkan": 0, "metal": 0}, "cpu"), ({"driver": True}, "cpu"), ({"driver": True, "cuda": SHORT}, "cpu"),
    ({"driver": True, "cuda": 0, "vulkan": 0}, "cuda")])
def test_auto_takes_cuda_or_the_cpu(here, found, expected):
    here(**found)
    assert chosen.checked_device("auto", "--device") == expected


@pytest.mark.parametrize(("device", "precision", "sentence"), [
    ("gpu", "f32", 'is "gpu", but must be one of auto, cpu, cuda, vulkan, metal'),
    (True, "f32", "is true, but must be one of auto, cpu, cuda, vulkan, metal"),
    ("cuda", "f32", "is cuda, but Taichi finds no such device here; here it may be auto, cpu, vulkan"),
    ("metal", "f32", "is metal, but it cannot add in double precision, as the solver has to; here it may be auto, cpu, "
                     "vulkan"),
    ("vulkan", "f64", "is vulkan, but it has powers and exponentials in single precision only, and the precision asked "
                      "for is f64; here it may be auto, cpu"),
])
def test_what_cannot_run_the_solver_is_refused(here, device, precision, sentence):
    here(metal=1, vulkan=0)
    with pytest.raises(UserError) as caught:
        chosen.checked_device(device, "scene.json: numerics.device", precision)
    assert str(caught.value) == f"scene.json: numerics.device {sentence}"


def test_vulkan_that_ends_long_loops_is_refused(here):
    here(vulkan=SHORT)
    with pytest.raises(UserError, match="^--device is vulkan, but it ends long loops early, as Vulkan"):
        chosen.checked_device("vulkan", "--device")


def test_taichi_does_not_fall_back_to_the_cpu():
    code = ("from sim.runtime import NoDevice, device, initialize\n"
            "try:\n    initialize('f32', 1, 'metal')\nexcept NoDevice as error:\n    print(error)\n"
            "initialize('f32')\nprint(device())")
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-2:] == ["Taichi finds no device metal", "cpu"]


@pytest.mark.parametrize(("device", "stage"), [
    ("metal", ["simulate", "scene.json", "initial.npz", "--frames", "frames", "--checkpoint", "end.npz"]),
    ("gpu", ["voxelize", "scene.json", "eye.vtp", "--output", "initial.npz", "--report", "voxelize.json"]),
    ("gpu", ["reconstruct", "scene.json", "initial.npz", "frames", "--output", "surfaces"]),
    ("gpu", ["estimate", "scene.json"]),
    ("gpu", ["study", "validation", "--case", "dam_break"]),
])
def test_stages_refuse_a_device_before_all_else(tmp_path, device, stage):
    (tmp_path / "scene.json").write_text(load_scene(ROOT / "config/scenes/tiny.yaml", "draft").to_json())
    folder = ROOT if stage[0] == "study" else tmp_path
    done = subprocess.run([sys.executable, "-m", f"pipeline.{stage[0]}", *stage[1:], "--device", device],
                          cwd=folder, env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr.startswith("error: --device is ") and done.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["scene.json"]


# Snakemake

def test_snakemake_refuses_a_device_and_passes_one_on(project):
    project.write_scene("apple", "extends: tiny\nnumerics: {device: metal}\n")
    movie = "outputs/apple/draft/movie.mp4"
    for arguments, where in (((movie,), "config/scenes/apple.yaml: numerics.device"),
                             (("--config", "device=metal", "--", movie), "--config device")):
        code, output = project.snakemake("-n", *arguments)
        assert code == 2 and "Traceback" not in output
        assert f"error: {where} is metal, but Taichi finds no such device here; here it may be auto, cpu" in output
    code, output = project.snakemake("-n", "-p", "--config", "device=cpu", "--", movie)
    assert code == 0, output
    commands = [line for line in output.splitlines() if "--threads" in line]
    assert len(commands) == 5 and all("--device cpu" in line for line in commands)
    assert not project.outputs("apple").exists()


def test_device_of_a_run_repeats_no_stage(project, monkeypatch):
    monkeypatch.chdir(project.folder)
    values = {"scenes": ["tiny"], "accuracy": "draft"}
    wildcards = type("Wildcards", (), {"scene": "tiny", "level": "draft", "segment": "000"})
    free, bound = (workflow.Workflow(values | more) for more in ({}, {"device": "cpu"}))
    assert (free.device, bound.device) == ("", "--device cpu")
    for stage in ("voxelize", "simulate", "reconstruct", "estimate"):
        assert free.depends(stage)(wildcards) == bound.depends(stage)(wildcards)


# Vulkan beside the CPU, both in single precision

@pytest.fixture(scope="module")
def states(tmp_path_factory) -> dict[str, dict[str, np.ndarray]]:
    """Return the states of all cases, by device."""
    if devices._trial("vulkan") == ABSENT:
        pytest.skip("no Vulkan on this machine: install mesa-vulkan-drivers (./run test does, or tells how)")
    folder = tmp_path_factory.mktemp("devices")
    for device in ("cpu", "vulkan"):
        subprocess.run([sys.executable, "tests/on_device.py", device, folder / "shared.npz", folder / f"{device}.npz"],
                       cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)}, check=True)
    return {device: dict(np.load(folder / f"{device}.npz")) for device in ("cpu", "vulkan")}
