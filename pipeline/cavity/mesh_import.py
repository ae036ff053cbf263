"""A user's surface of the cavity: read, check its unit, repair small defects, refuse the rest with the reason."""
import dataclasses
from pathlib import Path

import numpy as np
import trimesh
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from pipeline.base.errors import UserError
from pipeline.cavity import large_stl
from pipeline.cavity.globe import globe_center, vertex_areas
from pipeline.cavity.label_images import read_label
from pipeline.cavity.large_stl import reduced
from pipeline.cavity.mesh_files import read_mesh_file
from pipeline.cavity.signed_distance_grid import grid_nodes, inner_nodes
from pipeline.cavity.voxel_steps import smoothed, step_size
from pipeline.scenes.eye_shape import LARGEST_VOLUME, SMALLEST_VOLUME
from pipeline.scenes.model import MESH_UNITS, is_image

SMALLEST_SIZE, LARGEST_SIZE = 15e-3, 40e-3          # largest outer dimension of a cavity, m
SMALLEST_DEPTH = 10e-3                              # smallest one: lens to retina is 13 mm in a short eye
WELD_DIGITS = 7                 # vertices that agree to 0.1 um are one
RELATIVE_WELD = 4e-6            # the same, of the size of a surface whose unit may be wrong
DEBRIS_AREA = 0.05              # pieces that together have less of the area are dropped, larger ones refused
LARGEST_HOLE = 2.5e-3           # width of a hole that is closed, m: a flat lid there is less than 0.1 mm off
LARGEST_OFFSET = 0.5e-3         # from which it is told that the center of the globe was moved to the origin, m
FARTHEST = 1.7                  # of the globe's radius: farther points are a spike, a staphyloma of 6 mm reaches 1.55
SELF_CROSSING = 0.02            # disagreement of two kinds of volume that shows a surface crossing itself
MOST_TRIANGLES = 200_000        # of an eye they are 0.14 mm wide, finer than any spacing that a computer can afford
LARGEST_GAP = 0.15e-3           # between flat triangles and the round wall, m: there a ball lacks 3 % of its volume
LEAST_SPHERICITY = 0.88         # eyes of all lens states and lengths have 0.93 to 0.99, a cylinder 0.87, a cube 0.81


class MeshRefused(UserError):
    """A surface that cannot be repaired; ``mesh`` and ``segments`` (n, 2, 3) in m show the place."""

    def __init__(self, message: str, mesh: trimesh.Trimesh, segments: np.ndarray):
        super().__init__(message)
        self.mesh = mesh
        self.segments = segments


@dataclasses.dataclass(frozen=True)
class ImportedMesh:
    """A closed surface in m with outward normals, and sentences: what was repaired, and what is unlike an eye.

    Attributes
    ----------
    space : "LPS" or "RAS" where the file names its axes; else "".
    """

    mesh: trimesh.Trimesh
    repairs: tuple[str, ...]
    warnings: tuple[str, ...]
    space: str = ""


