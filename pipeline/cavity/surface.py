"""The closed surface of the cavity, made or imported, and its file."""
import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipeline.base.errors import UserError
from pipeline.base.files import replacing
from pipeline.base.vtk_files import read_vtk, set_text, write_vtk
from pipeline.cavity.regions import region_names, regions_of
from pipeline.scenes.eye_shape import eye_mesh, imaged_volume, published_volume, shape_of
from pipeline.scenes.model import Container, Eye, Scene

if TYPE_CHECKING:
    import trimesh


def cavity_mesh(eye: Eye) -> "tuple[trimesh.Trimesh, dict]":
    """Surface of the cavity in m, and what the report says about its origin.

    Raises
    ------
    UserError : a mesh without a path, or one that cannot be used (``pipeline.cavity.mesh_import``); a buckle or a
        staphyloma that hides a part of the wall.
    """
    if eye.model == "parametric":
        shape = shape_of(eye)
        try:
            mesh, published = eye_mesh(shape), published_volume(eye.axial_length)
        except ValueError as error:
            raise UserError(f"eye: {error}; lower or widen the buckle or the staphyloma") from error
        return mesh, {
            "model": "parametric", "lens": eye.lens, "axial_length": eye.axial_length,
            "diameters": (2.0 * shape.half_axes).tolist(), "published_volume": published,
            "deviation_from_published": mesh.volume / published - 1.0,
        }
    if not eye.path:
        raise UserError("eye.path: is empty, but eye.model: mesh needs the file of a closed surface")
    from pipeline.cavity.landmarks import laid
    from pipeline.cavity.mesh_import import import_mesh

    imported = import_mesh(eye.path, eye.unit, eye.force, to_origin=eye.landmarks is None, smooth=eye.smooth,
                           label=eye.label, side=eye.side)
    mesh, lies = laid(imported.mesh, eye.landmarks, eye.side, eye.path, imported.space)
    return mesh, {"model": "mesh", "path": eye.path, "unit": eye.unit, "repairs": list(imported.repairs),
                  "warnings": list(imported.warnings), "orientation": lies}


def volume_in_words(report: dict) -> str:
    """Return the volume of a cavity, beside the published one of an eye of its axial length.

    Parameters
    ----------
    report : of ``cavity_mesh`` with ``report_of``.
    """
    said = f"cavity {1e6 * report['volume']:.2f} mL"
    if "published_volume" in report:
        length, imaged = report["axial_length"], imaged_volume(report["axial_length"])
        said += (f"; expected of {1e3 * length:g} mm: {1e6 * report['published_volume']:.2f} mL (144 operated eyes of "
                 f"20 to 32 mm, de Santana et al.), {1e6 * imaged:.2f} mL (imaged eyes, Zhou et al. 2020, "
                 "doi:10.1097/MD.0000000000022685)")
    return said


def write_container(container: Container, path: Path) -> dict:
    """Write the surface of a container in m, in two dimensions its outline, and return the report, in SI units."""
    import pyvista
    import trimesh

    size = np.array(container.size)
    if len(size) == 3:
        mesh = trimesh.creation.box(bounds=(np.zeros(3), size))
        write_mesh(mesh, path)
        return report_of(mesh, {"model": "container", "size": size.tolist()})
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) * [*size, 0.0]
    with replacing(path) as temporary:
        write_vtk(pyvista.PolyData(corners, lines=[5, 0, 1, 2, 3, 0]), temporary)
    return {"model": "container", "size": size.tolist(), "area": float(size.prod()), "length": float(2 * size.sum())}


def report_of(mesh: "trimesh.Trimesh", source: dict) -> dict:
    """Report of the stage: origin, size and quality of the surface, in SI units."""
    return source | {
        "volume": float(mesh.volume), "area": float(mesh.area), "triangles": len(mesh.faces),
        "watertight": bool(mesh.is_watertight), "bounds": mesh.bounds.tolist(),
    }


def write_mesh(mesh: "trimesh.Trimesh", path: str | Path, eye: Eye | None = None) -> None:
    """Write a surface in m as VTK polydata with double precision.

    That of an eye has a whole number per triangle, ``region``, and in the field data their names, ``regions``, of
    which the first is that of 0.
    """
    import pyvista

    surface = pyvista.make_tri_mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    if eye is not None:
        shape = shape_of(eye) if eye.model == "parametric" else None
        surface.cell_data["region"] = regions_of(mesh.triangles_center, shape)
        set_text(surface, "regions", region_names(shape))
        set_text(surface, "units", ("points: m",))
    with replacing(path) as temporary:
        write_vtk(surface, temporary)


def read_mesh(path: str | Path) -> "trimesh.Trimesh":
    """Read a surface that ``write_mesh`` wrote.

    Raises
    ------
    UserError : the file is missing or is no closed surface.
    """
    import trimesh

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
    return float(cavity_mesh(scene.eye)[0].volume)
