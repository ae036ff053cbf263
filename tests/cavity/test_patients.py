"""Eyes of patients: buckle, staphyloma, anterior chamber, landmarks of a mesh, and what is refused."""
import json

import numpy as np
import pytest
import trimesh
from conftest import ROOT
from helpers import forked

from pipeline.base.errors import UserError
from pipeline.cavity.landmarks import laid
from pipeline.cavity.regions import CILIARY_BODY, CORNEA, regions_of
from pipeline.cavity.surface import cavity_mesh
from pipeline.scenes.eye_shape import CORNEA_TO_GLOBE, eye_mesh, eye_shape, imaged_volume, shape_of
from pipeline.scenes.folders import scene_path
from pipeline.scenes.load import load_scene
from pipeline.scenes.model import Buckle, Eye, Landmarks, Staphyloma

HEAD = ROOT / "config" / "meshes" / "mean_head_right_eye.ply"


def radius_at(mesh: trimesh.Trimesh, meridian: float, latitude: float) -> float:
    """Distance from the center of the globe to the wall, m, at a meridian and a latitude in degrees."""
    around, down = np.radians([meridian, latitude])
    direction = np.array([np.sin(down) * np.sin(around), np.sin(down) * np.cos(around), -np.cos(down)])
    arm = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
    return float(np.linalg.norm(mesh.vertices[(arm @ direction).argmax()]))


@pytest.fixture(scope="module")
def plain():
    return eye_mesh(eye_shape())


def test_a_band_presses_the_wall_in_by_its_height_all_around(plain):
    buckled = eye_mesh(eye_shape(buckle=Buckle(0.002, latitude=np.radians(90.0))))
    assert buckled.is_watertight and buckled.volume < plain.volume - 0.3e-6
    for meridian in (0.0, 90.0, 200.0):
        assert radius_at(plain, meridian, 90.0) - radius_at(buckled, meridian, 90.0) == pytest.approx(2e-3, abs=0.1e-3)
        assert radius_at(plain, meridian, 40.0) == pytest.approx(radius_at(buckled, meridian, 40.0), abs=0.05e-3)


def test_a_buckle_with_clock_hours_is_between_them_as_an_observer_sees_them(plain):
    """From 2 to 4 o'clock is on the patient's left, and from 11 to 1 goes through 12."""
    for hours, inside, outside in (((2, 4), 90.0, 270.0), ((11, 1), 0.0, 180.0)):
        buckled = eye_mesh(eye_shape(buckle=Buckle(0.002, latitude=np.radians(90.0), clock_hours=hours)))
        assert radius_at(plain, inside, 90.0) - radius_at(buckled, inside, 90.0) == pytest.approx(2e-3, abs=0.1e-3)
        assert radius_at(plain, outside, 90.0) == pytest.approx(radius_at(buckled, outside, 90.0), abs=0.05e-3)


@pytest.mark.parametrize(("angle", "hour"), [(0.0, 6.0), (20.0, 6.0), (60.0, 3.0)])
def test_a_staphyloma_bulges_where_it_is_and_the_axial_length_is_as_measured(angle, hour):
    shape = eye_shape(0.030, staphyloma=Staphyloma(0.003, angle=np.radians(angle), clock_hour=hour))
    globe = eye_shape(2.0 * shape.half_axes[2] + CORNEA_TO_GLOBE, horizontal_diameter=2.0 * shape.half_axes[0],
                      vertical_diameter=2.0 * shape.half_axes[1])
    bulged, even = eye_mesh(shape), eye_mesh(globe)
    bulge = radius_at(bulged, 30.0 * hour, angle) - radius_at(even, 30.0 * hour, angle)
    assert bulge == pytest.approx(3e-3, abs=0.2e-3)
    assert radius_at(bulged, 0.0, 0.0) + shape.half_axes[2] + CORNEA_TO_GLOBE == pytest.approx(0.030, abs=0.05e-3)