def import_mesh(path: str | Path, unit: str = "mm", force: bool = False, to_origin: bool = True, smooth: bool = False,
                label: int | None = None, side: str = "right") -> ImportedMesh:
    """Read and repair the surface of a cavity.

    Parameters
    ----------
    path : STL, OBJ, PLY, VTK, VTP, VTU or MSH file; of a volume mesh the outer surface is taken. Or an image of labels,
        NIfTI or NRRD, whose steps are always smoothed.
    unit : unit of length of the file, one of ``MESH_UNITS``.
    force : accept a size and a volume unlike an eye's, and steps of voxels.
    to_origin : move the center of the globe to the origin; not where landmarks say where it is in the file.
    smooth : smooth the steps of voxels, at the same volume.
    label : number of the vitreous cavity in an image of labels.
    side : which eye it should be, where an image tells it.

    Raises
    ------
    UserError : the file cannot be read, its unit or volume is unlike an eye's, or it has steps of voxels.
    MeshRefused : the surface stays open, consists of several pieces or crosses itself.
    """
    if is_image(path):
        file = read_label(Path(path), label, unit, force, side)
        unit = file.unit
    else:
        file = read_mesh_file(Path(path))
    vertices, faces = file.vertices, file.faces
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise UserError(f"{path} (eye.path): is damaged (a triangle has a corner that is not there), export or copy it "
                        "again")
    if not np.isfinite(vertices).all():
        raise UserError(f"{path} (eye.path): {np.sum(~np.isfinite(vertices).all(axis=1))} vertices are not finite "
                        "numbers, export the surface again")
    refuse_bodies(trimesh.Trimesh(MESH_UNITS[unit] * vertices, faces, process=False), str(path))
    if not force:
        check_unit(path, np.ptp(vertices[np.unique(faces)], axis=0), unit)
    vertices, faces, coarsened = coarsen(MESH_UNITS[unit] * vertices, faces)
    mesh, repairs = repair(trimesh.Trimesh(vertices, faces, process=False), str(path))
    if many := large_stl.many_triangles(Path(path)):
        repairs.insert(0, f"read {many} triangles in slabs, which were reduced one by one")
    repairs = [*file.made, *coarsened, *repairs]
    if not force and not SMALLEST_VOLUME <= mesh.volume <= LARGEST_VOLUME:
        raise UserError(f"{path} (eye.path): the cavity holds {1e6 * mesh.volume:.2f} mL, but 2 to 12 mL are like an "
                        "eye's (eye.force: true accepts any volume)")
    steps = 0.0 if file.made else step_size(mesh)
    if smooth and not file.made:
        mesh = smoothed(mesh)
        repairs.append(f"smoothed steps of voxels of {1e3 * steps:.2g} mm, at the same volume" if steps else
                       "smoothed, at the same volume, as eye.smooth asks for, though it has no steps of voxels")
    elif steps and not force:
        raise UserError(f"{path} (eye.path): the surface has steps of voxels, of {1e3 * steps:.2g} mm, which liquids "
                        "would feel: set eye.smooth: true to smooth it at the same volume, or eye.force: true to take "
                        "it as it is")
    offset = globe_center(mesh)
    unlike = [f"{path} (eye.path): {note}" for note in file.notes] + unlike_an_eye(mesh, str(path), offset)
    if to_origin:
        mesh.apply_translation(-offset)
        if np.linalg.norm(offset) > LARGEST_OFFSET:
            repairs.append("moved the center of the globe to the origin, from "
                           f"({', '.join(f'{1e3 * value:.1f}' for value in offset)}) mm")
    return ImportedMesh(mesh, tuple(repairs), tuple(unlike), file.space)


def unlike_an_eye(mesh: trimesh.Trimesh, name: str, center: np.ndarray) -> list[str]:
    """Sentences on a shape with its globe around a center (3,) that no vitreous cavity has; `name` begins them."""
    found = []
    handles = (2 - mesh.euler_number) // 2
    if handles:
        found.append(f"{name} (eye.path): the surface has {handles} handle{'s' * (handles > 1)}, like a ring, but the "
                     "cavity of an eye has none")
    sphericity = np.pi ** (1.0 / 3.0) * (6.0 * abs(mesh.volume)) ** (2.0 / 3.0) / mesh.area
    if sphericity < LEAST_SPHERICITY:
        found.append(f"{name} (eye.path): the surface has a sphericity of {sphericity:.2f}, but the cavity of an eye "
                     f"has more than 0.93 (a cube has 0.81)")
    if (gap := typical_gap(mesh)) > LARGEST_GAP:
        found.append(f"{name} (eye.path): the surface has {len(mesh.faces)} triangles only, whose middles lie "
                     f"{1e3 * gap:.2g} mm beside a round wall, so that its volume is too small: export it finer")
    distance, areas = np.linalg.norm(mesh.vertices - center, axis=1), vertex_areas(mesh)
    order = np.argsort(distance)
    radius = float(distance[order][np.searchsorted(areas[order].cumsum(), 0.5 * areas.sum())])  # half of the area is in
    if distance.max() > FARTHEST * radius:
        place = ", ".join(f"{1e3 * value:.1f}" for value in mesh.vertices[distance.argmax()])
        found.append(f"{name} (eye.path): the surface has a spike: its point ({place}) mm is "
                     f"{1e3 * distance.max():.1f} mm from the center of the globe, whose radius is {1e3 * radius:.1f} "
                     "mm; remove it if it is a defect")
    return found


