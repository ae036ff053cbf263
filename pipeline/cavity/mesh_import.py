"""A user's surface of the cavity: read, check its unit, repair small defects, refuse the rest with the reason."""
import contextlib
import dataclasses
import logging
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path

import meshio
import numpy as np
import pyvista
import trimesh

from pipeline.base.errors import UserError
from pipeline.cavity import large_stl, vtk_reader
from pipeline.cavity.large_stl import reduced
from pipeline.cavity.signed_distance_grid import grid_nodes, inner_nodes
from pipeline.cavity.vtk_reader import outer_surface
from pipeline.scenes.eye_shape import LARGEST_VOLUME, SMALLEST_VOLUME
from pipeline.scenes.model import MESH_UNITS

TRIMESH_FORMATS = (".obj", ".ply")
VTK_FORMATS = (".stl", ".vtk", ".vtp", ".vtu")
MESHIO_FORMATS = (".msh",)
FORMATS = TRIMESH_FORMATS + VTK_FORMATS + MESHIO_FORMATS
SMALLEST_SIZE, LARGEST_SIZE = 15e-3, 40e-3          # largest outer dimension of a cavity, m
SMALLEST_DEPTH = 10e-3                              # smallest one: lens to retina is 13 mm in a short eye
WELD_DIGITS = 7                 # vertices that agree to 0.1 um are one
DEBRIS_AREA = 0.05              # pieces that together have less of the area are dropped, larger ones refused
LARGEST_HOLE = 2.5e-3           # width of a hole that is closed, m: a flat lid there is less than 0.1 mm off
LARGEST_OFFSET = 3e-3           # a mesh whose globe center is farther from the origin is moved there, m
SELF_CROSSING = 0.02            # disagreement of two kinds of volume that shows a surface crossing itself
MOST_TRIANGLES = 200_000        # of an eye they are 0.14 mm wide, finer than any spacing that a computer can afford
LEAST_SPHERICITY = 0.88         # eyes of all lens states and lengths have 0.93 to 0.99, a cylinder 0.87, a cube 0.81


class MeshRefused(UserError):
    """A surface that cannot be repaired; ``mesh`` and ``segments`` (n, 2, 3) in m show the place."""

    def __init__(self, message: str, mesh: trimesh.Trimesh, segments: np.ndarray):
        super().__init__(message)
        self.mesh = mesh
        self.segments = segments


@dataclasses.dataclass(frozen=True)
class ImportedMesh:
    """A closed surface in m with outward normals, and sentences: what was repaired, and what is unlike an eye."""

    mesh: trimesh.Trimesh
    repairs: tuple[str, ...]
    warnings: tuple[str, ...]


def import_mesh(path: str | Path, unit: str = "mm", force: bool = False, to_origin: bool = True) -> ImportedMesh:
    """Read and repair the surface of a cavity.

    Parameters
    ----------
    path : STL, OBJ, PLY, VTK, VTP, VTU or MSH file; of a volume mesh the outer surface is taken.
    unit : unit of length of the file: "m", "cm", "mm" or "um".
    force : accept a size and a volume unlike an eye's.
    to_origin : move a globe that is far from the origin there; not where landmarks say where it is in the file.

    Raises
    ------
    UserError : the file cannot be read, or its unit or volume is unlike an eye's.
    MeshRefused : the surface stays open, consists of several pieces or crosses itself.
    """
    vertices, faces = read_triangles(Path(path))
    if not len(faces):
        raise UserError(f"{path} (eye.path): holds no triangles, but a closed surface is needed")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise UserError(f"{path} (eye.path): is damaged (a triangle has a corner that is not there), export or copy it "
                        "again")
    if not np.isfinite(vertices).all():
        raise UserError(f"{path} (eye.path): {np.sum(~np.isfinite(vertices).all(axis=1))} vertices are not finite "
                        "numbers, export the surface again")
    if not force:
        check_unit(path, np.ptp(vertices[np.unique(faces)], axis=0), unit)
    vertices, faces, coarsened = coarsen(MESH_UNITS[unit] * vertices, faces)
    mesh, repairs = repair(trimesh.Trimesh(vertices, faces, process=False), str(path))
    if many := large_stl.many_triangles(Path(path)):
        repairs.insert(0, f"read {many} triangles in slabs, which were reduced one by one")
    repairs = coarsened + repairs
    if not force and not SMALLEST_VOLUME <= mesh.volume <= LARGEST_VOLUME:
        raise UserError(f"{path} (eye.path): the cavity holds {1e6 * mesh.volume:.2f} mL, but 2 to 12 mL are like an "
                        "eye's (eye.force: true accepts any volume)")
    offset = globe_center(mesh)
    if to_origin and np.linalg.norm(offset) > LARGEST_OFFSET:
        mesh.apply_translation(-offset)
        repairs.append("moved the center of the globe to the origin, from "
                       f"({', '.join(f'{1e3 * value:.1f}' for value in offset)}) mm")
    return ImportedMesh(mesh, tuple(repairs), tuple(unlike_an_eye(mesh, str(path))))


