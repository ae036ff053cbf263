"""Signed distance to the wall of the cavity on a uniform grid: negative inside, exact in a band along the wall."""
import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from pipeline.base.threads import library_threads

if TYPE_CHECKING:
    import trimesh

CANDIDATES = 4          # triangles tried per node, nearest centers first: right to 0.005 spacings (6: 0.001)
CHUNK = 200_000         # nodes per batch, keeps the arrays of the batch near 100 MB
# A domain of D dimensions has arrays of shape (..., D); D is 2 or 3.


@dataclasses.dataclass(frozen=True)
class SignedDistance:
    """Signed distance at the nodes of a grid.

    Attributes
    ----------
    values : (nx, ny[, nz]) float64, m, negative inside the cavity.
    origin : (D,) float64, m, position of node [0, 0(, 0)].
    cell : float, m, distance between nodes.
    """

    values: np.ndarray
    origin: np.ndarray
    cell: float

    def sample(self, points: np.ndarray) -> np.ndarray:
        """Interpolate linearly at points (n, D) in m; returns (n,) in m. Outside the grid the border value holds."""
        from scipy.ndimage import map_coordinates

        coordinates = (np.asarray(points, float) - self.origin).T / self.cell
        return map_coordinates(self.values, coordinates, order=1, mode="nearest")

    def normal(self, points: np.ndarray) -> np.ndarray:
        """Unit vector (n, D) away from the cavity: the gradient, by central differences over one cell each side."""
        steps = self.cell * np.eye(self.values.ndim)
        gradient = np.stack([self.sample(points + step) - self.sample(points - step) for step in steps], axis=-1)
        length = np.linalg.norm(gradient, axis=-1, keepdims=True)
        return gradient / np.maximum(length, 1e-12 * self.cell)

    def project(self, points: np.ndarray, level: float | np.ndarray, iterations: int = 3) -> np.ndarray:
        """Move points (n, D) along the normal onto the surface where the signed distance is ``level`` (m)."""
        for _ in range(iterations):
            points = points - (self.sample(points) - level)[:, None] * self.normal(points)
        return points

    def volume_below(self, level: float = 0.0) -> float:
        """Volume (m3; area in m2 in 2D) where the distance is below ``level``.

        Every node stands for one cell, cut by the surface in proportion to its distance: second order in the cell.
        """
        fraction = np.clip(0.5 + (level - self.values) / self.cell, 0.0, 1.0)
        return float(fraction.sum() * self.cell**self.values.ndim)


def grid_nodes(lower: ArrayLike, upper: ArrayLike, cell: float, margin: float) -> tuple[np.ndarray, np.ndarray]:
    """Grid that covers a box with a margin: origin (D,) in m and number of nodes per axis (D,), centered on the box."""
    low, high = np.asarray(lower, float), np.asarray(upper, float)
    counts = np.ceil((high - low + 2.0 * margin) / cell - 1e-9).astype(int) + 1
    return 0.5 * (low + high) - 0.5 * (counts - 1) * cell, counts


