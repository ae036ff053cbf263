"""Meshes as clinics and programs write them: where they lie, how vertices are spread, dialects, steps of voxels."""
import json

import meshio
import numpy as np
import pytest
import pyvista
import trimesh
from conftest import ROOT
from helpers import forked
from helpers.mesh_dialects import (
    ball_of_polygons,
    big_endian_stl,
    binary_stl,
    comma,
    obj,
    ply,
    ply_of,
    ply_of_strips,
    text_stl,
)
from skimage.measure import marching_cubes

from pipeline.base.errors import UserError
from pipeline.cavity.globe import globe_center
from pipeline.cavity.landmarks import laid
from pipeline.cavity.mesh_import import import_mesh
from pipeline.scenes.eye_shape import eye_mesh, eye_shape

SHAPE = eye_shape()


@pytest.fixture(scope="module")
def eye():
    """The default eye in mm."""
    return eye_mesh(SHAPE).apply_scale(1e3)


def read(mesh, folder, name="eye.ply", **options):
    mesh.export(folder / name)
    return import_mesh(folder / name, **options)


def lying(mesh, folder, comment="", name="eye.ply"):
    """Return a mesh as the eye stage lays it, and what is said of that; `comment` goes into the head of the file."""
    mesh.export(folder / name, encoding="ascii")
    text = (folder / name).read_text()
    if comment:
        (folder / name).write_text(text.replace("\nelement vertex", f"\ncomment {comment}\nelement vertex", 1))
    imported = import_mesh(folder / name)
    return laid(imported.mesh, None, "right", name, imported.space)


def same(one, other, within=1e-6):
    """Whether two surfaces with the same triangles lie at the same place, m."""
    return np.abs(one.vertices - other.vertices).max() < within


# Where it lies

@pytest.mark.parametrize("place", [(0.9, 0.0, 0.0), (-2.0, 1.0, 2.0), (30.0, -20.0, 5.0), (-400.0, 900.0, 1500.0)])
def test_the_place_in_the_file_changes_nothing(eye, tmp_path, place):
    here = read(eye, tmp_path).mesh
    there = read(eye.copy().apply_translation(place), tmp_path).mesh
    assert same(here, there, 1e-6)
    assert np.linalg.norm(globe_center(here)) < 1e-9


@pytest.mark.parametrize("lens", ["phakic", "pseudophakic", "aphakic"])
@pytest.mark.parametrize("length", [0.020, 0.024, 0.032])
def test_the_center_of_the_globe_is_found_behind_every_lens(lens, length):
    assert np.linalg.norm(globe_center(eye_mesh(eye_shape(length, lens=lens)))) < 0.1e-3


def test_the_spread_of_vertices_changes_nothing(eye):
    """One side is cut up sixteen times finer; the center of the vertices moves by millimeters."""
    side = eye.triangles_center[:, 0] > 6.0
    fine = eye
    for _ in range(2):
        side = fine.triangles_center[:, 0] > 6.0
        fine = fine.subdivide(face_index=np.flatnonzero(side))
    assert np.linalg.norm(fine.vertices.mean(axis=0) - eye.vertices.mean(axis=0)) > 1.0
    assert np.linalg.norm(globe_center(fine) - globe_center(eye)) < 0.02


def test_a_spike_is_told_and_moves_nothing(eye, tmp_path):
    spiked = eye.copy()
    spiked.vertices[eye.vertices[:, 0].argmax()] *= 2.2
    imported = read(spiked, tmp_path, force=True)
    assert any("has a spike: its point (" in one for one in imported.warnings)
    assert np.abs(np.median(imported.mesh.vertices - read(eye, tmp_path).mesh.vertices, axis=0)).max() < 0.05e-3


# How it lies

AXES = {"LPS": lambda p: p[:, [0, 2, 1]] * [1, -1, 1], "RAS": lambda p: p[:, [0, 2, 1]] * [-1, 1, 1]}


