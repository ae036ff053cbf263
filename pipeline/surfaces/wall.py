"""The wall of the cavity in the fine cells of its grid: depth at their corners, and its triangles in each of them."""
from typing import TYPE_CHECKING

import numpy as np

from pipeline.surfaces.bricks import Bricks
from pipeline.surfaces.contour import away_from_zero, signed_volumes
from pipeline.surfaces.cut_cells import (
    CODES,
    CORNERS,
    DEPTH,
    EDGE_AXIS,
    EDGE_ENDS,
    ambiguous,
    block_patterns,
    patches,
    table_triangles,
)

if TYPE_CHECKING:
    from pipeline.surfaces.cavity_grid import CavityGrid


class Wall:
    """The wall, made once for all frames.

    Attributes
    ----------
    bricks : those that it crosses.
    depth : (split + 1, split + 1, split + 1, n) float32 at the nodes of each, in spacings.
    pattern : (split, split, split, n) signs of the depth at the corners of their cells.
    inside : (nx, ny, nz) whether the cells of other bricks are in the cavity.
    brick, place : (c,) coarse flat index of the brick and place in it of every cell with triangles.
    vertices (v, 3), triangles (t, 3), cell (t,) : m, vertices, and the cell of each triangle.
    volumes : (t,) m**3 between the triangles and the point ``center``.
    """

    def __init__(self, grid: "CavityGrid"):
        self._cell, self._origin = grid.cell, grid.origin
        self.shape = tuple(n + 1 for n in grid.fine_shape)
        centers = np.stack(np.meshgrid(*(np.arange(n) + 0.5 for n in grid.shape), indexing="ij"), axis=-1)
        depth = grid.depth_at(grid.origin + grid.coarse_cell * centers)
        near = np.abs(depth) * grid.spacing < grid.coarse_cell     # the corners of a cube are 0.87 away
        near[-1], near[:, -1], near[:, :, -1] = False, False, False
        self.inside, self.bricks = depth > 0.0, Bricks(near, grid.split)
        fine = self.bricks.fine_indices(np.arange(len(self.bricks.corner) * grid.split**3))
        self._at_nodes = away_from_zero(grid.depth_at(grid.origin + grid.cell * fine)).astype(np.float32)
        self.depth = self._at_nodes[self.bricks.nodes(np.arange(self.bricks.count))]
        self.pattern = block_patterns(self.depth)
        self._find_triangles()

    def edge_key(self, fine: np.ndarray, edge: np.ndarray) -> np.ndarray:
        """Number (...,) in the whole grid of an edge of the cell whose lowest node has indices ``fine`` (..., 3)."""
        start = fine + CORNERS[EDGE_ENDS[edge, 0]]
        return np.ravel_multi_index(tuple(np.moveaxis(start, -1, 0)), self.shape) * 3 + EDGE_AXIS[edge]

    def vertex(self, fine: np.ndarray, edge: np.ndarray) -> np.ndarray:
        """Vertices (...,) on edges that the wall crosses."""
        return np.searchsorted(self._keys, self.edge_key(fine, edge))

    def _find_triangles(self) -> None:
        split = self.bricks.split
        *place, brick = np.nonzero((self.pattern != 0) & (self.pattern != 255))
        pattern = self.pattern[(*place, brick)]
        fine = self.bricks.corner[brick] * split + np.stack(place, axis=1)
        self.brick = np.ravel_multi_index(tuple(self.bricks.corner[brick].T), self.bricks.coarse_shape)
        self.place = np.ravel_multi_index(tuple(place), [split] * 3)
        simple = ~ambiguous()[pattern]
        cell, edge = table_triangles(np.where(simple, pattern, 0))
        rest = np.flatnonzero(~simple)
        depth = self.depth[(*(place[k][rest, None] + CORNERS[:, k] for k in range(3)), brick[rest, None])]
        of, _, code, _, of_center, center = patches(np.ones_like(depth), depth)
        # Edges first, then the centers of loops.
        keys, keep = self.edge_key(fine[cell][:, None], edge), code < CODES
        other = np.where(keep, self.edge_key(fine[rest][of][:, None], np.where(keep, code - DEPTH, 0)), -1)
        self._keys = np.unique(np.concatenate([keys.ravel(), other[keep]]))
        self.cell = np.concatenate([cell, rest[of]])
        self.triangles = np.concatenate([
            np.searchsorted(self._keys, keys),
            np.where(keep, np.searchsorted(self._keys, other), len(self._keys) + code - CODES)])
        start, axis = np.divmod(self._keys, 3)
        start, step = np.stack(np.unravel_index(start, self.shape), axis=1), np.eye(3, dtype=int)[axis]
        low, high = (self._at_nodes[self.bricks.find(ends)].astype(float) for ends in (start, start + step))
        on_edges = start + (low / (low - high))[:, None] * step
        self.vertices = self._origin + self._cell * np.concatenate([on_edges, fine[rest][of_center] + center])
        self.center = self.vertices.mean(axis=0) if len(self.vertices) else self._origin
        self.volumes = signed_volumes(self.vertices, self.triangles, self.center)
