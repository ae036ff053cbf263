"""Memory: what is foretold is what a solver allocates, and a scene that does not fit is refused in one sentence."""
import gc

import pytest
import trimesh
from conftest import ROOT
from helpers import cavities

from pipeline.base import memory
from pipeline.base.errors import UserError
from pipeline.cavity.voxels import voxelize
from pipeline.scenes import memory_check
from pipeline.scenes.folders import scene_paths
from pipeline.scenes.load import load_scene
from sim.backend import accounting
from sim.memory import bytes_per_particle, needed_bytes
from sim.solver import Solver

SCENES = ROOT / "config" / "scenes"
CASES = {
    "gravity": (("gravity",), {}),
    "interface": (("gravity", "interface_tension", "viscosity_implicit"), {}),
    "mixture": (("gravity", "diffusion", "viscosity"), {}),
    "wide support": (("gravity",), {"support_ratio": 3.0}),
    "free surface": (("gravity",), {"scheme": "dfsph"}),
    "wcsph": (("gravity",), {"scheme": "wcsph"}),
}
VALUES = {"interface_tension": {"coefficient": 0.04}, "diffusion": {"coefficient": 1e-6}}


@pytest.mark.thorough
@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("case", CASES)
def test_a_solver_allocates_what_is_foretold(anew, case, dimension, monkeypatch):
    monkeypatch.setattr(Solver, "prepare_rest_state", lambda self: None)  # compiles, and allocates nothing
    names, numerics = CASES[case]
    arrays = cavities.cavity("box", (0.03,) * dimension if dimension == 2 else (0.012,) * 3, dimension)
    gc.collect()
    before = accounting.allocated()
    solver = cavities.build(arrays, effects=tuple(cavities.parameters(name, **VALUES.get(name, {})) for name in names),
                            filled=(lambda x: x[:, 1] < 0.0) if "scheme" in numerics else None, **numerics)
    taken = accounting.allocated() - before
    foretold = needed_bytes(solver.settings, solver.count[None], solver.walls.count, solver.distance.size)
    assert foretold == pytest.approx(taken, rel=0.3)
    assert solver.bytes() < 1.3 * foretold


def test_an_effect_that_is_off_needs_no_memory():
    scene = load_scene(SCENES / "tamponade.yaml", "draft")
    without = load_scene(SCENES / "effects_eye_without_interface_tension.yaml", "draft")
    assert needed_bytes(scene.settings(), 10**6) > needed_bytes(without.settings(), 10**6)
    assert bytes_per_particle(scene.settings()) > 1000.0  # most of it neighbors


@pytest.mark.parametrize(("name", "spacing"), [("tamponade", "0.02 mm"), ("coupling_2d", "0.02 mm"),
                                               ("egg_dropped", "0.05 mm"), ("tamponade", "2 nm")])
def test_too_many_particles_are_one_sentence_with_a_way_out(name, spacing, tmp_path, monkeypatch):
    monkeypatch.setattr(memory_check, "memory_of_computer", lambda: 8.0 * 2**30)
    for file in scene_paths(SCENES).values():
        (tmp_path / file.name).write_text(file.read_text())
    path = tmp_path / "x.yaml"
    path.write_text(f"extends: {name}\nnumerics: {{particle_spacing: {spacing}}}\n")
    sentence = r"^\S+x.yaml: numerics.particle_spacing is [^\n]* for the 8 GiB of this computer$"
    with pytest.raises(UserError, match=sentence) as caught:
        load_scene(path, "draft")
    fits = str(caught.value).split("at least ")[1].split(" for")[0]
    path.write_text(f"extends: {name}\nnumerics: {{particle_spacing: {fits}}}\n")
    load_scene(path, "draft")


@pytest.mark.parametrize("spacing", ["1e-300", "1e-300 mm", "1e-320", "0", "-1 mm"])
def test_absurd_spacing_is_one_sentence(spacing, tmp_path):
    path = tmp_path / "x.yaml"
    path.write_text(f"liquids: [aqueous]\nnumerics: {{particle_spacing: {spacing}}}\noutput: {{duration: 1 s}}\n")
    with pytest.raises(UserError, match=r"^[^\n]*particle_spacing is [^\n]*, but must be at least 1e-09 m[^\n]*$"):
        load_scene(path, "draft")


def test_mesh_is_asked_when_it_is_filled(monkeypatch):
    """The scene does not read a user's mesh: the voxelize stage does."""
    scene = load_scene(SCENES / "still_eye.yaml", "draft")
    monkeypatch.setattr(memory_check, "memory_of_computer", lambda: 1e7)
    with pytest.raises(UserError, match=r"^eye.json: numerics.particle_spacing: is 1 mm, which makes [^\n]* particles"):
        voxelize(scene, trimesh.creation.icosphere(radius=10e-3), "eye.json")


def test_grid_around_a_slanted_mesh_counts(monkeypatch):
    """A rod along the diagonal holds few particles in a large box: the grid of its distance is what needs memory."""
    scene = load_scene(SCENES / "still_eye.yaml", "draft")
    rod = trimesh.creation.cylinder(radius=2e-3, segment=[[0.0, 0.0, 0.0], [60e-3, 60e-3, 60e-3]])
    assert not memory_check.too_large(scene.settings(), rod.volume)
    monkeypatch.setattr(memory_check, "memory_of_computer", lambda: 2e8)
    with pytest.raises(UserError, match=r"^eye.json: numerics.particle_spacing: is 1 mm[^\n]*$"):
        voxelize(scene, rod, "eye.json")


def test_more_head_room_needs_more_memory(monkeypatch):
    settings = load_scene(SCENES / "still_eye.yaml", "draft").settings()
    assert needed_bytes(settings, 10**5, head_room=2.8) > 1.5 * needed_bytes(settings, 10**5)
    monkeypatch.setattr(memory_check, "memory_of_computer", lambda: 1.2 * needed_bytes(settings, 10**5))
    assert not memory_check.too_large(settings, 0.0, particles=10**5)
    assert memory_check.too_large(settings, 0.0, particles=10**5, head_room=2.8)


def test_control_group_limits_the_memory(tmp_path, monkeypatch):
    monkeypatch.setattr(memory, "CGROUPS", tmp_path)
    everything = memory.memory_of_computer()
    (tmp_path / "memory.max").write_text("max\n")
    assert memory.memory_of_computer() == everything
    for name in ("memory.max", "memory/memory.limit_in_bytes"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("1000000\n")
    assert memory.memory_of_computer() == 1e6
