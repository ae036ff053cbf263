"""A run opens in VTK and PyVista by the names of its parts, and its frames go out as STL, PLY and glTF."""
import dataclasses
import os
import shutil
import subprocess

import numpy as np
import pytest
import pyvista
import trimesh
from helpers.synthetic_frames import RADIUS, SPACING, ball, frame_of, lattice, oil_fraction

from pipeline import export, index_run
from pipeline.base import palette
from pipeline.base.errors import UserError
from pipeline.base.frame_files import frame_path, write_frame
from pipeline.base.vtk_files import text_of
from pipeline.cavity.surface import write_mesh
from pipeline.exchange.paraview_view import view_script
from pipeline.reconstruct import Wall, write_surfaces
from pipeline.scenes.load import load_scene
from pipeline.scenes.model import Break, Region
from pipeline.surfaces.liquid_surface import Reconstructor
from pipeline.surfaces.surface_files import read_surface

pytestmark = pytest.mark.usefixtures("taichi")
OIL, HEIGHT = "silicone_oil_1000", 2e-3
TEAR = Break("tear", hour=4.0, latitude=np.radians(70.0), width=2.0)


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory, taichi, request):
    """Return the folder of a run with two segments: water alone, then in the last frame oil above a plane."""
    folder = tmp_path_factory.mktemp("run")
    scene = load_scene(request.config.rootpath / "config" / "scenes" / "tiny.yaml", accuracy="draft")
    scene = dataclasses.replace(scene, breaks=(TEAR,), regions=(Region("behind", latitudes=(0.0, 0.5)),),
                                numerics=dataclasses.replace(scene.numerics, particle_spacing=SPACING),
                                output=dataclasses.replace(scene.output, duration=0.1, frames_per_segment=1))
    (folder / "scene.json").write_text(scene.to_json())
    sphere = pyvista.Icosphere(radius=RADIUS, nsub=4)
    write_mesh(trimesh.Trimesh(sphere.points, sphere.regular_faces, process=False), folder / "eye.vtp", scene.eye)
    position, reconstructor = lattice(), Reconstructor(ball(), 2)
    wall = Wall(scene, ball(), read_surface(folder / "eye.vtp"))
    water, oil = np.zeros(len(position)), oil_fraction(position, height=HEIGHT)
    for index, (segment, fraction) in enumerate(((0, water), (0, water), (1, oil))):
        path = frame_path(folder / "frames" / f"segment_{segment:03d}", index)
        frame = frame_of(position, fraction, time=0.05 * index)
        write_frame(path, frame)
        surfaces = folder / "surfaces" / path.parent.name
        surfaces.mkdir(parents=True, exist_ok=True)
        write_surfaces(surfaces, path, frame, reconstructor, wall=wall)
    return folder


def folders(run_folder, kind):
    return map(str, sorted((run_folder / kind).iterdir()))


@pytest.fixture(scope="module")
def indexed(run_folder):
    index_run.main([str(run_folder / "scene.json"), str(run_folder / "eye.vtp"), "--frames",
                    *folders(run_folder, "frames"), "--surfaces", *folders(run_folder, "surfaces"),
                    "--output", str(run_folder / "run.pvd")])
    return run_folder


def parts_at(folder, time):
    reader = pyvista.PVDReader(folder / "run.pvd")
    reader.set_active_time_value(time)
    return reader.read()[0]


@pytest.mark.thorough
def test_run_plays_with_named_parts_at_every_time(indexed):
    assert pyvista.PVDReader(indexed / "run.pvd").time_values == [0.0, 0.05, 0.1]
    for time in (0.0, 0.1):
        parts = parts_at(indexed, time)
        assert set(parts.keys()) == {"particles", "aqueous", OIL, "interface", "wall", "section", "coronal",
                                    "places"}
        for name in ("particles", "aqueous", OIL, "section", "interface"):
            assert parts[name].field_data["time"][0] == time, name
    assert parts_at(indexed, 0.0)[OIL].n_cells == 0 == parts_at(indexed, 0.0)["interface"].n_cells


@pytest.mark.thorough
def test_folder_of_a_run_can_be_moved(indexed, tmp_path):
    shutil.copytree(indexed, tmp_path / "moved")
    assert parts_at(tmp_path / "moved", 0.1)[OIL].n_cells > 100


def test_interface_is_the_surface_away_from_the_wall(indexed):
    interface = parts_at(indexed, 0.1)["interface"]
    assert np.abs(interface.points[:, 1] - HEIGHT).max() < 1.5 * SPACING
    assert interface.area == pytest.approx(np.pi * (RADIUS**2 - HEIGHT**2), rel=0.05)
    assert text_of(interface, "liquids").split("\n")[interface.cell_data["liquid"][0]] == OIL


def test_wall_has_regions_and_what_touches_it(indexed):
    wall = parts_at(indexed, 0.1)["wall"]
    names = text_of(wall, "regions").split("\n")
    center = wall.cell_centers().points
    angle = np.degrees(np.arccos(-center[:, 2] / np.linalg.norm(center, axis=1)))
    retina = np.isin(wall.cell_data["region"], [names.index("retina"), names.index("macula")])
    np.testing.assert_array_equal(retina, angle <= 115.0)
    assert (angle[wall.cell_data["region"] == names.index("macula")] < 16.0).all()
    high = wall.points[:, 1]
    # Under the wedge of its contact angle the oil does not touch the wall.
    assert (wall.point_data["contact_distance"][high > HEIGHT + 5 * SPACING] > 0.0).all()
    assert (wall.point_data["contact_distance"][high < HEIGHT - 2 * SPACING] < 0.0).all()


