"""Signed distance, liquid lattice and wall layers: against exact shapes, and in the eye."""
import dataclasses
import json

import numpy as np
import pytest
import trimesh
from conftest import ROOT
from helpers import forked
from helpers.cases import thorough
from scipy.spatial import cKDTree

from pipeline.base.errors import UserError
from pipeline.cavity.shapes import shape_arrays
from pipeline.cavity.signed_distance_grid import SignedDistance, distance_of_mesh
from pipeline.cavity.surface import cavity_mesh, write_mesh
from pipeline.cavity.voxels import nearest_distances, voxelize
from pipeline.scenes.eye_shape import eye_mesh, eye_shape
from pipeline.scenes.load import load_scene

TAMPONADE = ROOT / "config" / "scenes" / "tamponade.yaml"
RADIUS = 11e-3


def distance_in(arrays) -> SignedDistance:
    return SignedDistance(arrays["sdf_values"], arrays["sdf_origin"], float(arrays["sdf_cell"]))


def scene_with(**changes):
    """Return the tamponade scene in double precision (the one Taichi runs with here) with changed numerics."""
    scene = load_scene(TAMPONADE)
    numerics = dataclasses.replace(scene.numerics, precision="f64", threads=0, **changes)
    return dataclasses.replace(scene, numerics=numerics)


@pytest.mark.parametrize("kind, size, dimension", [
    ("circle", RADIUS, 2), thorough("sphere", RADIUS, 3), ("box", (20e-3, 10e-3), 2),
    ("box", (10e-3, 10e-3, 15e-3), 3)])
def test_shape_arrays_are_consistent(kind, size, dimension):
    spacing, layers = 1e-3, 3
    arrays = shape_arrays(kind, size, spacing, dimension=dimension, wall_layers=layers)
    fluid, wall, distance = arrays["fluid_position"], arrays["wall_position"], distance_in(arrays)
    volume = np.prod(size) if kind == "box" else np.pi * RADIUS**2 if dimension == 2 else 4 / 3 * np.pi * RADIUS**3
    assert arrays["cavity_volume"] == pytest.approx(volume)
    assert arrays["fluid_volume"].sum() == pytest.approx(volume, rel=1e-12)
    assert len(fluid) == round(volume / spacing**dimension)
    assert fluid.shape[1] == wall.shape[1] == distance.values.ndim == arrays["dimension"] == dimension
    assert distance.sample(fluid).max() < -0.34 * spacing
    np.testing.assert_allclose(distance.sample(wall), arrays["wall_distance"], atol=0.05 * spacing)
    assert nearest_distances(np.vstack([fluid, wall])).min() > 0.55 * spacing
    assert distance.volume_below() == pytest.approx(volume, rel=0.01)
    reach = [np.abs(distance.origin), np.abs(distance.origin + distance.cell * (np.array(distance.values.shape) - 1))]
    half = 0.5 * np.asarray(size) if kind == "box" else RADIUS
    assert (np.array(reach) >= half + 4.0 * spacing - 1e-12).all() and distance.cell == 0.5 * spacing


@pytest.mark.parametrize("dimension", [2, thorough(3)])
def test_wall_shells_of_a_ball_have_their_exact_volume(dimension):
    arrays = shape_arrays("circle", RADIUS, 1e-3, dimension=dimension)
    for layer in range(3):
        chosen = np.isclose(arrays["wall_distance"], (layer + 0.5) * 1e-3)
        outer, inner = (((RADIUS + depth) ** dimension) for depth in ((layer + 1) * 1e-3, layer * 1e-3))
        shell = (np.pi if dimension == 2 else 4 / 3 * np.pi) * (outer - inner)
        assert arrays["wall_volume"][chosen].sum() == pytest.approx(shell, rel=2e-3)
        assert shell / 1e-3**dimension == pytest.approx(chosen.sum(), rel=0.01)     # one particle per spacing^2


