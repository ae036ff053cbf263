"""Scenes in a rectangular container: what their files may say, and every stage in two and in three dimensions."""
import dataclasses
import json
import shutil
from types import MappingProxyType

import numpy as np
import pytest
import pyvista
from conftest import ROOT
from helpers import forked
from helpers.cases import thorough
from helpers.synthetic_frames import frame_of
from PIL import Image

from pipeline import render
from pipeline.base.errors import UserError
from pipeline.base.frame_files import find_frames, frame_path, read_frame, write_frame
from pipeline.base.tables import read_table
from pipeline.base.vtk_files import write_vtk
from pipeline.cavity.container import block_lattice, container_arrays
from pipeline.measures.isolation import isolated
from pipeline.reconstruct import write_surfaces
from pipeline.scenes.folders import scene_path
from pipeline.scenes.load import load_resolved, load_scene
from pipeline.simulation import solver_setup
from pipeline.simulation.solver_setup import initial_phases, initial_velocity
from pipeline.surfaces.contour import contour, enclosed_volumes
from pipeline.surfaces.contour_lines import contour_lines, enclosed_areas
from pipeline.surfaces.liquid_surface import Reconstructor
from pipeline.surfaces.surface_files import lines_of
from sim.schemes import REGISTRY as SCHEMES

BASE = """
dimension: 2
container: {size: [1.2 m, 0.8 m]}
liquids: [aqueous, silicone_oil_1000]
blocks:
  - {liquid: aqueous, lower: [0, 0], upper: [0.4, 0.5]}
  - {liquid: silicone_oil_1000, lower: [0.72, 0.2], upper: [1.1, 0.6], velocity: [0, 1 m/s]}
effects: {gravity: {}}
numerics: {scheme: wcsph, particle_spacing: 20 mm}
output: {duration: 40 ms, frame_interval: 20 ms, image_size: [320, 180]}
"""
FULL = "blocks: [{liquid: aqueous, lower: [0, 0], upper: [1.2, 0.8]}]"
HALF = ("blocks: [{liquid: silicone_oil_1000, lower: [0, 0], upper: [0.6, 0.8]}, "
        "{liquid: aqueous, lower: [0.6, 0], upper: [1.2, 0.8]}]")
SPACE = """
extends: base
dimension: 3
container: {size: [1.2 m, 0.8 m, 0.4 m]}
blocks:
  - {liquid: aqueous, lower: [0, 0, 0], upper: [0.4, 0.52, 0.4]}
  - {liquid: silicone_oil_1000, lower: [0.72, 0.2, 0], upper: [1.12, 0.6, 0.4]}
numerics: {particle_spacing: 40 mm}
"""


@pytest.fixture
def write(tmp_path):
    """Write a scene beside the scene `base` into a copy of the configuration and return its path."""
    config = shutil.copytree(ROOT / "config", tmp_path / "config")
    (config / "scenes" / "base.yaml").write_text(BASE)

    def write_scene(text, name="case"):
        path = config / "scenes" / f"{name}.yaml"
        path.write_text(text)
        return path
    return write_scene


@pytest.fixture
def base(write):
    return load_scene(write("extends: base"), "draft")


def errors_of(path):
    with pytest.raises(UserError) as caught:
        load_scene(path, "draft")
    return caught.value.messages


# Scenes

def test_scene_is_resolved_and_survives_json(base, tmp_path):
    assert base.eye is None and base.container.size == (1.2, 0.8)
    assert [block.liquid for block in base.blocks] == ["aqueous", "silicone_oil_1000"]
    assert not base.closed and not base.settings().closed
    path = tmp_path / "scene.json"
    path.write_text(base.to_json())
    assert load_resolved(path) == base


@pytest.mark.parametrize("text", [FULL, "blocks: null\ninitial: {liquid: aqueous}",
                                  "blocks: null\ninitial: {fill: {aqueous: 20 %, silicone_oil_1000: 80 %}}"])
def test_full_container_is_closed(write, text):
    scene = load_scene(write(f"extends: base\n{text}\n"), "draft")
    assert scene.closed and scene.settings().closed
    assert container_arrays(scene)["fluid_volume"].sum() == pytest.approx(0.96, rel=1e-12)