def test_fractions_carry_the_names_of_their_liquids(indexed):
    parts = parts_at(indexed, 0.1)
    for part, name in (("particles", "volume_fraction"), ("section", "fraction"), ("section", "dominance")):
        array = parts[part].GetPointData().GetArray(name)
        assert [array.GetComponentName(k) for k in range(2)] == ["aqueous", OIL]


def test_frame_without_surfaces_is_named(run_folder, tmp_path):
    with pytest.raises(UserError, match=r"frame_00002.vtu: has no surfaces; run the reconstruct stage"):
        index_run.main([str(run_folder / "scene.json"), str(run_folder / "eye.vtp"), "--frames",
                        *folders(run_folder, "frames"), "--surfaces", str(run_folder / "surfaces" / "segment_000"),
                        "--output", str(tmp_path / "run.pvd")])
    assert not list(tmp_path.iterdir())


def test_script_for_paraview_is_beside_the_run(indexed, tmp_path):
    script = indexed / "view_run.py"
    code = compile(script.read_text(), str(script), "exec")
    assert "@" not in script.read_text() and code
    pvpython = os.environ.get("PVPYTHON") or shutil.which("pvpython")
    if pvpython is None:
        pytest.skip("no pvpython on this machine")
    # Debian's ParaView draws in a window, and crashes without a display. It looks for one, leaves it and comes back: a
    # display that starts anew when it is left would not answer then.
    display = [] if os.environ.get("DISPLAY") else [
        shutil.which("xvfb-run"), "-a", "-s", "-noreset -screen 0 1280x1024x24"]
    if None in display:
        pytest.skip("pvpython needs a display, and there is no xvfb-run on this machine")
    picture = tmp_path / "picture.png"
    done = subprocess.run([*display, pvpython, script, picture], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0 and "Traceback" not in done.stderr and "ERR|" not in done.stderr, done.stderr
    pixels = pyvista.read(picture).point_data.active_scalars[:, :3].astype(int)
    oil, aqueous, red = (np.abs(pixels - color).max(axis=1) < 60 for color in
                         (palette.rgb(palette.OIL), palette.rgb(palette.AQUEOUS), [214, 39, 40]))
    assert min(oil.mean(), aqueous.mean()) > 0.05
    assert 2e-4 < red.mean() < 0.01, "edges of the break in one half of the eye"


@pytest.mark.parametrize("side, halves", [("right", '"temporal": 1.0,\n        "nasal": -1.0'),
                                          ("left", '"nasal": 1.0,\n        "temporal": -1.0')])
def test_halves_in_paraview_are_nasal_and_temporal(side, halves, tmp_path):
    """The camera on the patient's left sees the half on the right, which is temporal in a right eye."""
    scene = load_scene("config/scenes/tamponade.yaml", "draft")
    scene = dataclasses.replace(scene, eye=dataclasses.replace(scene.eye, side=side))
    assert halves in view_script(scene, tmp_path, painted=True)


@pytest.mark.parametrize(("unit", "factor"), [("m", 1.0), ("mm", 1e9)])
def test_frame_is_exported(run_folder, tmp_path, unit, factor, capsys):
    export.main([str(run_folder), "--format", "glb", "--format", "ply", "--format", "stl", "--unit", unit,
                 "--output", str(tmp_path)])
    expected = read_surface(run_folder / "surfaces" / "segment_001" / f"frame_00002_{OIL}.vtp").volume
    for suffix in ("ply", "stl"):
        mesh = trimesh.load(tmp_path / f"frame_00002_{OIL}.{suffix}")
        assert mesh.volume == pytest.approx(factor * expected, rel=1e-4) and mesh.is_watertight
    whole = trimesh.load(tmp_path / "frame_00002.glb")
    assert set(whole.graph.nodes_geometry) == {"aqueous", OIL, "wall"}
    assert whole.geometry[OIL].volume == pytest.approx(expected, rel=1e-4)
    assert whole.geometry["wall"].visual.material.alphaMode == "BLEND"
    assert len(capsys.readouterr().out.splitlines()) == 7


def test_frame_without_oil_is_exported_with_an_empty_file(run_folder, tmp_path):
    export.main([str(run_folder), "--frame", "0", "--format", "stl", "--format", "glb", "--output", str(tmp_path)])
    assert pyvista.read(tmp_path / f"frame_00000_{OIL}.stl").n_cells == 0
    assert set(trimesh.load(tmp_path / "frame_00000.glb").graph.nodes_geometry) == {"aqueous", "wall"}


def test_frame_that_is_not_there_is_refused(run_folder, tmp_path):
    with pytest.raises(UserError, match="--frame is 7, but must be one of 0 to 2"):
        export.main([str(run_folder), "--frame", "7", "--output", str(tmp_path)])
