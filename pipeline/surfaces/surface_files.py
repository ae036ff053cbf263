"""Files of the reconstruct stage: surfaces as VTK poly data, the section as a VTK image."""
import json
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipeline.base.errors import UserError
from pipeline.base.sequences import SURFACES_AGAIN
from pipeline.base.vtk_files import name_components, read_vtk, set_text, write_vtk
from pipeline.surfaces.contour import TriangleMesh
from pipeline.surfaces.contour_lines import ContourLines

_OF_FRAME = re.compile(r"frame_\d{5,}(?=_)")  # what the names of all files of a frame begin with
EMPTY = {
    ".ply": b"ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\n"
            b"element face 0\nproperty list uchar int vertex_indices\nend_header\n",
    ".stl": bytes(84),
}


def surface_path(folder: Path, frame: str, liquid: str, suffix: str = ".vtp") -> Path:
    """Path of the surface of ``liquid`` in the frame named ``frame`` ("frame_00000")."""
    return Path(folder) / f"{frame}_{liquid}{suffix}"


def write_surface(path: Path, mesh: TriangleMesh | ContourLines, *, time: float, liquid: str,
                  depth: np.ndarray) -> None:
    """Write a closed surface or closed lines in m (``.vtp``, LZ4).

    ``depth`` (v,) is the distance of every one of ``mesh.points`` to the wall in m.

    The folder that holds the file is renamed when complete, so the file itself is written in place.
    """
    surface = to_polydata(mesh)
    surface.point_data["depth"] = depth.astype(np.float32)
    surface.field_data["time"] = [time]
    set_text(surface, "liquid", liquid)
    set_text(surface, "units", ("points: m", "depth: m", "time: s"))
    write_vtk(surface, path)


def write_copy(path: Path, mesh: TriangleMesh) -> None:
    """Write the surface once more as ``.ply`` or ``.stl``, by suffix; an empty surface gives an empty file."""
    import trimesh

    suffix = Path(path).suffix
    # Written by Python: VTK leaves a part of a file, without an error, on a full disk. Trimesh exports no empty mesh.
    whole = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False)
    Path(path).write_bytes(whole.export(file_type=suffix[1:]) if len(mesh.triangles) else EMPTY[suffix])


def to_polydata(mesh: TriangleMesh | ContourLines):
    """The mesh as pyvista.PolyData in m; lines lie in the plane z = 0."""
    import pyvista

    if isinstance(mesh, ContourLines):
        if not mesh.lines:
            return pyvista.PolyData()
        points = np.pad(mesh.points.astype(np.float32), ((0, 0), (0, 1)))
        return pyvista.PolyData(points, lines=_closed_lines([len(line) - 1 for line in mesh.lines]))
    if not len(mesh.triangles):
        return pyvista.PolyData()
    return pyvista.PolyData.from_regular_faces(mesh.vertices.astype(np.float32), mesh.triangles)


def _closed_lines(counts: list[int]) -> np.ndarray:
    """VTK's list of lines through runs of points, each back to its first point."""
    starts = np.cumsum([0, *counts[:-1]])
    return np.concatenate([[count + 1, *range(start, start + count), start]
                           for start, count in zip(starts, counts, strict=True)])


def read_surface(path: Path):
    """Read a surface as pyvista.PolyData.

    Raises
    ------
    UserError : the file is missing, or is of another time than the numbers of its frame.
    """
    return _read(path, "surface")


def read_surfaces(folder: Path, frame: str, liquids: Sequence[str]) -> dict:
    """Surfaces of liquids in the frame named ``frame`` as a dict liquid -> pyvista.PolyData.

    Raises
    ------
    UserError : a file is missing.
    """
    return {liquid: read_surface(surface_path(folder, frame, liquid)) for liquid in liquids}


def lines_of(surface) -> list[np.ndarray]:
    """Lines (k, 3) in m of a pyvista.PolyData."""
    lines, cells, start = [], np.asarray(surface.lines), 0
    while start < len(cells):
        end = start + 1 + cells[start]
        lines.append(np.asarray(surface.points)[cells[start + 1:end]])
        start = end
    return lines