def node_positions(origin: np.ndarray, counts: np.ndarray, cell: float) -> np.ndarray:
    """Positions (nx, ny[, nz], D) of the nodes in m."""
    axes = [start + cell * np.arange(count) for start, count in zip(origin, counts, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def distance_of_function(
    function: Callable[[np.ndarray], np.ndarray], lower: ArrayLike, upper: ArrayLike, cell: float, margin: float,
) -> SignedDistance:
    """Grid of a known signed distance function, which maps points (..., D) in m to distances (...) in m."""
    origin, counts = grid_nodes(lower, upper, cell, margin)
    return SignedDistance(function(node_positions(origin, counts, cell)), origin, cell)


def distance_of_mesh(mesh: "trimesh.Trimesh", cell: float, margin: float) -> SignedDistance:
    """Signed distance to a closed triangle mesh.

    Parameters
    ----------
    mesh : closed surface in m; the direction of its triangles does not matter.
    cell : distance between nodes, m.
    margin : reach of the grid and of the exact band beyond the surface, m. Deeper inside than the margin the values
        come from the mask of inner nodes and are right to about one cell.
    """
    lower, upper = mesh.bounds
    origin, counts = grid_nodes(lower, upper, cell, margin)
    return distance_at_nodes(mesh, origin, counts, cell, margin)


def distance_at_nodes(mesh: "trimesh.Trimesh", origin: np.ndarray, counts: np.ndarray, cell: float,
                      band_width: float) -> SignedDistance:
    """Signed distance to a closed triangle mesh at the nodes of a given grid, exact in a band on both sides."""
    from scipy.ndimage import distance_transform_edt

    inside = inner_nodes(mesh, origin, counts, cell)
    depth = np.where(inside, -distance_transform_edt(inside), distance_transform_edt(~inside))
    values = cell * (depth - 0.5 * np.sign(depth))      # the surface lies between an inner and an outer node
    band = np.argwhere(np.abs(values) <= band_width + cell)
    exact = distance_to_triangles(mesh, origin + cell * band, longest_edge=2.0 * cell)
    index = tuple(band.T)
    values[index] = np.where(inside[index], -exact, exact)
    return SignedDistance(values, origin, cell)


def inner_nodes(mesh: "trimesh.Trimesh", origin: np.ndarray, counts: np.ndarray, cell: float) -> np.ndarray:
    """Mask (nx, ny, nz) of the grid nodes inside a closed mesh, by scan lines: blind to the direction of triangles."""
    import pyvista
    from vtkmodules.vtkImagingStencil import vtkImageStencilToImage, vtkPolyDataToImageStencil

    grid = pyvista.ImageData(dimensions=counts, spacing=[cell] * 3, origin=origin)
    surface = pyvista.make_tri_mesh(mesh.vertices, mesh.faces)
    stencil = vtkPolyDataToImageStencil()
    stencil.SetInputData(surface)
    stencil.SetOutputOrigin(grid.origin)
    stencil.SetOutputSpacing(grid.spacing)
    stencil.SetOutputWholeExtent(grid.extent)
    image = vtkImageStencilToImage()
    image.SetInputConnection(stencil.GetOutputPort())
    image.SetInsideValue(1)
    image.SetOutsideValue(0)
    image.SetOutputScalarTypeToUnsignedChar()
    image.Update()
    scalars = pyvista.wrap(image.GetOutput()).point_data.active_scalars
    return np.asarray(scalars).reshape(counts, order="F").astype(bool)


def distance_to_triangles(mesh: "trimesh.Trimesh", points: np.ndarray, longest_edge: float) -> np.ndarray:
    """Unsigned distance (n,) in m from points (n, 3) to the surface of a mesh.

    The triangles are cut until no edge exceeds ``longest_edge`` (the surface stays the same); the distance is the
    smallest of the exact distances to the ``CANDIDATES`` triangles whose centers are nearest.
    """
    import trimesh
    from scipy.spatial import cKDTree

    vertices, faces = trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.faces, longest_edge, max_iter=20)
    corners = vertices[faces]
    tree = cKDTree(corners.mean(axis=1))
    distances = np.empty(len(points))
    for start in range(0, len(points), CHUNK):
        batch = points[start:start + CHUNK]
        _, nearest = tree.query(batch, k=min(CANDIDATES, len(faces)), workers=library_threads())
        nearest = nearest.reshape(len(batch), -1)
        squared = np.full(len(batch), np.inf)
        for column in nearest.T:
            squared = np.minimum(squared, squared_distance_to_triangle(batch, *np.moveaxis(corners[column], 1, 0)))
        distances[start:start + CHUNK] = np.sqrt(squared)
    return distances


def squared_distance_to_triangle(point: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Squared distance (n,) from each point (n, 3) to its own triangle a b c (n, 3 each)."""
    normal = np.cross(b - a, c - a)
    area = np.maximum(dot(normal, normal), 1e-300)
    over_face = np.ones(len(point), bool)
    to_edges = np.full(len(point), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        edge, arm = end - start, point - start
        over_face &= dot(np.cross(edge, arm), normal) >= 0.0
        along = np.clip(dot(arm, edge) / np.maximum(dot(edge, edge), 1e-300), 0.0, 1.0)
        rest = arm - along[:, None] * edge
        to_edges = np.minimum(to_edges, dot(rest, rest))
    return np.where(over_face, dot(point - a, normal) ** 2 / area, to_edges)


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Scalar product of each row."""
    return np.einsum("ij,ij->i", a, b)