def test_levels_change_the_accuracy_and_numerics_win(write):
    levels = "levels: {draft: {particle_spacing: 20 mm, courant_number: 0.2}, fine: {particle_spacing: 10 mm}}"
    path = write(f"extends: base\nnumerics: {{particle_spacing: null}}\n{levels}\n")
    draft, fine = load_scene(path, "draft"), load_scene(path, "fine")
    assert (draft.numerics.particle_spacing, draft.numerics.courant_number) == (0.02, 0.2)
    assert (fine.numerics.particle_spacing, fine.numerics.pressure_tolerance) == (0.01, 1.5e-4)
    child = write("extends: case\nnumerics: {particle_spacing: 40 mm}", "child")
    assert load_scene(child, "fine").numerics.particle_spacing == 0.04


def test_parameters_of_the_chosen_scheme_reach_the_solver(write):
    text = "extends: base\nschemes: {wcsph: {sound_speed: 30 m/s}}\n"
    assert load_scene(write(text), "draft").settings().scheme.sound_speed == 30.0
    full = load_scene(write(f"{text}{FULL}\nnumerics: {{scheme: volume_incompressible}}\n"), "draft")
    assert full.settings().scheme is None and full.schemes["wcsph"].sound_speed == 30.0


BAD = {
    "eye and container": ("eye: {}", "container is given beside eye"),
    "blocks in an eye": ("container: null", "blocks fill a container, but this scene has an eye"),
    "eye in a plane": ("container: null\nblocks: null", "dimension is 2, but an eye has 3 dimensions"),
    "size of three": ("container: {size: [1, 1, 1]}", "container.size has 3 entries, but must have 2"),
    "flat container": ("container: {size: [1.2, 0 m]}", "container.size[1] is \"0 m\", but must be above 0 m"),
    "coarse": ("numerics: {particle_spacing: 0.3}", "must be at most 0.2 m, a quarter of the shortest side"),
    "too fine": ("numerics: {particle_spacing: 1 um}", "which makes 3.5e+11 particles that need"),
    "no liquid": ("blocks: null", "blocks is missing, so the container holds no liquid"),
    "blocks and initial": ("initial: {liquid: aqueous}", "initial is given beside blocks"),
    "unknown liquid": ("blocks: [{liquid: aqeous, lower: [0, 0], upper: [1, 0.5]}]", "did you mean aqueous?"),
    "block of three": ("blocks: [{liquid: aqueous, lower: [0, 0, 0], upper: [1, 0.5]}]",
                       "blocks[0].lower has 3 entries, but must have 2"),
    "velocity of three": ("blocks: [{liquid: aqueous, lower: [0, 0], upper: [1, 0.5], velocity: [0, 0, 1]}]",
                          "blocks[0].velocity has 3 entries"),
    "outside": ("blocks: [{liquid: aqueous, lower: [0, -0.1], upper: [1.3, 0.5]}]",
                "blocks[0].upper has x = 1.3 m, outside the container, which reaches from 0 to 1.2 m"),
    "below": ("blocks: [{liquid: aqueous, lower: [0, -0.1], upper: [1, 0.5]}]", "blocks[0].lower has y = -0.1 m"),
    "thin": ("blocks: [{liquid: aqueous, lower: [0, 0], upper: [1, 0.01]}]",
             "leaves 0.01 m along y, but must be at least one particle spacing, 0.02 m"),
    "turned over": ("blocks: [{liquid: aqueous, lower: [0, 0.5], upper: [1, 0.1]}]", "leaves -0.4 m along y"),
    "overlap": ("blocks: [{liquid: aqueous, lower: [0, 0], upper: [0.5, 0.5]}, "
                "{liquid: aqueous, lower: [0.4, 0.4], upper: [1, 0.8]}]",
                "blocks[1] overlaps blocks[0] by 0.1 x 0.1 m"),
    "injection": ("effects: {injection: {liquid: aqueous, drained_liquid: silicone_oil_1000, flow: 1e-6, fill: 0.5, "
                  "cannula: [0.1, 0.1, 0], drain: [1, 0.1, 0]}}", "but the blocks leave a free surface"),
    "cannula outside": ("effects: {injection: {liquid: aqueous, drained_liquid: silicone_oil_1000, flow: 1e-6, "
                        "fill: 0.5, cannula: [2, 0.1, 0], drain: [1, 0.1, 0]}}", "cannula is (2, 0.1, 0) m, outside"),
    "tension below a free surface": ("effects: {interface_tension: {coefficient: 40 mN/m}}",
                                     "effects.interface_tension keeps a part of the pressure out of the solve"),
    "refused effect": ("effects: {injection: {liquid: aqueous, drained_liquid: silicone_oil_1000, flow: 1e-6, "
                       "fill: 0.5, cannula: [0.1, 0.1, 0], drain: [1, 0.1, 0]}}",
                       "effects.injection cannot be used with the scheme wcsph"),
    "gravity out of the plane": ("effects: {gravity: {posture: prone}}", "must be one of upright, left_side"),
    "turn out of the plane": ("effects: {gravity: {turns: [{start: 0, to: prone}]}}",
                              "gravity.turns[0].to is prone, which points out of the plane"),
    "triangles of lines": ("output: {formats: [ply]}", "output.formats names ply"),
    "unknown scheme": ("numerics: {scheme: wscph}", "did you mean wcsph?"),
    "parameters of no scheme": ("schemes: {wscph: {}}", "schemes.wscph is not known (did you mean wcsph?)"),
    "unknown parameter": ("schemes: {wcsph: {sound: 3}}", "schemes.wcsph.sound is not known"),
    "unknown level": ("levels: {drft: {}}", "levels.drft is not known (did you mean draft?)"),
    "level of another": ("levels: {fine: {particle_spacing: x}}", 'levels.fine.particle_spacing is "x"'),
    "time step": ("numerics: {time_step: 3 ms}", "at most 0.002 s because of numerics.maximum_time_step"),
    "time step of free fall": ("numerics: {time_step: 40 ms, maximum_time_step: 1 s}\nblocks: [{liquid: aqueous, "
                               "lower: [0, 0], upper: [1, 0.5]}]", "numerics.time_step is 0.04 s, which is unstable"),
    "time step of speed": ("numerics: {time_step: 7 ms, maximum_time_step: 1 s}", "numerics.time_step is 0.007 s"),
    "time step of viscosity": ("numerics: {time_step: 2 ms}\neffects: {viscosity: {}}\nliquids: {aqueous: {}, "
                               "silicone_oil_1000: {dynamic_viscosity: 100 Pa s}}",
                               "numerics.time_step is 0.002 s, which is unstable"),
    "time step of no interface": ("numerics: {time_step: 1 ms}\nliquids: {silicone_oil_1000: null}\nblocks: [{liquid: "
                                  "aqueous, lower: [0, 0], upper: [1, 1]}]\neffects: {interface_tension: "
                                  "{coefficient: 40 mN/m}}", "interface_tension needs two liquids at least"),
    "small time step": ("numerics: {time_step: 1e-9}", "must be at least minimum_time_step"),
}


