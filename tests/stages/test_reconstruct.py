"""Surfaces: closed, at the wall without a gap, one interface for both liquids, and the volume of the particles."""
import dataclasses
import itertools
import json

import numpy as np
import pytest
import pyvista
import trimesh
from helpers.cases import thorough
from helpers.closed_meshes import assert_closed
from helpers.synthetic_frames import RADIUS, SPACING, ball, frame_of, lattice, oil_fraction
from scipy.spatial import cKDTree

from pipeline import reconstruct
from pipeline.base.errors import UserError
from pipeline.base.frame_files import frame_path, write_frame
from pipeline.base.vtk_files import text_of
from pipeline.cavity.initial_state import NAMES, save_initial
from pipeline.scenes.load import load_scene
from pipeline.surfaces.contour import contour
from pipeline.surfaces.fraction_field import smoothing_filter
from pipeline.surfaces.liquid_surface import Reconstructor
from pipeline.surfaces.surface_files import write_section

pytestmark = pytest.mark.usefixtures("taichi")
POSITION = lattice()
METHODS = ("sharp", "flying_edges", "marching_cubes")
CASES = {
    "flat": {"height": 2e-3},
    "tilted": {"height": -6e-3, "tilt": 0.4},
    "layered": {"height": 1e-3, "layer": 5e-3},
}


@pytest.fixture(scope="module")
def reconstructors():
    """Return one reconstructor per contour algorithm."""
    return {method: Reconstructor(ball(), 2, method=method) for method in METHODS}


@pytest.fixture(scope="module")
def reconstructor(reconstructors):
    return reconstructors["sharp"]


@pytest.mark.thorough
def test_stretched_kernels_keep_an_interface_flat():
    for surface in Reconstructor(ball(), 2, kernel="anisotropic").surfaces(frame_of(POSITION, oil_fraction(POSITION))):
        assert_closed(surface.mesh)
        assert abs(surface.statistics["volume_error"]) < 0.003
        center = surface.mesh.vertices[np.linalg.norm(surface.mesh.vertices, axis=1) < 0.6 * RADIUS]
        assert center[:, 1].std() < 0.1 * SPACING


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("method", METHODS)
def test_surfaces_are_closed_and_hold_the_volume(reconstructors, method, case):
    frame = frame_of(POSITION, oil_fraction(POSITION, **CASES[case]))
    for surface in reconstructors[method].surfaces(frame):
        assert_closed(surface.mesh)
        assert surface.statistics["watertight"] and surface.statistics["components"] == 1
        assert abs(surface.statistics["volume_error"]) < 0.01


@pytest.mark.parametrize("case", CASES)
def test_contours_agree(reconstructors, case):
    """Those of libraries cut off the edge at the contact line: up to half a cell of it."""
    frame = frame_of(POSITION, oil_fraction(POSITION, **CASES[case]))
    surfaces = {method: reconstructors[method].surfaces(frame) for method in METHODS}
    for method, other, share, cut in (("flying_edges", "marching_cubes", 0.99, 1e-3),
                                      ("sharp", "marching_cubes", 0.9, 5e-3)):
        for a, b in zip(surfaces[method], surfaces[other], strict=True):
            assert a.mesh.volume == pytest.approx(b.mesh.volume, rel=cut)
            distance, _ = cKDTree(a.mesh.vertices).query(b.mesh.vertices)
            assert np.quantile(distance, share) < 0.1 * SPACING and distance.max() < 0.5 * SPACING


def test_liquids_share_the_interface_and_touch_the_wall(reconstructor):
    frame = frame_of(POSITION, oil_fraction(POSITION, tilt=0.3))
    water, oil = (surface.mesh for surface in reconstructor.surfaces(frame))
    for mesh, other in ((water, oil), (oil, water)):
        radius = np.linalg.norm(mesh.vertices, axis=1)
        assert radius.max() < RADIUS + 0.02 * SPACING                      # nothing outside the eye
        inner = mesh.vertices[radius < RADIUS - SPACING]
        assert len(inner) > 100
        distance, _ = cKDTree(other.vertices).query(inner)
        assert distance.max() < 2e-3 * SPACING
    # Every direction well above the interface meets oil at the wall.
    wall = POSITION / np.linalg.norm(POSITION, axis=1, keepdims=True) * RADIUS
    above = wall @ np.array([0.0, np.cos(0.3), np.sin(0.3)]) > 2e-3 + 2.0 * SPACING
    distance, nearest = cKDTree(oil.vertices).query(wall[above])
    assert distance.max() < SPACING
    assert np.abs(np.linalg.norm(oil.vertices[nearest], axis=1) - RADIUS).max() < 0.03 * SPACING
    assert water.volume + oil.volume == pytest.approx(reconstructor.cavity_volume, rel=3e-3)
    assert reconstructor.cavity_volume == pytest.approx(4.0 / 3.0 * np.pi * RADIUS**3, rel=1e-3)


