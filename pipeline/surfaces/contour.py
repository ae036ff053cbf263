"""Closed triangle meshes from a field on a grid, and what can be told about them."""
import dataclasses
import functools

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

# A node that is exactly on the level gives triangles without area, which open when vertices are merged.
LEVEL_MARGIN = 1e-4


@dataclasses.dataclass(frozen=True)
class TriangleMesh:
    """Triangles with outward direction: ``vertices`` (v, 3) float64 in m, ``triangles`` (t, 3) int."""

    vertices: np.ndarray
    triangles: np.ndarray

    @property
    def volume(self) -> float:
        """Enclosed volume, m**3."""
        return float(self._parts.sum())

    @property
    def counts(self) -> dict[str, int]:
        """Size of the mesh for the statistics."""
        return {"triangles": len(self.triangles)}

    @property
    def points(self) -> np.ndarray:
        """The vertices, m."""
        return self.vertices

    def is_closed(self) -> bool:
        """Whether every edge belongs to two triangles, once in each direction (closed, manifold, one orientation)."""
        count = len(self.vertices)
        start = self.triangles.ravel().astype(np.int64)
        end = self.triangles[:, [1, 2, 0]].ravel().astype(np.int64)
        # Numbers of edges, the last bit of which is the direction: each must be there once in both.
        key = np.sort(2 * (np.minimum(start, end) * count + np.maximum(start, end)) + (start > end))
        return len(key) % 2 == 0 and bool((key[::2] % 2 == 0).all() and (key[1::2] == key[::2] + 1).all() and
                                          (np.diff(key) > 0).all() and (start != end).all())

    def component_volumes(self) -> np.ndarray:
        """Signed volume of every connected piece, m**3, the largest first; voids count negative."""
        if not len(self.triangles):
            return np.zeros(0)
        links = self.triangles[:, [0, 1, 0, 2]].reshape(-1, 2)
        graph = coo_matrix((np.ones(len(links), bool), tuple(links.T)), shape=(len(self.vertices),) * 2)
        pieces, label = connected_components(graph, directed=False)
        return np.sort(np.bincount(label[self.triangles[:, 0]], self._parts, minlength=pieces))[::-1]

    @functools.cached_property
    def _parts(self) -> np.ndarray:
        # The middle as origin keeps the digits of meshes far from the corner of the container.
        middle = self.vertices.mean(axis=0) if len(self.vertices) else np.zeros(3)
        return signed_volumes(self.vertices, self.triangles, middle)


def signed_volumes(vertices: np.ndarray, triangles: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Volumes (t,), m**3, between triangles and a point (3,): of a closed surface their sum is what it encloses."""
    places = np.ascontiguousarray((vertices - point).T)
    a, b, c = (places.take(corner, axis=1) for corner in np.ascontiguousarray(triangles.T))
    return (a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
            a[2] * (b[0] * c[1] - b[1] * c[0])) / 6.0


def contour(field: np.ndarray, origin: np.ndarray, cell: float, method: str = "flying_edges") -> TriangleMesh:
    """Surface where ``field`` (nx, ny, nz), positive inside, crosses zero.

    The border of the grid counts as outside, so the mesh is closed. ``method`` is "flying_edges" or "marching_cubes".
    A field without inside gives a mesh without triangles.
    """
    padded = np.pad(away_from_zero(field), 1, constant_values=-1.0)
    if not (padded > 0).any():
        return TriangleMesh(np.zeros((0, 3)), np.zeros((0, 3), np.int64))
    vertices, triangles = {"flying_edges": _flying_edges, "marching_cubes": _marching_cubes}[method](padded)
    return TriangleMesh(np.asarray(origin) + (vertices - 1.0) * cell, triangles)


def enclosed_volumes(fields: np.ndarray, cell: float, method: str = "flying_edges") -> np.ndarray:
    """Volume (k,), m**3, that ``contour`` encloses in each field (k, nx, ny, nz): one contour around all in a row.

    Its points have seven digits, of places along the row: those of a thousand fields may be off by 1e-3 cells.
    """
    length = fields.shape[1] + 1
    row = np.pad(fields, ((0, 0), (0, 1), (0, 0), (0, 0)), constant_values=-1.0).reshape(-1, *fields.shape[2:])
    mesh = contour(row, np.zeros(3), 1.0, method)
    field = np.floor((mesh.vertices[mesh.triangles[:, 0], 0] + 1.0) / length).astype(np.int64)
    # The middle of its field as origin keeps the digits of a triangle far down the row.
    middle = 0.5 * np.array(fields.shape[1:]) + np.outer(length * field, [1.0, 0.0, 0.0])
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] - middle for k in range(3))
    return cell**3 * np.bincount(field, np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0, minlength=len(fields))


def away_from_zero(field: np.ndarray) -> np.ndarray:
    """The field with values nearer to zero than ``LEVEL_MARGIN`` moved there; zero itself counts as outside."""
    return np.where(np.abs(field) < LEVEL_MARGIN, np.where(field > 0, LEVEL_MARGIN, -LEVEL_MARGIN), field)


def _flying_edges(field: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    import pyvista
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkFiltersCore import vtkFlyingEdges3D

    grid = pyvista.ImageData(dimensions=field.shape)
    # The filter finds the inside on the low side of the level: the sign gives triangles that face outward.
    grid.point_data["field"] = field.ravel(order="F").astype(np.float64)
    filter_ = vtkFlyingEdges3D()
    filter_.SetInputData(grid)
    filter_.SetValue(0, 0.0)
    filter_.ComputeNormalsOff()
    filter_.ComputeScalarsOff()
    filter_.Update()
    mesh = filter_.GetOutput()
    vertices = vtk_to_numpy(mesh.GetPoints().GetData()).astype(np.float64)
    triangles = vtk_to_numpy(mesh.GetPolys().GetConnectivityArray()).reshape(-1, 3).astype(np.int64)
    return vertices, triangles


def _marching_cubes(field: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    from skimage.measure import marching_cubes

    vertices, triangles, _, _ = marching_cubes(field, 0.0, gradient_direction="ascent")
    return vertices.astype(np.float64), triangles.astype(np.int64)
