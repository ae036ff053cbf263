"""Stage: the closed surface of the cavity: a parametric eye, a user's mesh, or a container."""
import argparse
import json
import time
from pathlib import Path

import numpy as np
import pyvista
import trimesh

from pipeline.cli import run
from pipeline.defect_picture import picture_of_defect
from pipeline.errors import UserError
from pipeline.eye_shape import eye_mesh, eye_shape, published_volume
from pipeline.files import replacing, write_text
from pipeline.mesh_import import MeshRefused, import_mesh
from pipeline.scene import load_resolved
from pipeline.scene_model import Container, Eye
from pipeline.vtk_files import write_vtk


def cavity_mesh(eye: Eye) -> tuple[trimesh.Trimesh, dict]:
    """Surface of the cavity in m, and what the report says about its origin.

    Raises
    ------
    UserError : a mesh without a path, or one that cannot be used (``pipeline.mesh_import``).
    """
    if eye.model == "parametric":
        shape = eye_shape(eye.axial_length, lens=eye.lens, horizontal_diameter=eye.horizontal_diameter,
                          vertical_diameter=eye.vertical_diameter)
        mesh, published = eye_mesh(shape), published_volume(eye.axial_length)
        return mesh, {
            "model": "parametric", "lens": eye.lens, "axial_length": eye.axial_length,
            "diameters": (2.0 * shape.half_axes).tolist(), "published_volume": published,
            "deviation_from_published": mesh.volume / published - 1.0,
        }
    if not eye.path:
        raise UserError("eye.path: is empty, but eye.model: mesh needs the file of a closed surface")
    imported = import_mesh(eye.path, eye.unit, eye.force)
    return imported.mesh, {"model": "mesh", "path": eye.path, "unit": eye.unit, "repairs": list(imported.repairs)}


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


def write_mesh(mesh: trimesh.Trimesh, path: str | Path) -> None:
    """Write a surface in m as VTK polydata with double precision."""
    with replacing(path) as temporary:
        write_vtk(pyvista.make_tri_mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces)), temporary)


def read_mesh(path: str | Path) -> trimesh.Trimesh:
    """Read a surface that ``write_mesh`` wrote.

    Raises
    ------
    UserError : the file is missing or is no closed surface.
    """
    path = Path(path)
    if not path.is_file():
        raise UserError(f"{path}: no such file, the eye stage (python -m pipeline.eye) writes it")
    surface = pyvista.read(path)
    mesh = trimesh.Trimesh(surface.points, surface.regular_faces, process=False)
    if not mesh.is_watertight:
        raise UserError(f"{path}: is no closed surface, the eye stage (python -m pipeline.eye) writes one")
    return mesh


def main(arguments: list[str] | None = None) -> None:
    """Run the stage; see ``--help``."""
    parser = argparse.ArgumentParser(prog="python -m pipeline.eye", description=__doc__)
    parser.add_argument("scene", type=Path, help="resolved scene (scene.json)")
    parser.add_argument("--output", type=Path, required=True, help="surface to write (eye.vtp)")
    parser.add_argument("--report", type=Path, required=True, help="report to write (eye.json)")
    parser.add_argument("--picture", type=Path, help="picture of a defect that cannot be repaired "
                                                     "(default: eye_defects.png beside the report)")
    options = parser.parse_args(arguments)
    picture = options.picture or options.report.with_name("eye_defects.png")
    start = time.perf_counter()
    scene = load_resolved(options.scene)
    if scene.container is not None:
        report = write_container(scene.container, options.output) | {"seconds": time.perf_counter() - start}
        write_text(options.report, json.dumps(report, indent=2) + "\n")
        print(f"container of {' x '.join(f'{side:g}' for side in scene.container.size)} m")
        return
    try:
        mesh, source = cavity_mesh(scene.eye)
    except MeshRefused as refused:
        raise UserError(f"{refused}; {picture_of_defect(refused.mesh, refused.segments, picture)}") from refused
    report = report_of(mesh, source) | {"seconds": time.perf_counter() - start}
    write_mesh(mesh, options.output)
    write_text(options.report, json.dumps(report, indent=2) + "\n")
    picture.unlink(missing_ok=True)
    for sentence in report.get("repairs", ()):
        print(f"repair: {sentence}")
    print(f"cavity {1e6 * report['volume']:.2f} mL, {report['triangles']} triangles")


if __name__ == "__main__":
    run(main)