def test_interface_is_where_the_particles_are(reconstructor):
    oil = reconstructor.surfaces(frame_of(POSITION, oil_fraction(POSITION, height=0.0)))[1].mesh
    center = oil.vertices[np.linalg.norm(oil.vertices, axis=1) < 0.5 * RADIUS]
    assert abs(center[:, 1].mean()) < 0.25 * SPACING and center[:, 1].std() < 0.1 * SPACING


def test_liquid_without_particles_gives_an_empty_mesh(reconstructor):
    water, oil = reconstructor.surfaces(frame_of(POSITION, np.zeros(len(POSITION))))
    assert_closed(water.mesh)
    assert oil.mesh.volume == 0.0 and len(oil.mesh.triangles) == 0 and oil.statistics["watertight"]
    assert oil.statistics["volume_error"] == 0.0


def test_single_particles_become_droplets_of_their_volume(reconstructor):
    fraction = oil_fraction(POSITION, height=5e-3)
    below = np.flatnonzero((POSITION[:, 1] < 0) & (np.linalg.norm(POSITION, axis=1) < 0.7 * RADIUS))
    chosen = below[::80]
    fraction[chosen] = 1.0
    frame = frame_of(POSITION, fraction)
    oil = reconstructor.surfaces(frame)[1]
    assert_closed(oil.mesh)
    assert oil.statistics["droplets"] == len(chosen) and oil.statistics["components"] == len(chosen) + 1
    drops = oil.mesh.component_volumes()[1:]
    np.testing.assert_allclose(drops, frame.volume[0], rtol=0.05)


@pytest.mark.thorough_cases("1-anisotropic")
@pytest.mark.parametrize("kernel", ["isotropic", "anisotropic"])
@pytest.mark.parametrize("count", [1, 7, 50])
def test_drops_have_the_volume_of_their_particles(kernel, count):
    tree = cKDTree(POSITION)
    _, drops = tree.query(6e-3 * np.vstack([np.eye(3), -np.eye(3)]), count)
    fraction = np.zeros(len(POSITION))
    fraction[drops.ravel()] = 1.0
    frame = frame_of(POSITION, fraction)
    water, oil = Reconstructor(ball(), 2, kernel=kernel).surfaces(frame)
    assert_closed(oil.mesh)
    assert_closed(water.mesh)
    volumes = oil.mesh.component_volumes()
    assert len(volumes) == 6
    np.testing.assert_allclose(volumes, count * frame.volume[0], rtol=0.05)
    # What is a drop of one is a hollow in the other, to the last bit.
    hollow = {tuple(vertex) for vertex in water.mesh.vertices}
    assert all(tuple(vertex) in hollow for vertex in oil.mesh.vertices)


def test_contact_line_is_a_smooth_circle(reconstructor):
    normal, height = np.array([0.0, np.cos(0.3), np.sin(0.3)]), 2e-3
    oil = reconstructor.surfaces(frame_of(POSITION, oil_fraction(POSITION, height=height, tilt=0.3)))[1].mesh
    wall = (reconstructor.grid.depth_at(oil.vertices) < 0.02)[oil.triangles].all(axis=1)
    edges = np.sort(np.concatenate([oil.triangles[:, pair] for pair in ([0, 1], [1, 2], [2, 0])]), axis=1)
    of_wall = np.unique(edges[np.tile(wall, 3)], axis=0)
    of_interface = np.unique(edges[np.tile(~wall, 3)], axis=0)
    both, count = np.unique(np.concatenate([of_wall, of_interface]), axis=0, return_counts=True)
    rim = oil.vertices[both[count == 2]]
    length = np.linalg.norm(rim[:, 1] - rim[:, 0], axis=1).sum()
    radius = np.linalg.norm(rim.mean(axis=1) - np.outer(rim.mean(axis=1) @ normal, normal), axis=1)
    assert length == pytest.approx(2.0 * np.pi * radius.mean(), rel=0.03)       # no saw teeth
    assert radius.mean() == pytest.approx(np.sqrt(RADIUS**2 - height**2), abs=0.25 * SPACING)


@pytest.mark.thorough
def test_smoothing_does_not_depend_on_the_cell():
    frame, roughness = frame_of(POSITION, oil_fraction(POSITION, height=0.3e-3)), []
    for ratio in (0.5, 0.25):
        oil = Reconstructor(ball(), 2, cell_ratio=ratio).surfaces(frame)[1].mesh
        roughness.append(oil.vertices[np.linalg.norm(oil.vertices, axis=1) < 0.6 * RADIUS][:, 1].std())
    assert roughness[1] == pytest.approx(roughness[0], rel=0.1)