@pytest.mark.parametrize("space", AXES)
@pytest.mark.parametrize("told", [True, False])
def test_axes_of_segmentations_are_told_by_the_head_or_found_by_the_flat_side(eye, tmp_path, space, told):
    expected = lying(eye, tmp_path)[0]
    other = trimesh.Trimesh(AXES[space](eye.vertices), eye.faces, process=False)
    mesh, said = lying(other, tmp_path, f"SPACE={space}" if told else "")
    assert same(mesh, expected, 2e-6) and mesh.volume > 0.0
    words = f"whose axes are {space}" if told else "it was turned to be anterior, with z of the file superior"
    assert words in said[0]


def test_a_head_that_contradicts_the_shape_is_told(eye, tmp_path):
    _, said = lying(eye, tmp_path, "SPACE=LPS")
    assert "which would not be anterior: give eye.landmarks if the head of the file is wrong" in said[1]


def test_an_eye_that_looks_back_is_turned_about_its_upright_axis(eye, tmp_path):
    expected = lying(eye, tmp_path)[0]
    back = trimesh.Trimesh(eye.vertices * [-1, 1, -1], eye.faces, process=False)
    mesh, said = lying(back, tmp_path)
    assert same(mesh, expected, 2e-6) and "y of the file superior" in said[0]


def test_gaze_is_kept(eye, tmp_path):
    """An eye that looks 15 degrees up lies as its axes say."""
    turned = eye.copy().apply_transform(trimesh.transformations.rotation_matrix(np.radians(-15.0), [1, 0, 0]))
    _, said = lying(turned, tmp_path)
    assert said == ["its axes were taken as they are: x to the patient's left, y superior, z anterior"]


# What it is made of

def test_units_of_inches_are_told_and_read(eye, tmp_path):
    small = eye.copy().apply_scale(1 / 25.4)
    with pytest.raises(UserError, match=r"set eye\.unit: in"):
        read(small, tmp_path)
    assert read(small, tmp_path, unit="in").mesh.volume == pytest.approx(1e-9 * eye.volume, rel=1e-5)


def test_several_bodies_are_told_before_their_size(eye, tmp_path):
    both = trimesh.util.concatenate([eye, eye.copy().apply_translation([62, 0, 0])])
    with pytest.raises(UserError, match=r"consists of 2 separate pieces .* export one of them alone .*\(62, 0"):
        read(both, tmp_path)
    wall = trimesh.util.concatenate([eye, eye.copy().apply_scale(1.05)])
    with pytest.raises(UserError, match="like the two sides of a wall: export the inner one alone"):
        read(wall, tmp_path)


def steps(kind, size):
    """Surface of the default eye made of voxels of a size (3,), in mm, by their sides or by marching cubes."""
    axes = [np.arange(-14.0, 14.0, one) + 0.13 for one in size]
    inside = SHAPE.level(1e-3 * np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)) < 0.0
    origin = np.array([one[0] for one in axes])
    if kind == "marching cubes":
        vertices, faces, *_ = marching_cubes(inside.astype(float), 0.5, spacing=size)
        mesh = trimesh.Trimesh(vertices + origin, faces)
        if mesh.volume < 0.0:
            mesh.invert()
        return mesh, inside.sum() * np.prod(size)
    grid = pyvista.ImageData(dimensions=np.array(inside.shape) + 1, spacing=size, origin=origin - 0.5 * np.array(size))
    grid.cell_data["inside"] = inside.ravel(order="F").astype(np.uint8)
    surface = grid.threshold(0.5, scalars="inside").extract_surface(algorithm=None).triangulate().clean()
    return trimesh.Trimesh(surface.points, surface.regular_faces), inside.sum() * np.prod(size)


