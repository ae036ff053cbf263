"""A run goes out as one USD file: its surfaces over time, in m, with y up, for Blender, Houdini and Quick Look."""
import dataclasses
import json
import resource
import shutil
import sys

import numpy as np
import pytest
import pyvista
import trimesh
from conftest import ROOT
from helpers.synthetic_frames import frame_of
from test_run_files import OIL

from pipeline import export
from pipeline.base.errors import UserError
from pipeline.base.frame_files import frame_path, write_frame
from pipeline.cavity.surface import write_mesh
from pipeline.exchange.mesh_formats import colors_of, linear
from pipeline.runs.run_folder import RunFolder
from pipeline.scenes.load import load_scene, scene_of_run
from pipeline.surfaces.contour import TriangleMesh
from pipeline.surfaces.surface_files import read_surface, surface_path, write_surface

pxr = pytest.importorskip("pxr", reason="usd-core is not installed (extra usd)")
sys.path.insert(0, str(ROOT / "tests" / "judges"))

import blender  # noqa: E402  the folder above is found first
from pxr import Gf, Usd, UsdGeom, UsdShade, UsdValidation  # noqa: E402

from pipeline.exchange.usd_film import FRAMES_PER_SAVE, time_codes_per_second, write_film  # noqa: E402

RADIUS, INTERVAL, LABEL = 11e-3, 0.1, "Illustrative time-lapse"
OIL_RADII = (0.0, 4e-3, 5e-3, 0.0, 6e-3)  # m, of every frame; the second and the third have as many triangles
DOWN = ((0.0, 0.0, -9.81), (0.0, 0.0, -9.81), (0.0, -9.81, 0.0), (0.0, -9.81, 0.0), (0.0, -9.81, 0.0))


def sphere(radius, cuts=2, shift=0.0):
    """A closed surface around a point of the x axis; none without a radius."""
    if not radius:
        return TriangleMesh(np.zeros((0, 3)), np.zeros((0, 3), int))
    ball = pyvista.Icosphere(radius=radius, nsub=cuts)
    return TriangleMesh(ball.points.astype(float) + np.array([shift, 0.0, 0.0]), ball.regular_faces)


def write_run(folder, radii=OIL_RADII, down=DOWN):
    """Write a run of one segment without a simulation: a ball of oil that comes and goes in a ball of aqueous."""
    scene = load_scene(ROOT / "config" / "scenes" / "tiny.yaml", accuracy="draft")
    duration = INTERVAL * (len(radii) - 1)
    scene = dataclasses.replace(scene, label=LABEL, output=dataclasses.replace(
        scene.output, duration=duration, frame_interval=INTERVAL, frames_per_segment=len(radii) - 1))
    (folder / "scene.json").write_text(scene.to_json())
    wall = sphere(RADIUS, 3)
    write_mesh(trimesh.Trimesh(wall.vertices, wall.triangles, process=False), folder / "eye.vtp", scene.eye)
    surfaces = folder / "surfaces" / "segment_000"
    surfaces.mkdir(parents=True)
    for number, (radius, gravity) in enumerate(zip(radii, down, strict=True)):
        path = frame_path(folder / "frames" / "segment_000", number)
        write_frame(path, frame_of(np.zeros((1, 3)), np.ones(1), time=INTERVAL * number, gravity=gravity))
        (surfaces / f"{path.stem}.json").write_text(json.dumps({"time": INTERVAL * number}))
        for liquid, mesh in (("aqueous", sphere(RADIUS)), (OIL, sphere(radius, 2, 1e-3 * number))):
            write_surface(surface_path(surfaces, path.stem, liquid), mesh, time=INTERVAL * number, liquid=liquid,
                          depth=np.zeros(len(mesh.vertices)))


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    write_run(folder)
    return folder


@pytest.fixture(scope="module")
def exported(run_folder):
    export.main([str(run_folder), "--format", "usd", "--format", "usdz"])
    return run_folder / "export"


@pytest.fixture
def stage(exported):
    return Usd.Stage.Open(str(exported / "run.usdc"))


def code_of(number):
    """Time code of a frame."""
    return round(24.0 * INTERVAL * number, 6)


def mesh_of(stage, name):
    return UsdGeom.Mesh(stage.GetDefaultPrim().GetPrimAtPath(f"surfaces/{name}"))


def volume_at(mesh, code):
    """Enclosed volume at a time code, m**3."""
    points, counts, index = (np.array(one.Get(code)) for one in (
        mesh.GetPointsAttr(), mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr()))
    if not len(points):
        return 0.0
    assert (counts == 3).all()
    a, b, c = points[index.reshape(-1, 3)].astype(float).transpose(1, 0, 2)
    return (np.cross(a, b) * c).sum() / 6.0