@pytest.mark.parametrize("kernel", ["isotropic", thorough("anisotropic")])
def test_kernels_do_not_shrink_a_ball_in_the_void(kernel):
    position, radius = lattice()[np.linalg.norm(lattice(), axis=1) < 7e-3], 7e-3
    arrays = ball() | {"wall_position": np.zeros((0, 3)), "wall_volume": np.zeros(0)}
    frame = frame_of(position, np.ones((len(position), 1)), volume=np.full(len(position), SPACING**3), liquids=("oil",))
    oil, = Reconstructor(arrays, 1, kernel=kernel, free_surface=True).surfaces(frame)
    assert_closed(oil.mesh)
    assert oil.mesh.volume == pytest.approx(len(position) * SPACING**3, rel=3e-3)
    assert np.linalg.norm(oil.mesh.vertices, axis=1).mean() == pytest.approx(radius, abs=0.1 * SPACING)


def test_volume_follows_particles_of_different_size(reconstructor):
    """Half of the oil's particles, each twice as large, are the same oil."""
    fraction = oil_fraction(POSITION, height=0.0)
    volume = frame_of(POSITION, fraction).volume
    oil = np.flatnonzero(fraction)
    keep = np.ones(len(POSITION), bool)
    keep[oil[::2]] = False
    grown = volume.copy()
    grown[oil] *= volume[oil].sum() / volume[oil[1::2]].sum()
    frame = frame_of(POSITION[keep], fraction[keep], volume=grown[keep])
    for surface in reconstructor.surfaces(frame):
        assert abs(surface.statistics["volume_error"]) < 0.01
        assert_closed(surface.mesh)


@pytest.mark.thorough
def test_three_liquids_and_one():
    height = POSITION[:, 1]
    fraction = np.column_stack([height < -3e-3, (height >= -3e-3) & (height < 4e-3), height >= 4e-3]).astype(float)
    frame = frame_of(POSITION, fraction, liquids=("heavy_oil", "aqueous", "silicone_oil_1000"))
    for surface in Reconstructor(ball(), 3).surfaces(frame):
        assert_closed(surface.mesh)
        assert abs(surface.statistics["volume_error"]) < 0.02
    alone, = Reconstructor(ball(), 1).surfaces(frame_of(POSITION, np.ones((len(POSITION), 1)), liquids=("aqueous",)))
    assert_closed(alone.mesh)
    assert abs(alone.statistics["volume_error"]) < 0.01


@pytest.mark.thorough
def test_smoothing_flattens_without_shrinking():
    frame = frame_of(POSITION, oil_fraction(POSITION, height=0.3e-3))
    roughness = []
    for length in (0.0, 1.0):
        oil = Reconstructor(ball(), 2, smoothing_length=length).surfaces(frame)[1]
        assert_closed(oil.mesh)
        assert abs(oil.statistics["volume_error"]) < 0.01
        center = oil.mesh.vertices[np.linalg.norm(oil.mesh.vertices, axis=1) < 0.6 * RADIUS]
        roughness.append(center[:, 1].std())
    assert roughness[1] < 0.8 * roughness[0]
    for length in (0.0, 1.0):
        assert smoothing_filter(length, 1.0).sum() == pytest.approx(1.0)


def test_same_frame_gives_the_same_bits(reconstructor):
    frame = frame_of(POSITION, oil_fraction(POSITION, tilt=0.2))
    first, second = reconstructor.surfaces(frame), reconstructor.surfaces(frame)
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a.mesh.vertices, b.mesh.vertices)
        np.testing.assert_array_equal(a.mesh.triangles, b.mesh.triangles)


@pytest.mark.thorough
def test_section_is_sharp_where_liquids_do_not_mix(reconstructor):
    reconstructor.surfaces(frame_of(POSITION, oil_fraction(POSITION)))
    for section in reconstructor.sections().values():
        inside = section.signed_distance < 0
        oil = section.fraction[inside][:, 1]
        assert (np.minimum(oil, 1.0 - oil) < 1e-6).all()
        np.testing.assert_array_equal(oil > 0.5, section.dominance[inside][:, 1] > 0)


def test_sections_lie_where_they_say(reconstructor, tmp_path):
    """Oil on the patient's left, above: the one through the optic axis shows what is above, the coronal one both."""
    side, up = POSITION[:, 0], POSITION[:, 1]
    reconstructor.surfaces(frame_of(POSITION, ((side > 0.0) & (up > -2e-3)).astype(float)))
    for name, section in reconstructor.sections().items():
        write_section(tmp_path / f"{name}.vti", section, time=0.0, liquids=("aqueous", "oil"))
        image = pyvista.read(tmp_path / f"{name}.vti")
        points, inside = np.asarray(image.points), image.point_data["signed_distance"] < -0.9e-3
        oil = image.point_data["fraction"][:, 1] > 0.5
        assert np.ptp(points[:, 0 if name == "section" else 2]) == 0.0
        assert np.hypot(*points[inside][:, [1, 2] if name == "section" else [0, 1]].T).max() < RADIUS
        right, left = (oil[inside & (sign * points[:, 0] > SPACING) & (points[:, 1] > 0.0)] for sign in (-1.0, 1.0))
        assert name == "section" or (left.all() and not right.any())
        assert not oil[inside & (points[:, 1] < -2e-3 - SPACING)].any()