@pytest.mark.parametrize("kind", ["sides", "marching cubes"])
@pytest.mark.parametrize("size", [(0.5, 0.5, 0.5), (0.4, 0.4, 1.2)])
def test_steps_of_voxels_are_refused_or_smoothed_at_the_same_volume(tmp_path, kind, size):
    mesh, volume = steps(kind, size)
    with pytest.raises(UserError, match=r"has steps of voxels, of .* set eye\.smooth: true to smooth it"):
        read(mesh, tmp_path)
    assert read(mesh, tmp_path, force=True).mesh.area > 1.05e-6 * eye_mesh(SHAPE).apply_scale(1e3).area
    smooth = read(mesh, tmp_path, smooth=True, to_origin=False)
    assert smooth.mesh.volume == pytest.approx(1e-9 * mesh.volume, rel=1e-9) == pytest.approx(1e-9 * volume, rel=5e-3)
    assert any("smoothed steps of voxels" in one for one in smooth.repairs)
    away = np.abs(SHAPE.level(smooth.mesh.vertices))
    assert np.sqrt((away**2).mean()) < 0.2e-3 * max(size) and away.max() < 0.8e-3 * max(size)
    assert smooth.mesh.area == pytest.approx(eye_mesh(SHAPE).area, rel=0.02)


def test_smooth_shapes_have_no_steps(eye, tmp_path):
    assert not read(eye, tmp_path).warnings
    cube = trimesh.creation.box([17.0] * 3)
    for _ in range(4):
        cube = cube.subdivide()
    assert "smoothed" not in " ".join(read(cube, tmp_path).repairs)


# How it is written

DIALECTS = {
    "commas.stl": lambda mesh: text_stl(mesh, comma).encode(),
    "capitals.stl": lambda mesh: text_stl(mesh).upper().encode(),
    "fortran.stl": lambda mesh: text_stl(mesh, lambda number: f"{number:.9E}".replace("E", "D")).encode(),
    "mark.stl": lambda mesh: b"\xef\xbb\xbf" + text_stl(mesh).replace("\n", "\r\n").encode(),
    "utf16.stl": lambda mesh: text_stl(mesh).encode("utf-16"),
    "cyrillic.stl": lambda mesh: text_stl(mesh, solid="Стекловидное тело").encode(),
    "solid.stl": lambda mesh: binary_stl(mesh, b"solid facet exported"),
    "uncounted.stl": lambda mesh: binary_stl(mesh, count=0),
    "tail.stl": lambda mesh: binary_stl(mesh, b"COLOR=\xf0\xf0\xf0\xff", tail=b"\0" * 37),
    "commas.obj": lambda mesh: obj(mesh, comma).encode(),
    "faces_first.obj": lambda mesh: obj(mesh, order="faces first").encode(),
    "from_the_end.obj": lambda mesh: obj(mesh, order="from the end").encode(),
    "strips.ply": lambda mesh: ply_of_strips(mesh),
    "comment_ends_in_a_backslash.obj": lambda mesh: b"# C:\\meshes\\\nmtllib C:\\looks\\\n" + obj(mesh).encode(),
    "carriage_returns.obj": lambda mesh: obj(mesh, order="faces first").replace("\n", "\r").encode(),
    "comment_first.ply": lambda mesh: ply(mesh, comments="comment of a clinic\n").replace(b".", b",").replace(
        b"ascii 1,0", b"ascii 1.0"),
    "bytes_behind.ply": lambda mesh: ply(mesh, "binary_little_endian") + bytes(50),
    "big_endian.stl": lambda mesh: big_endian_stl(mesh),
}


@pytest.fixture(scope="module")
def ball():
    return trimesh.creation.icosphere(subdivisions=3, radius=11.0)


@pytest.mark.parametrize("name", DIALECTS)
def test_dialects_are_read(ball, tmp_path, name):
    (tmp_path / name).write_bytes(DIALECTS[name](ball))
    imported = import_mesh(tmp_path / name)
    assert len(imported.mesh.faces) == len(ball.faces) and imported.mesh.is_watertight
    assert imported.mesh.volume == pytest.approx(1e-9 * ball.volume, rel=1e-5)
    noted = {"tail.stl": "37 bytes behind the last triangle were left out", "uncounted.stl": "no number of triangles",
             "big_endian.stl": "big-endian"}
    assert (noted[name] in imported.warnings[0]) if name in noted else not imported.warnings