@pytest.mark.parametrize("case", BAD)
def test_error_names_file_key_and_what_is_allowed(case, write):
    text, expected = BAD[case]
    path = write(f"extends: base\n{text}\n")
    messages = errors_of(path)
    assert any(expected in message for message in messages), messages
    assert all(message.startswith(str(path)) and "\n" not in message for message in messages)


def test_a_name_in_two_lines_breaks_no_sentence(tmp_path):
    text = load_scene(scene_path("collision_balls", ROOT / "config" / "scenes"), "draft").to_json()
    (tmp_path / "scene.json").write_text(text.replace('"name": "red_gel"', '"name": "two\\nlines"'))
    with pytest.raises(UserError, match=r"one of two\\nlines, blue_gel") as error:
        load_resolved(tmp_path / "scene.json")
    assert all(line.startswith(str(tmp_path)) for line in str(error.value).splitlines())


def test_limit_of_explicit_viscosity_is_known_beforehand(write):
    """0.125 dx^2 rho / mu of 970 kg/m3 and 100 Pa s at 20 mm is 0.485 ms."""
    viscous = "effects: {viscosity: {}}\nliquids: {aqueous: {}, silicone_oil_1000: {dynamic_viscosity: 100 Pa s}}\n"
    for step in (0.48, 0.49):
        path = write(f"extends: base\nnumerics: {{time_step: {step} ms}}\n{FULL}\n{viscous}")
        if step < 0.485:
            assert load_scene(path, "draft").numerics.time_step == pytest.approx(1e-3 * step)
        else:
            assert "at most 0.000485 s because of effects.viscosity" in errors_of(path)[0]


def test_limits_of_a_scheme_are_respected(write, monkeypatch):
    monkeypatch.setattr(SCHEMES["wcsph"], "largest_density_ratio", 10.0)
    messages = errors_of(write("extends: base\nliquids: {aqueous: {density: 1 kg/m3}}\n"))
    assert messages[0].endswith("liquids have densities from 1 to 970 kg/m3, a ratio of 970, but the scheme wcsph was "
                                "shown to work up to 10 under a free surface")
    monkeypatch.setattr(SCHEMES["wcsph"], "fills", ("closed",))
    assert "is wcsph, which cannot have a free surface, but" in errors_of(write("extends: base"))[0]
    monkeypatch.setattr(SCHEMES["wcsph"], "fills", ("open",))
    assert "is wcsph, which needs a free surface, but the cavity is full; use " in errors_of(
        write(f"extends: base\n{FULL}"))[0]
    monkeypatch.setattr(SCHEMES["wcsph"], "fills", ("open", "closed"))
    monkeypatch.setattr(SCHEMES["wcsph"], "refuses", MappingProxyType({"gravity": "it floats"}))
    assert "effects.gravity cannot be used with the scheme wcsph: it floats" in errors_of(write("extends: base"))[0]