def test_box_is_a_perfect_lattice_with_its_walls():
    arrays = shape_arrays("box", (1.0, 2.0), 0.125, wall_layers=2)
    everything = np.vstack([arrays["fluid_position"], arrays["wall_position"]])
    assert len(everything) == (8 + 4) * (16 + 4)
    np.testing.assert_allclose(nearest_distances(everything), 0.125)
    np.testing.assert_allclose(np.concatenate([arrays["fluid_volume"], arrays["wall_volume"]]), 0.125**2)


@pytest.mark.parametrize("arguments, sentence", [
    (("cone", 1.0, 0.1), "kind is"), (("box", (1.0,), 0.1), "has 1 sides"),
    (("box", (1.0, 1.03), 0.1), "whole numbers")])
def test_impossible_shapes_are_refused(arguments, sentence):
    with pytest.raises(ValueError, match=sentence):
        shape_arrays(*arguments)


def test_distance_of_a_mesh_is_exact_near_it():
    """Against the distance to the sphere, of which the triangles are off by at most 0.3 % of the spacing."""
    spacing = 1e-3
    mesh = trimesh.creation.icosphere(subdivisions=5, radius=RADIUS)
    distance = distance_of_mesh(mesh, 0.5 * spacing, 4.0 * spacing)
    nodes = np.argwhere(distance.values > -np.inf)
    exact = np.linalg.norm(distance.origin + distance.cell * nodes, axis=1) - RADIUS
    error = np.abs(distance.values.ravel() - exact)
    assert error[np.abs(exact) < 4.0 * spacing].max() < 0.005 * spacing
    assert error.max() < 1.0 * distance.cell
    assert (np.sign(distance.values.ravel()) == np.sign(exact))[np.abs(exact) > 0.01 * spacing].all()
    assert distance.volume_below() == pytest.approx(mesh.volume, rel=1e-3)


def test_distance_of_coarse_triangles_and_turned_normals():
    """A box of 12 long triangles: inside a face the distance is the coordinate; the sign ignores the normals."""
    mesh = trimesh.creation.box((20e-3, 16e-3, 18e-3))
    mesh.faces[::2] = mesh.faces[::2, ::-1]
    distance = distance_of_mesh(mesh, 0.5e-3, 3e-3)
    points = np.random.default_rng(0).uniform(-12e-3, 12e-3, (500, 3))
    outside = np.abs(points) - [10e-3, 8e-3, 9e-3]
    exact = np.linalg.norm(np.maximum(outside, 0), axis=1) + np.minimum(outside.max(axis=1), 0)
    near = np.abs(exact) < 2e-3
    np.testing.assert_allclose(distance.sample(points[near]), exact[near], atol=0.12e-3)    # linear between nodes
    assert distance.volume_below() == pytest.approx(20e-3 * 16e-3 * 18e-3, rel=0.01)


@pytest.mark.thorough
def test_normal_and_projection():
    distance = distance_in(shape_arrays("sphere", RADIUS, 1e-3, dimension=3))
    points = np.random.default_rng(0).normal(size=(100, 3))
    points *= RADIUS / np.linalg.norm(points, axis=1, keepdims=True)
    np.testing.assert_allclose(distance.normal(points), points / RADIUS, atol=0.01)
    projected = distance.project(points, 1e-3)
    np.testing.assert_allclose(np.linalg.norm(projected, axis=1), RADIUS + 1e-3, atol=0.02e-3)


@pytest.fixture(scope="module")
def eye(taichi):
    """Return arrays and report of the default eye at a coarse spacing."""
    return voxelize(scene_with(particle_spacing=1e-3), eye_mesh(eye_shape()))


def test_eye_is_filled_to_its_volume(eye):
    arrays, report = eye
    assert abs(report["relative_volume_error"]) < 0.005
    assert arrays["fluid_volume"].sum() == pytest.approx(float(arrays["cavity_volume"]), rel=1e-12)
    assert len(arrays["fluid_position"]) == round(float(arrays["cavity_volume"]) / 1e-9)


def test_a_lattice_that_lies_elsewhere_fills_the_same_eye(eye):
    arrays, report = voxelize(scene_with(particle_spacing=1e-3), eye_mesh(eye_shape()), shift=(0.5, 0.25, 0.0))
    assert len(arrays["fluid_position"]) == len(eye[0]["fluid_position"])
    assert arrays["cavity_volume"] == eye[0]["cavity_volume"]
    assert nearest_between(arrays["fluid_position"], eye[0]["fluid_position"]) > 0.3e-3
    test_no_particle_outside_the_eye_and_none_clumped((arrays, report))