POLYGONS = {"text.ply": lambda points, faces: ply_of(points, faces),
            "big_endian.ply": lambda points, faces: ply_of(points, faces, "binary_big_endian"),
            "polygons.obj": lambda points, faces: "\n".join(
                [*(f"v {' '.join(map(repr, one))}" for one in points.tolist()),
                 *(f"f {' '.join(str(one + 1) for one in face)}" for face in faces)]).encode(),
            "polygons.stl": lambda points, faces: "\n".join(
                ["solid", *("facet normal 0 0 1\nouter loop\n" + "\n".join(
                    f"vertex {' '.join(map(repr, points[one].tolist()))}" for one in face) + "\nendloop\nendfacet"
                    for face in faces), "endsolid"]).encode()}


@pytest.mark.parametrize("name", POLYGONS)
def test_faces_of_three_four_and_more_corners_are_read_together(tmp_path, name):
    """A ball of 20 rows of 40 quadrangles that ends in triangles on one side, and in one polygon on the other."""
    points, faces = ball_of_polygons()
    (tmp_path / name).write_bytes(POLYGONS[name](points, faces))
    mesh = import_mesh(tmp_path / name).mesh
    assert mesh.is_watertight and len(mesh.faces) == 19 * 40 * 2 + 40 + 38
    assert mesh.volume == pytest.approx(5.47e-6, rel=1e-3)


def test_a_file_of_vtk_tells_its_axes(eye, tmp_path):
    """An eye that looks up and to the side, so that its flat side tells no axes."""
    turned = eye.copy().apply_transform(trimesh.transformations.euler_matrix(0.8, 0.5, 0.3))
    surface = pyvista.wrap(turned)
    surface.field_data["SPACE"] = np.array(["LPS"])
    surface.save(tmp_path / "eye.vtp")
    assert import_mesh(tmp_path / "eye.vtp").space == "LPS"


@pytest.mark.parametrize("name", ["two.msh", "two.vtu"])
def test_a_volume_mesh_of_several_bodies_tells_that_their_outside_is_read(ball, tmp_path, name):
    """Where the cavity is meshed with the lens, the outside is that of the globe."""
    grid = pyvista.wrap(ball).delaunay_3d()
    cells = grid.cells_dict[pyvista.CellType.TETRA]
    body = 1 + (grid.points[cells].mean(axis=1)[:, 2] > 3.0).astype(int)
    key = "gmsh:physical" if name == "two.msh" else "material"
    data = {key: [body], **({"gmsh:geometrical": [body]} if name == "two.msh" else {})}
    meshio.write(tmp_path / name, meshio.Mesh(grid.points, [("tetra", cells)], cell_data=data),
                 file_format="gmsh22" if name == "two.msh" else None, binary=False)
    warning, = import_mesh(tmp_path / name).warnings
    assert f'2 bodies by "{key}" (1 with ' in warning and "export the cavity alone" in warning
    body[:] = 1
    meshio.write(tmp_path / name, meshio.Mesh(grid.points, [("tetra", cells)], cell_data=data),
                 file_format="gmsh22" if name == "two.msh" else None, binary=False)
    assert not import_mesh(tmp_path / name).warnings


def test_too_few_triangles_for_a_round_wall_are_told(tmp_path):
    rough, fine = (trimesh.creation.icosphere(subdivisions=level, radius=11.0) for level in (1, 3))
    warning, = read(rough, tmp_path).warnings
    assert "has 80 triangles only" in warning and "export it finer" in warning
    assert not read(fine, tmp_path).warnings


