"""The closed surface of the cavity, made or imported, and its file."""
import math
from pathlib import Path

import numpy as np
import pyvista
import trimesh

from pipeline.base.errors import UserError
from pipeline.base.files import replacing
from pipeline.base.vtk_files import read_vtk, set_text, write_vtk
from pipeline.cavity.mesh_import import import_mesh
from pipeline.cavity.regions import MESH_REGIONS, REGIONS, regions_of
from pipeline.scenes.eye_shape import EyeShape, eye_mesh, eye_shape, published_volume
from pipeline.scenes.model import Container, Eye, Scene


def shape_of(eye: Eye) -> EyeShape:
    """Lengths of a parametric eye."""
    return eye_shape(eye.axial_length, lens=eye.lens, horizontal_diameter=eye.horizontal_diameter,
                     vertical_diameter=eye.vertical_diameter)


def cavity_mesh(eye: Eye) -> tuple[trimesh.Trimesh, dict]:
    """Surface of the cavity in m, and what the report says about its origin.

    Raises
    ------
    UserError : a mesh without a path, or one that cannot be used (``pipeline.cavity.mesh_import``).
    """
    if eye.model == "parametric":
        shape = shape_of(eye)
        mesh, published = eye_mesh(shape), published_volume(eye.axial_length)
        return mesh, {
            "model": "parametric", "lens": eye.lens, "axial_length": eye.axial_length,
            "diameters": (2.0 * shape.half_axes).tolist(), "published_volume": published,
            "deviation_from_published": mesh.volume / published - 1.0,
        }
    if not eye.path:
        raise UserError("eye.path: is empty, but eye.model: mesh needs the file of a closed surface")
    imported = import_mesh(eye.path, eye.unit, eye.force)
    return imported.mesh, {"model": "mesh", "path": eye.path, "unit": eye.unit, "repairs": list(imported.repairs),
                           "warnings": list(imported.warnings)}


def write_container(container: Container, path: Path) -> dict:
    """Write the surface of a container in m, in two dimensions its outline, and return the report, in SI units."""
    size = np.array(container.size)
    if len(size) == 3:
        mesh = trimesh.creation.box(bounds=(np.zeros(3), size))
        write_mesh(mesh, path)
        return report_of(mesh, {"model": "container", "size": size.tolist()})
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) * [*size, 0.0]
    with replacing(path) as temporary:
        write_vtk(pyvista.PolyData(corners, lines=[5, 0, 1, 2, 3, 0]), temporary)
    return {"model": "container", "size": size.tolist(), "area": float(size.prod()), "length": float(2 * size.sum())}


def report_of(mesh: trimesh.Trimesh, source: dict) -> dict:
    """Report of the stage: origin, size and quality of the surface, in SI units."""
    return source | {
        "volume": float(mesh.volume), "area": float(mesh.area), "triangles": len(mesh.faces),
        "watertight": bool(mesh.is_watertight), "bounds": mesh.bounds.tolist(),
    }


def write_mesh(mesh: trimesh.Trimesh, path: str | Path, eye: Eye | None = None) -> None:
    """Write a surface in m as VTK polydata with double precision.

    That of an eye has a whole number per triangle, ``region``, and in the field data their names, ``regions``, of
    which the first is that of 0.
    """
    surface = pyvista.make_tri_mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    if eye is not None:
        parametric = eye.model == "parametric"
        surface.cell_data["region"] = regions_of(mesh.triangles_center, shape_of(eye) if parametric else None)
        set_text(surface, "regions", REGIONS if parametric else MESH_REGIONS)
        set_text(surface, "units", ("points: m",))
    with replacing(path) as temporary:
        write_vtk(surface, temporary)


def read_mesh(path: str | Path) -> trimesh.Trimesh:
    """Read a surface that ``write_mesh`` wrote.

    Raises
    ------
    UserError : the file is missing or is no closed surface.
    """
    path = Path(path)
    if not path.is_file():
        raise UserError(f"{path}: no such file, the eye stage (python -m pipeline.eye) writes it")
    surface = read_vtk(path)
    mesh = trimesh.Trimesh(surface.points, surface.regular_faces, process=False)
    if not mesh.is_watertight:
        raise UserError(f"{path}: is no closed surface, the eye stage (python -m pipeline.eye) writes one")
    return mesh




def cavity_volume(scene: Scene) -> float:
    """Volume of the cavity of a scene, m^3 (in two dimensions m^2).

    Raises
    ------
    UserError : the user's mesh cannot be used.
    """
    if scene.container is not None:
        return math.prod(scene.container.size)
    from pipeline.cavity.surface import cavity_mesh  # slow to import, and only an eye needs it

    return float(cavity_mesh(scene.eye)[0].volume)
