"""Devices: which one is taken, what is refused, and that Vulkan computes what the CPU computes."""
import ctypes
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from helpers import forked
from helpers.cavities import SPACING, part
from helpers.free_surface import DAM_WIDTH, GRAVITY
from helpers.on_device import HEIGHT

from pipeline.base.errors import UserError
from pipeline.scenes import devices as chosen
from pipeline.scenes.load import load_scene
from pipeline.workflow import scenes as workflow
from sim.backend import devices
from sim.backend.devices import ABSENT, SHORT

SPACINGS = {"still": HEIGHT / 8, "dam": DAM_WIDTH / 8, "eye": SPACING}  # m, of the cases that cost little

# What is taken, and what is refused


@pytest.fixture
def here(monkeypatch):
    """Return a function that says what trials of devices come to (0 where one can be used), and of a driver."""
    def there(driver: bool = False, **codes: int) -> None:
        monkeypatch.setattr(devices, "_trial", lambda device: codes.get(device, ABSENT))
        monkeypatch.setattr(ctypes, "CDLL", lambda name: None if driver else ctypes.cdll.LoadLibrary("no such file"))
    return there


@pytest.mark.parametrize(("found", "expected"), [
    ({}, "cpu"), ({"vulkan": 0, "metal": 0}, "cpu"), ({"driver": True}, "cpu"),
    ({"driver": True, "cuda": SHORT}, "cpu"),
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
    with pytest.raises(UserError, match=r"^--device is vulkan, but it ends long loops early"):
        chosen.checked_device("vulkan", "--device")


@pytest.mark.thorough
def test_taichi_does_not_fall_back_to_the_cpu():
    code = ("from sim.backend.runtime import NoDevice, device, initialize\n"
            "try:\n    initialize('f32', 1, 'metal')\nexcept NoDevice as error:\n    print(error)\n"
            "initialize('f32')\nprint(device())")
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-2:] == ["Taichi finds no device metal", "cpu"]


@pytest.mark.thorough
@pytest.mark.parametrize(("device", "stage"), [
    ("metal", ["simulate", "scene.json", "initial.npz", "--frames", "frames", "--checkpoint", "end.npz"]),
    ("gpu", ["voxelize", "scene.json", "eye.vtp", "--output", "initial.npz", "--report", "voxelize.json"]),
    ("gpu", ["reconstruct", "scene.json", "initial.npz", "frames", "--output", "surfaces"]),
    ("gpu", ["estimate", "scene.json"]),
    ("gpu", ["study", "validation"]),
])
def test_stages_refuse_a_device_before_all_else(tmp_path, device, stage):
    (tmp_path / "scene.json").write_text(load_scene(ROOT / "config/scenes/tiny.yaml", "draft").to_json())
    folder = ROOT if stage[0] == "study" else tmp_path
    done = forked.run(f"pipeline.{stage[0]}", *stage[1:], "--device", device, folder=folder)
    assert done.returncode == 2
    assert done.stderr.startswith("error: --device is ") and done.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["scene.json"]


# Snakemake

@pytest.mark.thorough
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

def states(folder: Path, *cases: str) -> dict[str, dict[str, np.ndarray]]:
    """Return the states of the cases, by device."""
    if devices._trial("vulkan") == ABSENT:
        pytest.skip("no Vulkan on this machine: install mesa-vulkan-drivers (./run test does, or tells how)")
    for device in ("cpu", "vulkan"):
        subprocess.run([sys.executable, "-m", "helpers.on_device", device, folder / "shared.npz",
                        folder / f"{device}.npz", *cases],
                       env=os.environ | {"PYTHONPATH": f"{ROOT}:{ROOT / 'tests'}"}, check=True)
    return {device: dict(np.load(folder / f"{device}.npz")) for device in ("cpu", "vulkan")}


@pytest.fixture(scope="module")
def found(tmp_path_factory) -> dict[str, dict[str, np.ndarray]]:
    """Return the states of the cases that cost little."""
    return states(tmp_path_factory.mktemp("devices"), *SPACINGS)


def by_id(states, device: str, state: str, name: str) -> np.ndarray:
    """Return a field of the particles in double precision, sorted by id."""
    particles = part(states[device], f"{state}.particles")
    return particles[name][np.argsort(particles["id"])].astype(float)


def assert_alike(states, state: str, spacing: float, share: float) -> None:
    """The positions are as near as a share of the spacing; the sums of volumes and masses agree to round-off."""
    position, volume, mass = ([by_id(states, device, state, name) for device in states]
                              for name in ("position", "volume", "mass"))
    assert np.abs(position[0] - position[1]).max() < share * spacing
    for both in (volume, mass):
        assert both[0].sum() == pytest.approx(both[1].sum(), rel=1e-6)


@pytest.mark.thorough
@pytest.mark.parametrize("case", SPACINGS)
def test_vulkan_is_close_to_the_cpu(found, case):
    """As near as single precision is to double in `test_solver`: round-off of 1e-7 per operation, over 20 steps."""
    for state in ("middle", "end"):
        assert_alike(found, f"{case} {state}", SPACINGS[case], share=1e-3)
    if case != "eye":  # nothing exchanges volume or mass there
        for name in ("volume", "mass"):
            np.testing.assert_array_equal(by_id(found, "cpu", f"{case} end", name),
                                          by_id(found, "vulkan", f"{case} end", name))


@pytest.mark.thorough
def test_cases_move_as_they_should(found):
    """A dam falls and oil flows in; a still tank is as still on both, a twentieth of a free fall through it."""
    for device in found:
        speeds = {case: np.linalg.norm(by_id(found, device, f"{case} end", "velocity"), axis=1).max()
                  for case in SPACINGS}
        assert speeds["still"] < 0.05 * math.sqrt(GRAVITY * HEIGHT) < 0.5 < speeds["dam"]
        oil = [by_id(found, device, f"eye {state}", "volume")[by_id(found, device, f"eye {state}", "phase") == 1].sum()
               for state in ("middle", "end")]
        assert oil[1] > 1.1 * oil[0] > 0.0


@pytest.mark.thorough
@pytest.mark.parametrize("case", SPACINGS)
def test_vulkan_gives_the_same_bits_again(found, case):
    middle, again = (part(found["vulkan"], f"{case} {state}") for state in ("middle", "again"))
    assert middle.keys() == again.keys()
    for name, values in middle.items():
        np.testing.assert_array_equal(values, again[name], err_msg=name)


@pytest.mark.thorough
@pytest.mark.parametrize("case", SPACINGS)
def test_vulkan_continues_what_the_cpu_began(found, case):
    """And comes nearer to what the CPU continues than to its own way there, which has twice the steps."""
    end, continued = (by_id(found, "cpu", f"{case} {state}", "position") for state in ("end", "continued"))
    np.testing.assert_array_equal(end, continued)
    assert_alike(found, f"{case} continued", SPACINGS[case], share=5e-4)


@pytest.mark.slow
@pytest.mark.parametrize(("scheme", "cavity"), [
    (scheme, cavity) for scheme in ("volume_incompressible", "dfsph", "wcsph", "position_based")
    for cavity in ("closed", "open")])
def test_all_effects_run_on_vulkan(tmp_path, scheme, cavity):
    """In the stirred state of the study of determinism, with every effect that the scheme runs.

    Flow is chaotic there, and most where speeds are moves over time: ten times what was measured on lavapipe.
    """
    case = f"{scheme} {cavity}"
    share = 0.3 if scheme == "position_based" else 6e-3
    assert_alike(states(tmp_path, case), f"{case} middle", SPACING, share)