@pytest.mark.parametrize(("form", "density", "limit"), [
    ("volume", "195 kg/m3", None), ("volume", "190 kg/m3", "5"), ("mass", "900 kg/m3", None),
    ("mass", "800 kg/m3", "1.2")])
@pytest.mark.parametrize("closed", [True, False])
def test_dfsph_takes_less_of_a_ratio_where_it_sums_masses(write, form, density, limit, closed):
    if not closed:
        density, limit = {"195 kg/m3": ("98 kg/m3", None), "190 kg/m3": ("95 kg/m3", "10"),
                          "900 kg/m3": ("490 kg/m3", None), "800 kg/m3": ("480 kg/m3", "2")}[density]
    path = write(f"extends: base\n{FULL if closed else ''}\n"
                 f"liquids: {{aqueous: {{density: {density}}}, silicone_oil_1000: {{}}}}\n"
                 f"numerics: {{scheme: dfsph}}\nschemes: {{dfsph: {{density_form: {form}}}}}\n")
    if limit is None:
        assert load_scene(path, "draft").schemes["dfsph"].density_form == form
    else:
        where = "in a full cavity" if closed else "under a free surface"
        assert f"but the scheme dfsph was shown to work up to {limit} {where}" in errors_of(path)[0]


@pytest.mark.parametrize(("density", "limit"), [("1.2 kg/m3", None), ("0.9 kg/m3", "1000")])
@pytest.mark.parametrize("closed", [True, False])
def test_gas_is_taken_up_to_a_ratio_of_a_thousand(write, density, limit, closed):
    path = write(f"extends: base\n{FULL if closed else ''}\n"
                 f"liquids: {{aqueous: {{density: {density}}}, silicone_oil_1000: {{}}}}\n"
                 "numerics: {scheme: volume_incompressible}\n")
    if limit is None:
        assert load_scene(path, "draft").numerics.scheme == "volume_incompressible"
    else:
        where = "in a full cavity" if closed else "under a free surface"
        assert f"the scheme volume_incompressible was shown to work up to {limit} {where}" in (
            errors_of(path)[0])


def test_injection_beside_a_gas_is_refused(write):
    """It was never shown to hold: air that streams in at 2 mL/s is blown apart."""
    injection = ("effects: {injection: {liquid: aqueous, drained_liquid: silicone_oil_1000, flow: 1e-6, fill: 0.5, "
                 "cannula: [0.1, 0.1, 0], drain: [1, 0.1, 0]}}")
    scheme = "numerics: {scheme: volume_incompressible}\n"
    light = "liquids: {aqueous: {density: 400 kg/m3}, silicone_oil_1000: {}}"
    messages = errors_of(write(f"extends: base\n{FULL}\n{scheme}{injection}\n{light}"))
    assert "effects.injection cannot be used with liquids whose densities differ by a factor of 2.425" in messages[0]


def test_injection_counts_the_blocks(write):
    """The aqueous of 0.96 m2 is 0.48 m2 beside the block of oil, half of the container."""
    write(f"extends: base\n{HALF}\nnumerics: {{scheme: volume_incompressible}}\n", "half")
    injection = ("extends: half\neffects: {{injection: {{liquid: {}, drained_liquid: {}, flow: 1e-6, fill: {}, "
                 "cannula: [0.1, 0.1, 0], drain: [1, 0.1, 0]}}}}")
    oil, aqueous = "silicone_oil_1000", "aqueous"
    assert "holds 50 % of the cavity at the start" in errors_of(write(injection.format(oil, aqueous, 0.4)))[0]
    assert "drains all aqueous (50 % of the cavity at the start), but must be at most 99.5 %" in errors_of(
        write(injection.format(oil, aqueous, 0.999)))[0]
    load_scene(write(injection.format(oil, aqueous, 0.9)), "draft")