def write_section(path: Path, section, *, time: float, liquids: Sequence[str]) -> None:
    """Write a :class:`pipeline.surfaces.liquid_surface.Section` as a VTK image (``.vti``) in its plane.

    The components of ``fraction`` and ``dominance`` carry the names of the liquids.
    """
    import pyvista

    image = pyvista.ImageData(dimensions=np.insert(section.signed_distance.shape, section.normal, 1),
                              spacing=(section.cell,) * 3, origin=np.insert(section.origin, section.normal, 0.0))
    for name in ("fraction", "dominance"):
        values = getattr(section, name)
        image.point_data[name] = values.transpose(1, 0, 2).reshape(-1, values.shape[-1])
        name_components(image.GetPointData().GetArray(name), liquids)
    image.point_data["signed_distance"] = section.signed_distance.ravel(order="F")
    image.field_data["time"] = [time]
    set_text(image, "units", ("points: m", "signed_distance: m", "time: s"))
    write_vtk(image, path)


WALL_FRACTIONS = ("oil_fraction_covered", "oil_fraction_bare")


def write_wall(path: Path, eye, contact_distance: np.ndarray, oil_fraction: np.ndarray,
               film_distance: np.ndarray | None = None, *, time: float) -> None:
    """Write the surface of the cavity (``.vtp``) with its regions and with what touches it.

    Parameters
    ----------
    eye : pyvista.PolyData with n points.
    contact_distance : (n,) m, to the edge of what the oil touches, positive where it does.
    oil_fraction : (n, 2) volume fraction of the oil in what lies on the wall where it touches, and where not.
    film_distance : (n,) m, to the line between what the oil touches and films under it, positive over films; None where
        films are not known.
    """
    wall = eye.copy(deep=False)
    wall.clear_point_data()
    wall.points = eye.points.astype(np.float32)
    wall.point_data["contact_distance"] = contact_distance.astype(np.float32)
    for name, values in zip(WALL_FRACTIONS, oil_fraction.T, strict=True):
        wall.point_data[name] = values.astype(np.float32)
    distances = ["contact_distance: m"]
    if film_distance is not None:
        wall.point_data["film_distance"] = film_distance.astype(np.float32)
        distances.append("film_distance: m")
    wall.field_data["time"] = [time]
    set_text(wall, "units", ("points: m", *distances, "time: s"))
    write_vtk(wall, path)


def read_wall(path: Path):
    """Read the wall of one frame as pyvista.PolyData.

    Raises
    ------
    UserError : the file is missing.
    """
    return _read(path, "wall", hint=", with --eye")


def read_statistics(path: Path) -> dict:
    """Read the numbers of the surfaces of a frame (``.json``): its ``time``, s, and more.

    Raises
    ------
    UserError : the file is missing or damaged.
    """
    try:
        statistics = json.loads(Path(path).read_text(encoding="utf-8"))
        float(statistics["time"])
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise UserError(f"{path}: does not hold the numbers of a frame's surfaces ({error}); run the reconstruct stage "
                        "on its folder again") from error
    return statistics


def read_retina(path: Path) -> dict[str, dict[str, float]]:
    """Read how much of every part of the retina is covered in a frame, from its statistics.

    Raises
    ------
    UserError : the file is missing or damaged, or the reconstruct stage was not given the eye.
    """
    statistics = read_statistics(path)
    if "retina" not in statistics:
        raise UserError(f"{path}: does not tell what touches the retina; run the reconstruct stage first, with --eye")
    return statistics["retina"]


def read_section(path: Path):
    """Read a section as pyvista.ImageData.

    Raises
    ------
    UserError : the file is missing.
    """
    return _read(path, "section")


def _read(path: Path, what: str, hint: str = ""):
    """Read a VTK file, which belongs to the numbers beside it."""
    if not Path(path).is_file():
        raise UserError(f"{path}: no such {what}; run the reconstruct stage first{hint}")
    found, frame = read_vtk(path), _OF_FRAME.match(Path(path).name)
    numbers = Path(path).with_name(f"{frame[0]}.json") if frame else None
    if numbers is not None and numbers.is_file() and "time" in found.field_data:
        check_time(path, float(found.field_data["time"][0]), float(read_statistics(numbers)["time"]))
    return found


def check_time(path: Path, found: float, time: float) -> None:
    """Raise UserError where a file made of a frame is of another time, s, than the frame."""
    if found != time:
        raise UserError(f"{path}: is of {found:.6g} s, but its frame is that of {time:.6g} s, as after a copy under "
                        f"another name; remove its folder and {SURFACES_AGAIN}")