def nearest_between(one, other):
    """Median distance of points to the nearest of others."""
    return np.median(cKDTree(other).query(one)[0])


def test_no_particle_outside_the_eye_and_none_clumped(eye):
    arrays, report = eye
    depth = -distance_in(arrays).sample(arrays["fluid_position"])
    assert depth.min() > 0.15e-3 and np.percentile(depth, 1) > 0.3e-3
    assert report["spacing_smallest"] > 0.7 and report["spacing_1_percent"] > 0.85
    assert report["spacing_to_wall_smallest"] > 0.6


def test_packing_evens_the_compression_rate(eye):
    _, report = eye
    assert report["compression_mean"] == pytest.approx(1.0125, abs=0.005)   # measured for this kernel and support
    assert report["compression_spread"] < 0.008


def test_wall_layers_are_even(eye):
    arrays, report = eye
    distance = distance_in(arrays)
    assert len(report["wall_layers"]) == 3
    for layer in report["wall_layers"]:
        assert layer["spacing_1_percent"] > 0.85 and layer["spacing_smallest"] > 0.75
        assert 0.95 < layer["spacing_mean"] < 1.075       # 1.075: hexagons of the same area
    np.testing.assert_allclose(distance.sample(arrays["wall_position"]), arrays["wall_distance"], atol=0.02e-3)
    # A layer belongs to one shell: its volume is close to its area times the spacing.
    np.testing.assert_allclose(arrays["wall_volume"], 1e-9, rtol=0.02)
    gap = cKDTree(arrays["wall_position"]).query(distance.project(arrays["fluid_position"], 0.5e-3))[0]
    assert gap.max() < 0.95e-3                            # no opening in the first layer


@pytest.mark.thorough
@pytest.mark.parametrize("key, point, outside", [
    ("cannula", (0.0, 0.0, 0.020), "14 mm"), ("drain", (0.0, 0.012, 0.0), "0.73 mm"),
    ("drain", (0.0, 0.0, 0.006), "1.5 mm")])
def test_points_outside_the_eye_are_refused(key, point, outside):
    scene = scene_with(particle_spacing=1.5e-3)
    injection = dataclasses.replace(scene.effects["injection"], **{key: point})
    scene = dataclasses.replace(scene, effects=scene.effects | {"injection": injection})
    with pytest.raises(UserError) as error:
        voxelize(scene, eye_mesh(eye_shape()), "scene.json")
    coordinates = ", ".join(f"{1e3 * value:g}" for value in point)
    assert f"scene.json: effects.injection.{key}: ({coordinates}) mm lies {outside}" in str(error.value)


def test_spacing_too_large_for_the_eye_is_refused():
    with pytest.raises(UserError, match=r"particle_spacing: 3 mm leaves 188 particles .*at most 2.93 mm"):
        voxelize(scene_with(particle_spacing=3e-3), eye_mesh(eye_shape()))


@pytest.mark.thorough
def test_stage_writes_arrays_and_report(tmp_path):
    scene = scene_with(particle_spacing=2e-3)
    (tmp_path / "scene.json").write_text(scene.to_json())
    write_mesh(cavity_mesh(scene.eye)[0], tmp_path / "eye.vtp")
    result = forked.run("pipeline.voxelize", tmp_path / "scene.json", tmp_path / "eye.vtp", "--output",
                        tmp_path / "initial.npz", "--report", tmp_path / "voxelize.json")
    assert result.returncode == 0, result.stderr
    report = json.loads((tmp_path / "voxelize.json").read_text())
    with np.load(tmp_path / "initial.npz") as arrays:
        assert len(arrays["fluid_position"]) == report["fluid_particles"]
        assert len(arrays["wall_position"]) == report["wall_particles"]
        assert arrays["particle_spacing"] == 2e-3 and arrays["dimension"] == 3
    assert report["relative_volume_error"] < 0.01