def test_scene_must_start_in_the_same_container(write):
    write("extends: base\ncontainer: {size: [1.2 m, 1 m]}\n", "high")
    path = write("extends: base\nstart_from: high\n")
    assert "container is 1.2 x 0.8 m, but must be 1.2 x 1 m as in high" in errors_of(path)[0]
    path = write("extends: base\nstart_from: tiny\n")
    assert any("container is 1.2 x 0.8 m, but must be no container as in tiny" in line for line in errors_of(path))


# Particles

def test_blocks_keep_their_sides_whatever_the_spacing():
    position, volume = block_lattice((0.0, 0.5), (1.0, 1.23), 0.1)
    assert len(position) == 10 * 7 and len(position) * volume == pytest.approx(0.73, rel=1e-12)
    np.testing.assert_allclose(position.min(axis=0), [0.05, 0.5 + 0.73 / 14])
    np.testing.assert_allclose(position.max(axis=0), [0.95, 1.23 - 0.73 / 14])


def test_particles_of_a_container(base):
    arrays = container_arrays(base)
    fluid, wall = arrays["fluid_position"], arrays["wall_position"]
    assert arrays["fluid_volume"].sum() == pytest.approx(0.4 * 0.5 + 0.38 * 0.4, rel=1e-12)
    assert arrays["cavity_volume"] == pytest.approx(0.96)
    assert (fluid > 0.0).all() and (fluid < [1.2, 0.8]).all()
    outside = np.maximum(-wall, wall - [1.2, 0.8]).max(axis=1)
    assert outside.min() == pytest.approx(0.01) and outside.max() == pytest.approx(0.05)
    shell = (1.2 + 6 * 0.02) * (0.8 + 6 * 0.02) - 0.96
    assert arrays["wall_volume"].sum() == pytest.approx(shell, rel=1e-12)
    phase, velocity = initial_phases(base, fluid, np.array([0.0, -1.0])), initial_velocity(base, fluid)
    np.testing.assert_array_equal(phase, (fluid[:, 0] > 0.6).astype(int))
    np.testing.assert_array_equal(velocity, np.outer(phase, [0.0, 1.0]))
    assert [arrays["fluid_volume"][phase == k].sum() for k in (0, 1)] == pytest.approx([0.2, 0.152])


# Surfaces

def test_area_of_lines_is_that_of_cells():
    """The lines and the sum over cells are two ways to the same polygons, saddles and holes included."""
    fields = np.random.default_rng(0).normal(size=(3, 40, 50))
    for field, area in zip(fields, enclosed_areas(fields, 0.1), strict=True):
        lines = contour_lines(field, np.zeros(2), 0.1)
        assert lines.is_closed() and lines.volume == pytest.approx(area, rel=1e-9)
    axis = np.linspace(-1.0, 1.0, 201)
    radius = np.hypot(*np.meshgrid(axis, axis, indexing="ij"))
    ring = contour_lines(np.minimum(0.8 - radius, radius - 0.3), np.full(2, -1.0), 0.01)
    assert ring.component_volumes() == pytest.approx([np.pi * 0.64, -np.pi * 0.09], rel=1e-3)
    assert contour_lines(np.full((3, 3), -1.0), np.zeros(2), 1.0).volume == 0.0


@pytest.mark.parametrize("method", ["flying_edges", "marching_cubes"])
def test_volumes_of_many_fields_are_those_of_each(method):
    """Boxes in a row do not touch: inside up to their faces, inside nowhere, or anything between. Points: 7 digits."""
    fields = np.random.default_rng(0).normal(size=(4, 12, 9, 10))
    fields[1], fields[2] = 1.0, -1.0
    volumes = enclosed_volumes(fields, 0.1, method)
    for field, volume in zip(fields, volumes, strict=True):
        assert contour(field, np.zeros(3), 0.1, method).volume == pytest.approx(volume, rel=1e-6)
    assert volumes[1] > volumes[0] > volumes[2] == 0.0


def state_of(scene, arrays, time=0.0):
    """Return the frame of a scene at the start."""
    position = arrays["fluid_position"]
    phase = initial_phases(scene, position, np.eye(scene.dimension)[1])
    frame = frame_of(position, np.eye(2)[phase], volume=arrays["fluid_volume"], time=time)
    return dataclasses.replace(frame, particle_spacing=scene.numerics.particle_spacing)