def unlike_an_eye(mesh: trimesh.Trimesh, name: str) -> list[str]:
    """Sentences on a shape that no vitreous cavity has; `name` begins them."""
    found = []
    handles = (2 - mesh.euler_number) // 2
    if handles:
        found.append(f"{name} (eye.path): the surface has {handles} handle{'s' * (handles > 1)}, like a ring, but the "
                     "cavity of an eye has none")
    sphericity = np.pi ** (1.0 / 3.0) * (6.0 * abs(mesh.volume)) ** (2.0 / 3.0) / mesh.area
    if sphericity < LEAST_SPHERICITY:
        found.append(f"{name} (eye.path): the surface has a sphericity of {sphericity:.2f}, but the cavity of an eye "
                     f"has more than 0.93 (a cube has 0.81)")
    return found


def globe_center(mesh: trimesh.Trimesh) -> np.ndarray:
    """Center (3,) in m of the sphere that fits the vertices best (least squares)."""
    return center_of_sphere(mesh.vertices)


def center_of_sphere(points: np.ndarray) -> np.ndarray:
    """Center (3,) of the sphere that fits points (n, 3) best (least squares)."""
    solution, *_ = np.linalg.lstsq(np.column_stack([2.0 * points, np.ones(len(points))]), (points**2).sum(axis=1))
    return solution[:3]


def read_triangles(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) float in the unit of the file and triangles (m, 3) int of a mesh file."""
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise UserError(f'{path} (eye.path): the format "{suffix}" is not known, use one of {", ".join(FORMATS)}')
    if not path.is_file():
        raise UserError(f"{path} (eye.path): no such file")
    try:
        if suffix in TRIMESH_FORMATS:
            mesh = trimesh.load(path, force="mesh", process=False)
            return np.asarray(mesh.vertices, float), np.asarray(mesh.faces, int)
        if suffix in VTK_FORMATS:
            return _read_by_vtk(path)
        with _silent_reader():
            surface = outer_surface(pyvista.from_meshio(meshio.gmsh.read(path)))
        return np.asarray(surface.points, float), np.asarray(surface.regular_faces, int)
    except (OSError, MemoryError, UserError):
        raise
    # The readers raise anything from ValueError to their own kinds; all mean that the content is not of this format.
    except Exception as error:
        reason = str(error).strip().splitlines()
        raise UserError(f"{path} (eye.path): cannot be read as {suffix[1:].upper()} "
                        f"({reason[0] if reason else type(error).__name__})") from error


def refuse_cut_short(path: Path) -> None:
    """Raise when an STL file ends before its last triangle: readers take what there is, or nothing."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(84)
        file.seek(max(size - 1024, 0))
        tail = file.read()
    announced = int.from_bytes(head[80:84], "little") if len(head) == 84 else 0
    if head.lstrip().startswith(b"solid") and size != 84 + 50 * announced:
        if b"endsolid" not in tail:
            raise UserError(f"{path} (eye.path): is cut short (a text STL ends with the word endsolid), export or copy "
                            "it again")
    elif size < 84:
        raise UserError(f"{path} (eye.path): is cut short (a binary STL has a head of 84 bytes), export or copy it "
                        "again")
    elif size < 84 + 50 * announced:
        raise UserError(f"{path} (eye.path): is cut short (it announces {announced} triangles and holds "
                        f"{(size - 84) // 50}), export or copy it again")