def typical_gap(mesh: trimesh.Trimesh) -> float:
    """Distance, m, from the middles of triangles to the round surface through their corners, at half of the edges.

    Middles a distance d apart, whose normals differ by an angle, lie on a surface of radius d / angle.
    """
    pairs = mesh.face_adjacency
    apart = np.linalg.norm(mesh.triangles_center[pairs[:, 0]] - mesh.triangles_center[pairs[:, 1]], axis=1)
    gaps = 0.5 * apart * mesh.face_adjacency_angles
    edges = mesh.vertices[mesh.face_adjacency_edges]
    order, lengths = np.argsort(gaps), np.linalg.norm(edges[:, 0] - edges[:, 1], axis=1)
    return float(gaps[order][np.searchsorted(lengths[order].cumsum(), 0.5 * lengths.sum())])


def refuse_bodies(mesh: trimesh.Trimesh, name: str) -> None:
    """Raise where a surface of any size is of several bodies, such as both eyes of a head or a wall with two sides."""
    vertices = mesh.vertices - mesh.vertices.min(axis=0)
    steps = np.round(vertices / (float(vertices.max()) or 1.0) / RELATIVE_WELD).astype(np.int64)
    _, point = np.unique((steps[:, 0] << 40) + (steps[:, 1] << 20) + steps[:, 2], return_inverse=True)
    a, b, c = point.ravel()[mesh.faces].T
    count = int(point.max()) + 1
    graph = coo_matrix((np.ones(2 * len(a)), (np.concatenate([a, b]), np.concatenate([b, c]))), (count, count))
    of_face = connected_components(graph, directed=False)[1][a]
    areas = np.bincount(of_face, mesh.area_faces)
    largest = int(areas.argmax())
    if areas[largest] >= (1.0 - DEBRIS_AREA) * areas.sum():
        return
    pieces = [mesh.triangles[of_face == one] for one in np.flatnonzero(areas > DEBRIS_AREA * areas.sum())]
    boxes = [(corners.min(axis=(0, 1)), corners.max(axis=(0, 1))) for corners in pieces]
    nested = any((low >= lower).all() and (high <= upper).all() for i, (low, high) in enumerate(boxes)
                 for j, (lower, upper) in enumerate(boxes) if i != j)
    middles = [", ".join(f"{1e3 * value:.3g}" for value in 0.5 * (low + high)) for low, high in boxes[:3]]
    others = mesh.triangles[of_face != largest]
    raise MeshRefused(
        f"{name} (eye.path): the surface consists of {(areas > 0.0).sum()} separate pieces and the largest has only "
        f"{100 * areas[largest] / areas.sum():.0f} % of the area, but one closed surface is needed; " + (
            "one lies in another, like the two sides of a wall: export the inner one alone" if nested else
            f"export one of them alone (large ones are around ({'), ('.join(middles)}) mm)"),
        mesh, np.concatenate([others[:, [0, 1]], others[:, [1, 2]], others[:, [2, 0]]]))


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
    MeshRefused : what is left is open or crosses itself; ``name`` begins the sentence.
    """
    mesh = mesh.copy()
    repairs = weld(mesh)
    mesh = drop_debris(mesh, repairs)
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


def drop_debris(mesh: trimesh.Trimesh, repairs: list[str]) -> trimesh.Trimesh:
    """Keep the piece that has nearly all of the area (``refuse_bodies``)."""
    pieces = trimesh.graph.connected_components(mesh.face_adjacency, nodes=np.arange(len(mesh.faces)), min_len=1)
    if len(pieces) == 1:
        return mesh
    areas = np.array([mesh.area_faces[piece].sum() for piece in pieces])
    largest = int(areas.argmax())
    rest = 1.0 - areas[largest] / areas.sum()
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