@pytest.mark.parametrize("method", ["flying_edges", "marching_cubes"])
def test_values_on_the_level_and_at_the_border_stay_closed(method):
    field = np.ones((7, 8, 9))
    field[2:5, 2:5, 2:5] = 0.0
    mesh = contour(field, np.zeros(3), 1.0, method)
    assert_closed(mesh)
    assert len(mesh.component_volumes()) == 2


def scene_files(folder, **output):
    """Write a resolved scene, initial.npz and two frames; return the arguments of the stage."""
    scene = load_scene("config/scenes/tiny.yaml", accuracy="draft")
    scene = dataclasses.replace(scene, output=dataclasses.replace(scene.output, **output))
    (folder / "scene.json").write_text(scene.to_json())
    save_initial(folder / "initial.npz", dict.fromkeys(NAMES, 0) | ball())
    for index, fraction in enumerate((np.zeros(len(POSITION)), oil_fraction(POSITION))):
        write_frame(frame_path(folder / "frames", index), frame_of(POSITION, fraction, time=0.1 * index))
    return [str(folder / name) for name in ("scene.json", "initial.npz", "frames")]


@pytest.fixture
def started(monkeypatch):
    """Keep the stage from starting Taichi again in single precision."""
    monkeypatch.setattr("sim.backend.runtime.initialize", lambda *_, **more: None)


@pytest.mark.thorough
def test_stage_writes_surfaces_sections_and_numbers(tmp_path, monkeypatch, started, request):
    monkeypatch.chdir(request.config.rootpath)
    arguments = scene_files(tmp_path)
    out = tmp_path / "surfaces"
    reconstruct.main([*arguments, "--output", str(out), "--format", "ply", "--format", "stl"])
    numbers = json.loads((out / "frame_00001.json").read_text())["liquids"]["silicone_oil_1000"]
    surface = pyvista.read(out / "frame_00001_silicone_oil_1000.vtp")
    assert surface.volume == pytest.approx(numbers["volume"], rel=1e-4) and surface.is_manifold
    assert surface.point_data["depth"].min() > -1e-2 * SPACING
    for suffix in ("ply", "stl"):
        assert trimesh.load(out / f"frame_00001_silicone_oil_1000.{suffix}").volume == pytest.approx(
            numbers["volume"], rel=1e-3)
        assert pyvista.read(out / f"frame_00000_silicone_oil_1000.{suffix}").n_cells == 0
    empty = pyvista.read(out / "frame_00000_silicone_oil_1000.vtp")
    assert empty.n_cells == 0 and text_of(empty, "liquid") == "silicone_oil_1000"
    for plane, name in itertools.product(("section", "coronal"), ("fraction", "dominance")):
        section = pyvista.read(out / f"frame_00001_{plane}.vti")
        array = section.GetPointData().GetArray(name)
        assert [array.GetComponentName(k) for k in range(2)] == ["aqueous", "silicone_oil_1000"]
        assert section.field_data["time"][0] == 0.1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["frames", "initial.npz", "scene.json", "surfaces"]


def test_stage_names_what_is_missing(tmp_path, monkeypatch, started, request):
    monkeypatch.chdir(request.config.rootpath)
    arguments = scene_files(tmp_path)
    (tmp_path / "initial.npz").write_bytes(b"no archive")
    with pytest.raises(UserError, match=r"initial.npz: is damaged"):
        reconstruct.main([*arguments, "--output", str(tmp_path / "surfaces")])
    (tmp_path / "initial.npz").unlink()
    with pytest.raises(UserError, match="run the voxelize stage"):
        reconstruct.main([*arguments, "--output", str(tmp_path / "surfaces")])


def test_wrong_volume_stops_the_stage(reconstructor):
    surface = reconstructor.surfaces(frame_of(POSITION, oil_fraction(POSITION)))[1]
    surface.statistics.update(volume_error=0.03)
    with pytest.raises(UserError, match=r"surface of oil holds .* mL"):
        reconstruct.check("frame", ("oil",), [surface], mixed=False)
    reconstruct.check("frame", ("oil",), [surface], mixed=True)
    surface.statistics.update(bulk_particles=10)
    reconstruct.check("frame", ("oil",), [surface], mixed=False)
    surface.statistics.update(watertight=False)
    with pytest.raises(UserError, match="not closed"):
        reconstruct.check("frame", ("oil",), [surface], mixed=True)
