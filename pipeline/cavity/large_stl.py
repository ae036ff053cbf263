"""A binary STL file of millions of triangles, reduced slab by slab, so that few of them are in memory at once."""
from pathlib import Path

import numpy as np
import pyvista

TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
HEAD = 84                       # bytes before the first triangle; the last four are their number
AT_ONCE = 500_000               # triangles of a slab
LEFT = 1_000_000                # triangles that are left of all slabs


def many_triangles(path: Path) -> int:
    """Return the number of triangles of a large binary STL file, 0 of any other file."""
    if path.suffix.lower() != ".stl" or path.stat().st_size <= HEAD + TRIANGLE.itemsize * LEFT:
        return 0
    with path.open("rb") as file:
        count = int.from_bytes(file.read(HEAD)[80:], "little")
    return count if path.stat().st_size == HEAD + TRIANGLE.itemsize * count else 0


def read_reduced(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices (n, 3) float, in the unit of the file, and triangles (m, 3) int: about ``LEFT`` of them.

    The edge of a slab keeps all of its vertices, so that slabs fit together, and a closed surface stays closed.

    Raises
    ------
    ValueError : a corner is no finite number.
    """
    corners = np.memmap(path, TRIANGLE, "r", HEAD)["corners"]
    centers = np.empty((len(corners), 3), np.float32)
    for begin in range(0, len(corners), AT_ONCE):
        centers[begin:begin + AT_ONCE] = corners[begin:begin + AT_ONCE].mean(axis=1)
    if not np.isfinite(centers).all():
        raise ValueError("it holds numbers that are not finite")
    order = np.argsort(centers[:, np.ptp(centers, axis=0).argmax()])
    del centers
    share, vertices, faces, count = LEFT / len(corners), [], [], 0
    for slab in np.array_split(order, -(-len(order) // AT_ONCE)):
        # In the order of the file, its pages are read once.
        points = corners[np.sort(slab)].reshape(-1, 3)
        found = reduced(points, np.arange(len(points)).reshape(-1, 3), 0.0, share)
        vertices.append(found[0])
        faces.append(found[1] + count)
        count += len(found[0])
    return np.concatenate(vertices), np.concatenate(faces)


def reduced(vertices: np.ndarray, faces: np.ndarray, tolerance: float, share: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a surface with a share of its triangles; a closed one stays closed, and holes keep their outline.

    Parameters
    ----------
    vertices, faces : (n, 3) and (m, 3).
    tolerance : vertices that are nearer to each other are joined; what is not joined cannot be reduced.
    """
    from vtkmodules.vtkFiltersCore import vtkDecimatePro, vtkStaticCleanPolyData

    weld = vtkStaticCleanPolyData()
    weld.SetInputData(pyvista.make_tri_mesh(vertices, faces))
    weld.ToleranceIsAbsoluteOn()
    weld.SetAbsoluteTolerance(tolerance)
    reduce = vtkDecimatePro()
    reduce.SetInputConnection(weld.GetOutputPort())
    reduce.SetTargetReduction(1.0 - share)
    reduce.PreserveTopologyOn()
    reduce.BoundaryVertexDeletionOff()
    reduce.Update()
    surface = pyvista.wrap(reduce.GetOutput())
    return np.asarray(surface.points, float), np.asarray(surface.regular_faces, int)