def test_units_axis_and_words(stage):
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0 and UsdGeom.GetStageUpAxis(stage) == "Y"
    assert stage.GetDefaultPrim().GetPath() == "/tiny"
    layer = stage.GetRootLayer()
    assert layer.documentation.startswith("Tiny tamponade") and LABEL in layer.comment
    assert layer.customLayerData["title"] == "Tiny tamponade" and layer.customLayerData["label"] == LABEL
    assert all(prim.GetDocumentation() for prim in stage.Traverse())
    assert {UsdGeom.Imageable(prim).ComputePurpose() for prim in stage.Traverse() if prim.IsA(UsdGeom.Imageable)} == {
        "default"}


def test_it_plays_in_real_time(stage):
    rate = stage.GetTimeCodesPerSecond()
    times = INTERVAL * np.arange(len(OIL_RADII))
    assert rate == stage.GetFramesPerSecond() == time_codes_per_second(INTERVAL) == 24.0
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0.0, 10.0), "the last of 0.4 s is at 9.6"
    for name in ("Visibility", "FaceVertexCounts", "Points", "Normals", "Extent"):
        codes = np.array(getattr(mesh_of(stage, OIL), f"Get{name}Attr")().GetTimeSamples())
        assert np.isclose(codes[:, None], rate * times, atol=1e-6).any(axis=0).all(), name
    assert not mesh_of(stage, "wall").GetPointsAttr().GetNumTimeSamples()


def test_volumes_are_those_of_the_surfaces(run_folder, stage):
    surfaces = run_folder / "surfaces" / "segment_000"
    for number in range(len(OIL_RADII)):
        code = code_of(number)
        for liquid in ("aqueous", OIL):
            expected = read_surface(surface_path(surfaces, f"frame_{number:05d}", liquid)).volume
            assert volume_at(mesh_of(stage, liquid), code) == pytest.approx(expected, rel=1e-6, abs=1e-15)
    wall = read_surface(run_folder / "eye.vtp").volume
    assert volume_at(mesh_of(stage, "wall"), 0.0) == pytest.approx(wall, rel=1e-6)


def test_liquid_that_is_not_there_is_invisible_and_comes_back(stage):
    mesh = mesh_of(stage, OIL)
    for number, radius in enumerate(OIL_RADII):
        code = code_of(number)
        assert mesh.ComputeVisibility(code) == ("inherited" if radius else "invisible")
        assert len(mesh.GetPointsAttr().Get(code)) == len(mesh.GetNormalsAttr().Get(code)) == (162 if radius else 0)
        low, high = np.array(mesh.GetExtentAttr().Get(code))
        np.testing.assert_allclose(high[1:] - low[1:], 2.0 * radius, rtol=0.06, atol=1e-12)


def test_surface_stays_until_the_next_one_also_where_both_have_as_many_points(stage):
    points = mesh_of(stage, OIL).GetPointsAttr()
    np.testing.assert_array_equal(points.Get(code_of(1.5)), points.Get(code_of(1)))
    assert np.abs(np.array(points.Get(code_of(2))) - np.array(points.Get(code_of(1)))).max() > 1e-3


def test_programs_without_time_show_the_end(stage):
    mesh = mesh_of(stage, OIL)
    assert volume_at(mesh, Usd.TimeCode.Default()) == volume_at(mesh, stage.GetEndTimeCode()) > 0.0


def test_gravity_turns(stage):
    gravity = stage.GetDefaultPrim().GetAttribute("userProperties:gravity")
    assert gravity.GetNumTimeSamples() == len(DOWN)
    for number, down in enumerate(DOWN):
        np.testing.assert_allclose(gravity.Get(code_of(number)), down)


def test_materials_have_the_colors_of_the_liquids(run_folder, stage):
    for name, (color, opacity) in colors_of(scene_of_run(run_folder)).items():
        mesh = mesh_of(stage, name)
        shader = UsdShade.MaterialBindingAPI(mesh.GetPrim()).ComputeBoundMaterial()[0].ComputeSurfaceSource()[0]
        np.testing.assert_allclose(shader.GetInput("diffuseColor").Get(), linear(color), rtol=1e-6)
        assert shader.GetInput("opacity").Get() == pytest.approx(opacity)
        assert mesh.GetDoubleSidedAttr().Get() and mesh.GetSubdivisionSchemeAttr().Get() == "none"