def test_oil_in_the_anterior_chamber_reaches_the_cornea_through_the_pupil():
    mesh, report = cavity_mesh(Eye(lens="aphakic", anterior_chamber=True, pupil=0.006))
    shape = shape_of(Eye(lens="aphakic", anterior_chamber=True, pupil=0.006))
    assert mesh.is_watertight and mesh.body_count == 1
    assert mesh.bounds[1, 2] == pytest.approx(shape.cornea, abs=0.05e-3)
    waist = np.hypot(*mesh.vertices[np.abs(mesh.vertices[:, 2] - shape.front) < 0.05e-3, :2].T)
    assert waist.min() == pytest.approx(0.003, abs=0.1e-3)
    before = mesh.triangles_center[mesh.triangles_center[:, 2] > shape.front + 0.1e-3]
    assert set(np.unique(regions_of(before, shape))) == {CILIARY_BODY, CORNEA}
    # Gullstrand's chamber holds 0.2 to 0.35 mL; the wedge of the iris takes some.
    assert 0.1e-6 < _volume_above(mesh, shape.front) < 0.35e-6
    assert report["deviation_from_published"] > 0.0


def _volume_above(mesh: trimesh.Trimesh, height: float) -> float:
    z = mesh.triangles[:, :, 2]
    a, b, c = np.moveaxis(mesh.triangles, 1, 0)
    area = 0.5 * np.cross(b - a, c - a)[:, 2]
    return float((area * np.maximum(z.mean(axis=1) - height, 0.0)).sum())


@pytest.mark.thorough
def test_the_log_tells_the_volume_beside_two_published_ones(tmp_path):
    scene = load_scene(ROOT / "config" / "scenes" / "resting_eye.yaml")
    (tmp_path / "scene.json").write_text(scene.to_json())
    done = forked.run("pipeline.eye", tmp_path / "scene.json", "--output", tmp_path / "eye.vtp", "--report",
                      tmp_path / "eye.json")
    assert done.returncode == 0, done.stderr
    assert "cavity 5.05 mL; expected of 24 mm: 5.05 mL (144 operated eyes" in done.stdout
    assert "4.67 mL (imaged eyes, Zhou et al. 2020, doi:10.1097/MD.0000000000022685)" in done.stdout
    assert json.loads((tmp_path / "eye.json").read_text())["published_volume"] == pytest.approx(5.05e-6, rel=1e-3)


def test_imaged_eyes_hold_what_was_published():
    """[zhou2020, abstract]: 458.35 and 546.27 uL per mm, at the mean lengths of the two groups."""
    assert imaged_volume(0.0231) == pytest.approx(4.257e-6, rel=1e-3)
    assert imaged_volume(0.0283) == pytest.approx(8.482e-6, rel=1e-3)


REFUSED = {
    "buckle that is too high": ("eye: {buckle: {height: 9 mm}}",
                                'eye.buckle.height is "9 mm", but must be above 0 m and at most'),
    "buckle of one hour": ("eye: {buckle: {height: 2 mm, clock_hours: [3, 3]}}",
                           "eye.buckle.clock_hours are 3 and 3"),
    "hour 13": ("eye: {buckle: {height: 2 mm, clock_hours: [3, 13]}}", "at most 12"),
    "buckle without height": ("eye: {buckle: {}}", "eye.buckle.height is missing (depth of the indentation)"),
    "buckle behind the ora": ("eye: {buckle: {height: 2 mm, latitude: 130 deg}}", "eye.buckle.latitude"),
    "staphyloma in front": ("eye: {staphyloma: {depth: 2 mm, angle: 120 deg}}", "eye.staphyloma.angle"),
    "chamber behind a lens": ("eye: {anterior_chamber: true}", "eye.anterior_chamber is filled, but lens is phakic"),
    "landmarks of a model": ("eye: {landmarks: {}}", "eye.landmarks are given, but model is parametric"),
    "hidden wall": ("eye: {lens: aphakic, anterior_chamber: true, "
                    "buckle: {height: 5 mm, width: 2 mm, latitude: 115 deg}}",
                    "hidden from every point of the optic axis"),
}


@pytest.mark.parametrize("words", REFUSED)
def test_impossible_eyes_are_refused_in_one_sentence(words, tmp_path):
    said, expected = REFUSED[words]
    path = tmp_path / "patient.yaml"
    path.write_text(scene_path("still_eye", ROOT / "config" / "scenes").read_text().replace("extends: tamponade", "")
                    + f"liquids: [aqueous, silicone_oil_1000]\n{said}\n")
    with pytest.raises(UserError) as error:
        load_scene(path, config_dir=ROOT / "config")
    about = [line for line in error.value.messages if "eye." in line]
    assert len(about) == 1 and expected in about[0]