@pytest.mark.thorough
@pytest.mark.parametrize("text", ["extends: base", SPACE], ids=["plane", "space"])
def test_surfaces_of_blocks_have_their_volume_and_place(anew, write, text):
    scene = load_scene(write(text), "draft")
    arrays = container_arrays(scene)
    reconstructor = Reconstructor(arrays, 2, free_surface=True)
    for block, surface in zip(scene.blocks, reconstructor.surfaces(state_of(scene, arrays)), strict=True):
        numbers = surface.statistics
        assert numbers["watertight"] and numbers["components"] == 1
        assert numbers["volume"] == pytest.approx(np.prod(block.sides), rel=5e-3)
        # Faces lie where the block ends; only edges and corners are rounded. At the wall there is no gap.
        tolerance = 0.12 * scene.numerics.particle_spacing
        np.testing.assert_allclose(surface.mesh.points.min(axis=0), block.lower, atol=tolerance)
        np.testing.assert_allclose(surface.mesh.points.max(axis=0), block.upper, atol=tolerance)
    assert not reconstructor.sections()


def test_drops_in_the_void_have_their_area(anew, base):
    arrays = container_arrays(base)
    frame = state_of(base, arrays)
    position = frame.position.copy()
    alone = np.flatnonzero(frame.phase == 1)[::60]
    position[alone, 0], position[alone, 1] = 0.5 + 0.1 * np.arange(len(alone)), 0.7
    oil = Reconstructor(arrays, 2, free_surface=True).surfaces(dataclasses.replace(frame, position=position))[1]
    assert oil.statistics["droplets"] >= len(alone)
    drops = np.sort([area for area in oil.mesh.component_volumes() if 0.0 < area < 5.0 * frame.volume[alone[0]]])
    np.testing.assert_allclose(drops[:len(alone)], frame.volume[alone[0]], rtol=0.15)


def test_full_container_in_a_plane_has_one_interface(anew, write):
    fill = "blocks: null\ninitial: {fill: {aqueous: 30 %, silicone_oil_1000: 70 %}}"
    scene = load_scene(write(f"extends: base\n{fill}\n"), "draft")
    arrays = container_arrays(scene)
    phase = initial_phases(scene, arrays["fluid_position"], np.array([0.0, -1.0]))
    frame = frame_of(arrays["fluid_position"], np.eye(2)[phase], volume=arrays["fluid_volume"])
    water, oil = Reconstructor(arrays, 2).surfaces(frame)
    assert water.mesh.volume == pytest.approx(0.3 * 0.96, rel=0.01)
    assert water.mesh.volume + oil.mesh.volume == pytest.approx(0.96, rel=3e-3)


# Pictures

@pytest.fixture
def drawn(anew, write, tmp_path, monkeypatch):
    """Return a function that draws the start of a scene and gives its pixels."""
    def draw(text, *options):
        scene = load_scene(write(text), "draft")
        scene = dataclasses.replace(scene, output=dataclasses.replace(scene.output, image_size=(640, 360)))
        arrays = container_arrays(scene)
        (tmp_path / "scene.json").write_text(scene.to_json())
        path = frame_path(tmp_path / "frames", 0)
        write_frame(path, state_of(scene, arrays))
        (tmp_path / "surfaces").mkdir()
        write_surfaces(tmp_path / "surfaces", path, read_frame(path), Reconstructor(arrays, 2, free_surface=True))
        write_vtk(pyvista.Box(), tmp_path / "eye.vtp")
        names = ("scene.json", "initial.npz", "eye.vtp", "frames", "surfaces")
        render.main([*(str(tmp_path / name) for name in names), "--output", str(tmp_path / "images"), *options])
        return np.asarray(Image.open(tmp_path / "images" / "frame_00000.png").convert("RGB")).astype(int)
    return draw


def blue_and_ivory(pixels):
    """Return the masks of the pixels of water and of oil."""
    difference = pixels[..., 2] - pixels[..., 0]
    return difference > 25, difference < -20


@pytest.mark.parametrize("text", ["extends: base", thorough(SPACE)], ids=["plane", "slice"])
def test_blocks_are_drawn_in_their_colors_without_opengl(drawn, text):
    pixels = drawn(text, "--section-only")
    assert pixels.shape == (360, 640, 3)
    water, oil = blue_and_ivory(pixels[50:320])
    assert 0.7 < oil.sum() / water.sum() < 0.85                     # 0.152 / 0.2, and much the same in the slice
    rows, columns = np.nonzero(water)
    other_rows, other_columns = np.nonzero(oil)
    assert columns.mean() < other_columns.mean() - 80 and rows.mean() > other_rows.mean() + 20
    assert (columns.max() - columns.min()) / (rows.max() - rows.min()) == pytest.approx(0.8, abs=0.05)