def test_camera_sees_the_whole_wall(run_folder, stage):
    frustum = UsdGeom.Camera(stage.GetDefaultPrim().GetPrimAtPath("camera")).GetCamera(0.0).frustum
    points = np.asarray(read_surface(run_folder / "eye.vtp").points, float)
    assert all(frustum.Intersects(Gf.Vec3d(*point)) for point in points[::7].tolist())
    assert not frustum.Intersects(Gf.Vec3d(0.0, 2.0 * RADIUS, 0.0)), "the wall is small in the picture"


@pytest.mark.parametrize("name", ["run.usdc", "run.usdz"])
def test_validators_of_usd_find_nothing(exported, name):
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    found = UsdValidation.ValidationContext(validators).Validate(Usd.Stage.Open(str(exported / name)))
    assert len(validators) > 20 and not [error.GetMessage() for error in found]


def test_package_has_no_lights(exported):
    stage = Usd.Stage.Open(str(exported / "run.usdz"))
    assert {prim.GetTypeName() for prim in stage.Traverse()} == {
        "Xform", "Scope", "Mesh", "Material", "Shader", "Camera"}
    assert volume_at(mesh_of(stage, OIL), stage.GetEndTimeCode()) > 0.0
    assert {path.name for path in exported.iterdir()} == {"run.usdc", "run.usdz"}


def test_what_is_saved_on_the_way_is_kept(tmp_path):
    count = FRAMES_PER_SAVE + 2
    write_run(tmp_path, (5e-3, 0.0) * (count // 2), ((0.0, -9.81, 0.0),) * count)
    frames = export.ready_frames(RunFolder(tmp_path))
    write_film(tmp_path / "film.usdc", frames, scene_of_run(tmp_path), tmp_path / "eye.vtp")
    stage = Usd.Stage.Open(str(tmp_path / "film.usdc"))
    volumes = [volume_at(mesh_of(stage, OIL), code_of(number)) for number in range(count)]
    assert (np.array(volumes) > 0.0).tolist() == [True, False] * (count // 2)


def test_run_without_usd_names_the_extra(run_folder, monkeypatch):
    monkeypatch.delitem(sys.modules, "pipeline.exchange.usd_film")
    monkeypatch.setitem(sys.modules, "pxr", None)
    with pytest.raises(UserError, match=r"usd-core, which is not installed: .* pip install 'eye-oil-pipeline\[usd\]'"):
        export.main([str(run_folder), "--format", "usd"])


def test_film_of_one_frame_is_refused(run_folder):
    with pytest.raises(UserError, match="--frame is 2, but --format usd holds all frames; leave --frame out"):
        export.main([str(run_folder), "--format", "usd", "--frame", "2"])


def test_unfinished_run_is_exported_as_far_as_it_is(run_folder, tmp_path, capsys):
    shutil.copytree(run_folder, tmp_path / "run")
    scene = json.loads((run_folder / "scene.json").read_text())
    scene["output"]["duration"] = 1.0
    (tmp_path / "run" / "scene.json").write_text(json.dumps(scene))
    export.main([str(tmp_path / "run"), "--format", "usd", "--output", str(tmp_path)])
    assert capsys.readouterr().out.splitlines() == [
        f"{tmp_path}/run.usdc",
        f"{tmp_path}/run: unfinished, 1 of 3 segments have surfaces; exported up to 0.4 s"]
    assert Usd.Stage.Open(str(tmp_path / "run.usdc")).GetEndTimeCode() == 10.0


def test_run_without_surfaces_is_refused(run_folder, tmp_path):
    shutil.copy(run_folder / "scene.json", tmp_path)
    with pytest.raises(UserError, match="surfaces: no surfaces there; run the scene, or its reconstruct stage, first"):
        export.main([str(tmp_path), "--format", "usd"])


def test_disk_that_is_full_leaves_nothing(run_folder, tmp_path):
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, limit[1]))
    try:
        for kind in ("usd", "usdz"):
            with pytest.raises(OSError, match=rf"run.{kind}.?: USD cannot write the file; is the disk full\?"):
                export.main([str(run_folder), "--format", kind, "--output", str(tmp_path)])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    assert not list(tmp_path.iterdir())


def test_blender_shows_the_run(run_folder):
    python = blender.found_python()
    if python is None:
        pytest.skip(f"no Python with Blender's module bpy on this machine ({blender.PYTHON} names one)")
    lines, wrong = blender.judged(run_folder, python)
    assert not wrong and len(lines) == 4