TURN = trimesh.transformations.euler_matrix(0.4, -1.1, 2.0)
TURN[:3, 3] = 0.03, -0.02, 0.05


def placed(points) -> np.ndarray:
    return trimesh.transformations.transform_points(np.atleast_2d(points), TURN)


@pytest.fixture(scope="module")
def elsewhere(plain):
    """Return the default eye, turned and moved."""
    mesh = plain.copy()
    mesh.apply_transform(TURN)
    return mesh


def direction(vector) -> tuple:
    return tuple(TURN[:3, :3] @ vector)


def test_a_mesh_is_turned_by_its_landmarks(elsewhere, plain):
    back = plain.bounds[0, 2]
    points = {"fovea": placed([0, 0, back])[0], "corneal_apex": placed([0, 0, 0.0127])[0],
              "optic_disc": placed([4.72e-3 * np.cos(np.radians(7.0)), 4.72e-3 * np.sin(np.radians(7.0)), -10.2e-3])[0]}
    mesh, said = laid(elsewhere, Landmarks(**{name: tuple(point) for name, point in points.items()},
                                           superior=direction([0, 1, 0])), "right", "eye.stl")
    assert not said
    np.testing.assert_allclose(mesh.bounds, plain.bounds, atol=0.4e-3)
    with pytest.raises(UserError, match=r"eye.landmarks.optic_disc\): is temporal of the fovea in a left eye"):
        laid(elsewhere, Landmarks(**{name: tuple(point) for name, point in points.items()},
                                  superior=direction([0, 1, 0])), "left", "eye.stl")


def test_landmarks_are_in_the_coordinates_of_a_file_far_from_the_origin(elsewhere, plain, tmp_path):
    elsewhere.copy().apply_scale(1e3).export(tmp_path / "eye.ply")
    marks = Landmarks(fovea=tuple(placed([0, 0, plain.bounds[0, 2]])[0]), superior=direction([0, 1, 0]))
    mesh, _ = cavity_mesh(Eye(model="mesh", path=str(tmp_path / "eye.ply"), landmarks=marks))
    np.testing.assert_allclose(mesh.bounds, plain.bounds, atol=0.4e-3)


def test_the_front_of_a_mesh_is_found_and_said(elsewhere, plain):
    mesh, said = laid(elsewhere, Landmarks(superior=direction([0, 1, 0])), "right", "eye.stl")
    np.testing.assert_allclose(mesh.bounds, plain.bounds, atol=0.4e-3)
    assert "the front was found" in said[0] and "superior is the direction" in said[1]


@pytest.mark.parametrize(("landmarks", "expected"), [
    (Landmarks(fovea=(0.1, 0.0, 0.0)), "mm off the surface"),
    (Landmarks(superior=direction([0, 0, 1])), "points along the axis of the eye"),
])
def test_landmarks_that_cannot_be_are_refused(elsewhere, landmarks, expected):
    with pytest.raises(UserError, match=expected) as error:
        laid(elsewhere, landmarks, "right", "eye.stl")
    assert "\n" not in str(error.value) and "eye.landmarks" in str(error.value)


def test_a_ball_has_no_front():
    with pytest.raises(UserError, match="the front cannot be found"):
        laid(trimesh.creation.icosphere(radius=0.011), Landmarks(), "right", "ball.stl")


def test_the_mesh_of_a_mean_head_is_an_eye_with_a_lens():
    mesh, report = cavity_mesh(Eye(model="mesh", path=str(HEAD), landmarks=Landmarks(superior=(0, 0, 1))))
    assert mesh.is_watertight and mesh.volume == pytest.approx(3.36e-6, rel=0.01)
    assert len(report["orientation"]) == 2
    near_axis = np.hypot(*mesh.vertices[:, :2].T) < 2e-3
    assert mesh.vertices[near_axis, 2].max() < mesh.vertices[:, 2].max() - 1e-3     # the dent of the lens