@pytest.mark.thorough
def test_bodies_are_drawn_beside_the_slice(drawn, opengl):
    right = drawn(SPACE)[50:320, 320:]
    water, oil = blue_and_ivory(right)
    assert water.sum() > 3000 and oil.sum() > 3000
    assert (right.min(axis=-1) > 252).sum() > 20000


# Metrics

def test_isolated_particles_are_those_amid_another_liquid():
    axis = np.arange(12) + 0.5
    position = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    phase = (position[:, 0] > 6.0).astype(int)
    assert not isolated(position, phase, 2, 2.5).any()              # at a clean interface a third is the own liquid
    lone, pair = 2 * 12 + 5, [9 * 12 + 5, 9 * 12 + 6]
    phase[lone] = 1
    phase[pair] = 0
    position = np.vstack([position, [[40.0, 40.0]]])                # spray has no neighbors at all
    found = np.flatnonzero(isolated(position, np.append(phase, 0), 2, 2.5))
    assert found.tolist() == [lone, *pair]                          # each of the pair has one of 20 like itself


# All stages

@pytest.mark.thorough
def test_all_stages_by_command_line(base, tmp_path):
    (tmp_path / "scene.json").write_text(base.to_json())

    def stage(name, *arguments):
        words = [tmp_path / word if "." in word or word in FOLDERS else word for word in arguments]
        done = forked.run(f"pipeline.{name}", *words)
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert "container of 1.2 x 0.8 m" in stage("eye", "scene.json", "--output", "eye.vtp", "--report", "eye.json")
    printed = stage("voxelize", "scene.json", "eye.vtp", "--output", "initial.npz", "--report", "voxelize.json")
    assert "liquid volume 36.67 % of the container" in printed
    stage("simulate", "scene.json", "initial.npz", "--frames", "frames", "--checkpoint", "end.npz")
    stage("reconstruct", "scene.json", "initial.npz", "frames", "--output", "surfaces")
    stage("render", "scene.json", "initial.npz", "eye.vtp", "frames", "surfaces", "--output", "images")
    stage("metrics", "scene.json", "initial.npz", "frames", "--output", "metrics.csv", "--summary", "metrics.html",
          "--plots", "plots")
    stage("movie", "images", "--output", "movie.mp4")
    stage("index_run", "scene.json", "eye.vtp", "--frames", "frames", "--surfaces", "surfaces", "--output", "run.pvd")

    frames = [read_frame(path) for path in find_frames(tmp_path / "frames")]
    assert len(frames) == 3 and frames[-1].dimension == 2
    first, last = (frame.position[frame.phase == 1].mean(axis=0) for frame in (frames[0], frames[-1]))
    # The second block flies freely: 1 m/s upward for 40 ms against gravity.
    np.testing.assert_allclose(last - first, [0.0, 0.04 - 0.5 * 9.81 * 0.04**2], atol=1e-3)
    lines = lines_of(pyvista.read(tmp_path / "surfaces" / "frame_00002_silicone_oil_1000.vtp"))
    assert all(np.array_equal(line[0], line[-1]) for line in lines) and not np.concatenate(lines)[:, 2].any()
    numbers = json.loads((tmp_path / "surfaces" / "frame_00002.json").read_text())["liquids"]["silicone_oil_1000"]
    assert numbers["volume"] == pytest.approx(0.152, rel=0.01) and numbers["watertight"]
    table = read_table(tmp_path / "metrics.csv")
    assert "isolated_particles_aqueous [1]" in table and "wall_coverage [%]" not in table
    np.testing.assert_allclose(table["volume_aqueous [mL]"], 0.2e6, rtol=1e-5)
    assert "wall_coverage.png" not in {path.name for path in (tmp_path / "plots").iterdir()}
    assert sorted(path.name for path in (tmp_path / "images").iterdir()) == [f"frame_{k:05d}.png" for k in range(3)]
    assert (tmp_path / "movie.mp4").stat().st_size > 1000
    parts = pyvista.PVDReader(tmp_path / "run.pvd").read()[0]
    assert set(parts.keys()) == {"particles", "aqueous", "silicone_oil_1000", "interface", "wall"}
    assert parts["silicone_oil_1000"].length > 0.0 and not len(parts["interface"].faces)


FOLDERS = ("frames", "surfaces", "images", "plots")