def coarsen(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Reduce triangles far below any particle spacing; a closed surface stays closed.

    Parameters
    ----------
    vertices, faces : (n, 3), m, and (m, 3).

    Returns
    -------
    Both of the coarser surface, and the sentence that says so; unchanged up to ``MOST_TRIANGLES``.
    """
    if len(faces) <= MOST_TRIANGLES:
        return vertices, faces, []
    coarse = reduced(vertices, faces, 10.0**-WELD_DIGITS, MOST_TRIANGLES / len(faces))
    return *coarse, [f"reduced {len(faces)} triangles to {len(coarse[1])}, far finer than the particles"]


def _read_by_vtk(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """What :func:`read_triangles` returns, read in a process of its own, for damaged files crash VTK."""
    if path.suffix.lower() == ".stl":
        refuse_cut_short(path)
        if large_stl.many_triangles(path):
            return large_stl.read_reduced(path)
    with tempfile.TemporaryDirectory(prefix="mesh_") as folder:
        target = Path(folder) / "triangles.npz"
        done = subprocess.run([sys.executable, "-P", vtk_reader.__file__, path, target], capture_output=True,
                              text=True)  # -P: no file beside the reader takes the place of a library
        if done.returncode:
            reason = done.stderr.strip().splitlines()
            raise ValueError(reason[-1] if reason and done.returncode > 0 else "it crashes the reader of VTK")
        with np.load(target) as found:
            return found["vertices"], found["faces"]


@contextlib.contextmanager
def _silent_reader() -> Iterator[None]:
    """Keep complaints about a broken file off the screen: the user gets one sentence instead."""
    disabled = logging.root.manager.disable
    with pyvista.vtk_verbosity("off"), warnings.catch_warnings(action="ignore"):
        logging.disable(logging.CRITICAL)
        try:
            yield
        finally:
            logging.disable(disabled)


def check_unit(path: str | Path, extents: np.ndarray, unit: str) -> None:
    """Refuse outer dimensions (3,), in ``unit``, that no eye has, and name the unit that would fit."""
    def fits(candidate):
        size = MESH_UNITS[candidate] * extents
        return size.min() >= SMALLEST_DEPTH and SMALLEST_SIZE <= size.max() <= LARGEST_SIZE

    if fits(unit):
        return
    size = " x ".join(f"{1e3 * MESH_UNITS[unit] * extent:.4g}" for extent in extents)
    likely = [candidate for candidate in MESH_UNITS if fits(candidate)]
    advice = f"the file is probably in {likely[0]}: set eye.unit: {likely[0]}" if likely else \
        "no unit makes it the size of an eye (eye.force: true accepts any size)"
    raise UserError(f"{path} (eye.unit: {unit}): the surface measures {size} mm, but an eye's cavity is 15 to 40 mm "
                    f"wide; {advice}")


def repair(mesh: trimesh.Trimesh, name: str) -> tuple[trimesh.Trimesh, list[str]]:
    """Weld, clean, orient and close a surface in m; returns it with a sentence for each repair.

    Raises
    ------
    MeshRefused : what is left is open, in several pieces, or crosses itself; ``name`` begins the sentence.
    """
    mesh = mesh.copy()
    repairs = weld(mesh)
    mesh = drop_debris(mesh, name, repairs)
    orient(mesh, repairs)
    close_small_holes(mesh, repairs)
    refuse_open(mesh, name)
    if mesh.volume < 0.0:
        mesh.invert()
        repairs.append("turned the whole surface inside out: its normals pointed inward")
    refuse_self_crossing(mesh, name)
    return mesh, repairs


def weld(mesh: trimesh.Trimesh) -> list[str]:
    """Merge equal vertices and remove triangles without area and repeated ones, in place."""
    repairs = []
    mesh.remove_unreferenced_vertices()
    vertices, faces = len(mesh.vertices), len(mesh.faces)
    mesh.merge_vertices(digits_vertex=WELD_DIGITS, merge_tex=True, merge_norm=True)
    if len(mesh.vertices) < vertices:
        repairs.append(f"merged {vertices - len(mesh.vertices)} duplicate vertices")
    # Only collapsed triangles: removing a thin one with three different corners would open the surface.
    a, b, c = mesh.faces.T
    mesh.update_faces((a != b) & (b != c) & (c != a))
    mesh.update_faces(mesh.unique_faces())
    if len(mesh.faces) < faces:
        repairs.append(f"removed {faces - len(mesh.faces)} collapsed or repeated triangles")
    return repairs


def drop_debris(mesh: trimesh.Trimesh, name: str, repairs: list[str]) -> trimesh.Trimesh:
    """Keep the piece that has nearly all of the area; refuse a surface without one."""
    pieces = trimesh.graph.connected_components(mesh.face_adjacency, nodes=np.arange(len(mesh.faces)), min_len=1)
    if len(pieces) == 1:
        return mesh
    areas = np.array([mesh.area_faces[piece].sum() for piece in pieces])
    largest = int(areas.argmax())
    rest = 1.0 - areas[largest] / areas.sum()
    if rest > DEBRIS_AREA:
        others = np.concatenate([piece for index, piece in enumerate(pieces) if index != largest])
        corners = mesh.triangles[others]
        raise MeshRefused(
            f"{name} (eye.path): the surface consists of {len(pieces)} separate pieces and the largest has only "
            f"{100 * (1 - rest):.0f} % of the area, but one closed surface is needed",
            mesh, np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]))
    repairs.append(f"dropped {len(pieces) - 1} loose pieces with {100 * rest:.2g} % of the area")
    return mesh.submesh([pieces[largest]], append=True, repair=False)


def orient(mesh: trimesh.Trimesh, repairs: list[str]) -> None:
    """Turn the triangles that disagree with the majority of their piece, in place."""
    before = mesh.face_normals.copy()
    trimesh.repair.fix_winding(mesh)
    turned = np.einsum("ij,ij->i", before, mesh.face_normals) < 0.0
    if turned.sum() > 0.5 * len(turned):
        mesh.invert()
        turned = ~turned
    if turned.any():
        repairs.append(f"turned {turned.sum()} triangles whose normals disagreed with their neighbors")


def open_edges(mesh: trimesh.Trimesh) -> np.ndarray:
    """Directed edges (n, 2) of triangles that have no neighbor there."""
    unshared = trimesh.grouping.group_rows(mesh.edges_sorted, require_count=1)
    return mesh.edges[unshared]


def crowded_edges(mesh: trimesh.Trimesh) -> np.ndarray:
    """Edges (n, 2) in which more than two triangles meet."""
    edges, counts = np.unique(mesh.edges_sorted, axis=0, return_counts=True)
    return edges[counts > 2]


def outlines(edges: np.ndarray) -> list[list[int]]:
    """Closed vertex loops of directed open edges (n, 2); edges that form no simple loop are left out."""
    starts, counts = np.unique(edges[:, 0], return_counts=True)
    following = {int(start): int(end) for start, end in edges if counts[np.searchsorted(starts, start)] == 1}
    loops = []
    while following:
        first, here = following.popitem()
        loop = [first]
        while here != first and here in following:
            loop.append(here)
            here = following.pop(here)
        if here == first:
            loops.append(loop)
    return loops


def hole_width(rim: np.ndarray) -> float:
    """Width in m of a hole with the rim vertices (n, 3)."""
    return 2.0 * np.linalg.norm(rim - rim.mean(axis=0), axis=1).max()


def close_small_holes(mesh: trimesh.Trimesh, repairs: list[str]) -> None:
    """Close every hole with an outline up to ``LARGEST_HOLE`` by triangles around its center, in place."""
    vertices, faces, widths = list(mesh.vertices), [], []
    for loop in outlines(open_edges(mesh)):
        rim = mesh.vertices[loop]
        if len(loop) < 3 or hole_width(rim) > LARGEST_HOLE:
            continue
        # The rim runs along its triangles; the lid runs against them, so that both face the same side.
        ahead = loop[1:] + loop[:1]
        if len(loop) == 3:
            faces.append(loop[::-1])
        else:
            faces += [[end, start, len(vertices)] for start, end in zip(loop, ahead, strict=True)]
            vertices.append(rim.mean(axis=0))
        widths.append(hole_width(rim))
    if faces:
        mesh.vertices = np.array(vertices)
        mesh.faces = np.concatenate([mesh.faces, faces])
        repairs.append(f"closed {len(widths)} holes, the widest of {1e3 * max(widths):.2g} mm")


def refuse_open(mesh: trimesh.Trimesh, name: str) -> None:
    """Raise when an edge does not join exactly two triangles."""
    edges, crowded = open_edges(mesh), crowded_edges(mesh)
    if len(edges):
        widths = [hole_width(mesh.vertices[loop]) for loop in outlines(edges)]
        widest = f", the widest hole is {1e3 * max(widths):.2g} mm wide" if widths else ""
        raise MeshRefused(f"{name} (eye.path): {len(edges)} edges stay open{widest}, but a closed surface is needed "
                          f"(holes up to {1e3 * LARGEST_HOLE:.2g} mm are closed)", mesh, mesh.vertices[edges])
    if len(crowded):
        raise MeshRefused(f"{name} (eye.path): more than two triangles meet in {len(crowded)} edges, but a closed "
                          "surface without inner walls is needed", mesh, mesh.vertices[crowded])
    if not mesh.is_winding_consistent:
        raise MeshRefused(f"{name} (eye.path): the triangles cannot be given one outer side, but a closed surface "
                          "with an inside is needed", mesh, np.empty((0, 2, 3)))


def refuse_self_crossing(mesh: trimesh.Trimesh, name: str) -> None:
    """Raise when the volume by flux and the volume by counting inner points disagree: where sheets overlap they do."""
    cell = max(np.ptp(mesh.bounds, axis=0)) / 100.0
    lower, upper = mesh.bounds
    origin, counts = grid_nodes(lower, upper, cell, 2.0 * cell)
    counted = inner_nodes(mesh, origin, counts, cell).sum() * cell**3
    if abs(counted - mesh.volume) > SELF_CROSSING * max(counted, mesh.volume):
        raise MeshRefused(f"{name} (eye.path): the surface crosses itself (its volume is {1e6 * mesh.volume:.3g} mL by "
                          f"its sides and {1e6 * counted:.3g} mL by its inside), but a simple closed surface is needed",
                          mesh, np.empty((0, 2, 3)))