OTHERS = {
    "pointer.stl": (b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12\n", "run git lfs pull"),
    "annexed.stl": (b"/annex/objects/SHA256E-s12--01.stl\n", "is a pointer of git-annex in place of the file"),
    "picture.stl": (b"\x89PNG\r\n\x1a\n" + bytes(300), "is a picture"),
    "link.stl": (b"L\0\0\0\1\x14\2\0" + bytes(200), "is a Windows shortcut"),
    "text.stl": (b'{"asset": {"version": "2.0"}}', "is a text file, but no STL"),
    "zeros.stl": (bytes(300), "no triangles, but a closed surface is needed; export or copy it again"),
    "page.stl": (b"<!DOCTYPE html><html><body>Sign in</body></html>", "is a page of the web"),
    "packed.ply": (b"PK\x03\x04" + b"\0" * 200, "is a zip archive: unpack it"),
    "packed.obj": (b"\x1f\x8b\x08" + b"\0" * 200, "is compressed by gzip"),
    "empty.obj": (b"", "is empty, export or copy it again"),
    "blank.stl": (b" \n" * 100, "has blanks only"),
    "image.vtk": (b"\0" * 128 + b"DICM" + b"\0" * 100, "is a DICOM image"),
    "points.ply": (b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
                   b"end_header\n1 2 3\n", "holds 1 points and no triangles"),
    "half.obj": (b"v 1 2 3\nv 1 2 4\nv 2 2 4\nf 1 2 3\nf 1 2", "line 5 is no face of three corners or more"),
    "other.stl": (b"\7" * 84 + b"\0" * 60_000, "cut short"),
    "stl.obj": (b"solid eye\nfacet normal 0 0 1\n", "another format than its name says: give it the ending .stl"),
    "ply.vtk": (b"ply\nformat ascii 1.0\n", "give it the ending .ply"),
    "short.ply": (b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
                  b"element face 2\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
                  "is cut short (its head announces 5 lines and 4 are there)"),
    "packed.stl.gz": (b"\x1f\x8b\x08" + b"\0" * 200, 'is compressed (".gz"): unpack it'),
    "voxels.vtk": (b"# vtk DataFile Version 3.0\nlabels\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 22 22 20\n"
                   b"ORIGIN 0 0 0\nSPACING 1 1 1\n", "it is an image of 22 x 22 x 20 points and no surface"),
}


@pytest.mark.parametrize("name", OTHERS)
def test_other_files_are_called_what_they_are(tmp_path, name):
    content, words = OTHERS[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(UserError) as error:
        import_mesh(tmp_path / name)
    assert words in str(error.value) and "eye.path" in str(error.value) and "\n" not in str(error.value)


def test_a_folder_is_no_mesh(tmp_path):
    (tmp_path / "eye.stl").mkdir()
    with pytest.raises(UserError, match=r"is a folder: name the mesh in it"):
        import_mesh(tmp_path / "eye.stl")


def test_the_stage_smooths_and_turns_a_segmentation(tmp_path):
    """At the command line: an STL of steps in the axes of 3D Slicer."""
    mesh, _ = steps("marching cubes", (0.6, 0.6, 0.6))
    mesh.vertices = AXES["LPS"](mesh.vertices) + np.array([31.0, -70.0, 12.0])
    (tmp_path / "seg.stl").write_bytes(binary_stl(mesh, b"3D Slicer output. SPACE=LPS"))
    (tmp_path / "tamponade.yaml").write_text((ROOT / "config/scenes/clinic/tamponade.yaml").read_text())
    (tmp_path / "case.yaml").write_text("extends: tamponade\nnumerics: {particle_spacing: 2 mm}\n"
                                        "eye: {model: mesh, path: seg.stl, smooth: true}\n")
    done = forked.run("pipeline.scene", tmp_path / "case.yaml", "--config-dir", ROOT / "config", "--output",
                      tmp_path / "scene.json")
    assert done.returncode == 0, done.stderr
    done = forked.run("pipeline.eye", tmp_path / "scene.json", "--output", tmp_path / "eye.vtp", "--report",
                      tmp_path / "eye.json")
    assert done.returncode == 0, done.stderr
    assert "repair: smoothed steps of voxels" in done.stdout
    assert "orientation: turned as the head of its file tells, whose axes are LPS" in done.stdout
    bounds = np.array(json.loads((tmp_path / "eye.json").read_text())["bounds"])
    expected = eye_mesh(SHAPE).bounds
    np.testing.assert_allclose(bounds, expected, atol=0.5e-3)