@pytest.mark.thorough
def test_fixed_time_step_is_kept_and_stops_where_it_is_unstable(anew, write):
    from pipeline.simulation.solver_setup import build_solver
    from sim.solver import Divergence

    text = "extends: base\nnumerics: {time_step: 0.1 ms, precision: f64}\n"
    scene = load_scene(write(text), "draft")
    solver = build_solver(scene, container_arrays(scene))
    steps = list(solver.advance(5e-4))
    np.testing.assert_allclose(steps, 1e-4, rtol=1e-9)
    assert solver.time == 5e-4
    velocity = solver.particles.to_numpy("velocity")
    velocity[0] = [500.0, 0.0]
    solver.particles.from_numpy("velocity", velocity)
    with pytest.raises(Divergence, match=r"fixed time step of 0.0001 s \(numerics.time_step\) is above the largest"):
        solver.step()


@pytest.mark.thorough
def test_solve_that_ends_at_its_limit_is_reported(anew, write, tmp_path, capsys):
    from pipeline.simulate import simulate_segment
    from pipeline.simulation.runner import Runner
    from pipeline.simulation.solver_setup import build_solver

    text = "extends: base\nnumerics: {scheme: volume_incompressible, maximum_iterations: 1}\n"
    scene = load_scene(write(text), "draft")
    simulate_segment(scene, Runner(build_solver(scene, container_arrays(scene))), 0, tmp_path)
    assert "the pressure solve ended at its limit of 1 iterations (numerics.maximum_iterations) in" in (
        capsys.readouterr().out)
    share = read_frame(find_frames(tmp_path)[-1]).statistics["pressure_limit_hit"]
    assert 0.0 < share <= 1.0


def test_frame_holds_velocities_energies_and_the_gravity_of_its_time(taichi, write):
    turns = "effects: {gravity: {turns: [{start: 1 s, to: left_side, duration: 1 s}]}}"
    scene = load_scene(write(f"extends: base\n{turns}\n"), "draft")
    solver = solver_setup.build_solver(scene, container_arrays(scene))
    solver.prepare_output()
    first = solver_setup.frame_of(scene, solver, {})
    solver.time = 3.0
    later = solver_setup.frame_of(scene, solver, {"time_step": 0.5})
    np.testing.assert_allclose(first.gravity, [0.0, -9.81, 0.0], atol=1e-12)
    np.testing.assert_allclose(later.gravity, [9.81, 0.0, 0.0], atol=1e-12)
    assert (first.time, later.time) == (0.0, 3.0) and later.statistics["time_step"] == 0.5
    oil = first.phase == 1
    np.testing.assert_allclose(first.velocity, np.outer(oil, [0.0, 1.0, 0.0]), atol=1e-12)
    density = scene.liquids[1].density
    assert first.statistics["kinetic_energy"] == pytest.approx(0.5 * density * 0.38 * 0.4)
    mass = first.volume * np.where(oil, density, scene.liquids[0].density)
    assert first.statistics["potential_energy"] == pytest.approx(9.81 * mass @ first.position[:, 1])


@pytest.mark.parametrize("scheme, place", [("dfsph", "schemes.dfsph"), ("wcsph", "equation of state"),
                                           ("position_based", "schemes.position_based.iterations")])
def test_numbers_that_a_scheme_does_not_read_are_refused(write, scheme, place):
    def refusal(text: str) -> str:
        with pytest.raises(UserError, match=rf"is not read by the scheme {scheme}: .*{place}") as caught:
            load_scene(write(text), "draft")
        return str(caught.value)

    text = f"extends: base\nnumerics: {{scheme: {scheme}, pressure_tolerance: 1.0e-5}}\n"
    assert "numerics.pressure_tolerance" in refusal(text)
    text = f"extends: base\nlevels: {{draft: {{maximum_iterations: 7}}}}\nnumerics: {{scheme: {scheme}}}\n"
    assert "levels.draft.maximum_iterations" in refusal(text)
    load_scene(write(text), "fine")
    load_scene(write(f"{text}effects: {{viscosity_implicit: {{}}}}\n"), "draft")  # which reads it


@pytest.mark.thorough
def test_limit_of_another_scheme_is_quoted_by_its_own_key(taichi, write, tmp_path, capsys):
    from pipeline.simulate import simulate_segment
    from pipeline.simulation.runner import Runner
    from pipeline.simulation.solver_setup import build_solver

    chosen = "schemes: {dfsph: {maximum_iterations: 3, density_error: 1.0e-7}}\n"
    text = f"extends: base\nnumerics: {{scheme: dfsph}}\n{chosen}"
    scene = load_scene(write(text), "draft")
    simulate_segment(scene, Runner(build_solver(scene, container_arrays(scene))), 0, tmp_path)
    assert "the pressure solve ended at its limit of 3 iterations (schemes.dfsph.maximum_iterations) in" in (
        capsys.readouterr().out)
