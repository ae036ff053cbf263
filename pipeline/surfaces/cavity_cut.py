"""The cavity cut along the zero of a level into the inside and the other side, as triangles."""
import numpy as np

from pipeline.surfaces.bricks import Bricks
from pipeline.surfaces.cavity_grid import CavityGrid
from pipeline.surfaces.contour import TriangleMesh, signed_volumes
from pipeline.surfaces.cut_cells import (
    BETWEEN,
    CODES,
    CONTACT,
    CORNERS,
    DEPTH,
    EDGE_AXIS,
    EDGE_ENDS,
    FACE_CORNERS,
    INTERFACE,
    OTHER_WALL,
    WALL,
    ambiguous,
    block_patterns,
    patches,
    table_triangles,
)


class CavityCut:
    """The cavity cut along the zero of a level: the interface, and the wall on both sides of it.

    Attributes
    ----------
    growth : by how much the volume grows with the level, m**3; roughly.

    Parameters
    ----------
    bricks : with nodes around all that the level crosses.
    crossed : (n,) numbers of those in which it may have both signs.
    nodes : (split + 1, split + 1, split + 1, n) their nodes.
    level : (m,) float32 at all nodes, nowhere 0.
    positive : (nx, ny, nz) its sign in all other coarse cells; changed.
    """

    def __init__(self, grid: CavityGrid, bricks: Bricks, crossed: np.ndarray, nodes: np.ndarray, level: np.ndarray,
                 positive: np.ndarray):
        self._grid, self._bricks, self._level, wall = grid, bricks, level, grid.wall
        inside = (level > 0.0)[nodes].reshape((grid.split + 1) ** 3, len(crossed))
        mixed = np.flatnonzero(inside.any(axis=0) != inside.all(axis=0))
        self._nodes, corner = np.ascontiguousarray(nodes[..., mixed]), bricks.corner[crossed[mixed]]
        self._corner, self._block = corner, level[self._nodes]
        row = wall.bricks.number[tuple(corner.T)]
        self._row = np.where(row < wall.bricks.count, row, -1)
        pattern, at_wall = block_patterns(self._block), self._row >= 0
        depth_pattern = np.zeros(pattern.shape, np.uint8)
        depth_pattern[..., at_wall] = wall.pattern[..., self._row[at_wall]]
        depth_pattern[..., ~at_wall & wall.inside[tuple(corner.T)]] = 255
        cut = (pattern != 0) & (pattern != 255) & (depth_pattern != 0)
        simple = cut & (depth_pattern == 255) & ~ambiguous()[pattern]
        whole = self._simple(np.nonzero(simple), pattern[simple])
        patch, cut, points = self._general(np.nonzero(cut & ~simple))
        # Points on edges of cells are numbered by edge at first: 3 node + axis.
        edges = len(level) * 3
        used = np.zeros(edges, bool)
        used[whole] = True
        used[cut[cut < edges]] = True
        slots = np.flatnonzero(used)
        number = np.zeros(edges, np.int64)
        number[slots] = np.arange(len(slots))
        cut = np.where(cut < edges, number[np.minimum(cut, edges - 1)], cut - edges + len(slots))
        places, rise = self._on_edges(slots)
        # Along the lines of the grid in each of three directions, the inside grows where they cross the surface.
        self.growth = float((grid.cell**3 / 3.0 / rise).sum())
        self._vertices = np.concatenate([places, wall.vertices, points])
        self._interface = np.concatenate([number[whole], cut[patch == INTERFACE]])
        self._cut_wall = {kind: cut[patch == kind] for kind in (WALL, OTHER_WALL)}
        self._first_of_wall = len(slots)
        positive[tuple(bricks.corner.T)] = level[::grid.split**3] > 0.0
        self._whole_wall = self._sides_of_wall(pattern, mixed, positive)

    def volume(self, *, other: bool = False) -> float:
        """Volume, m**3, where the level is positive, or on the other side."""
        wall, side = self._grid.wall, OTHER_WALL if other else WALL
        parts = [signed_volumes(self._vertices, some, wall.center).sum() for some in
                 (self._interface, self._cut_wall[side])]
        return float((-parts[0] if other else parts[0]) + parts[1] + wall.volumes @ self._whole_wall[side])

    def mesh(self, *, other: bool = False) -> TriangleMesh:
        """Closed surface of where the level is positive, or of the other side, around the same interface."""
        wall, side = self._grid.wall, OTHER_WALL if other else WALL
        interface = self._interface[:, ::-1] if other else self._interface
        triangles = np.concatenate([interface, self._cut_wall[side],
                                    wall.triangles[self._whole_wall[side]] + self._first_of_wall])
        used = np.zeros(len(self._vertices), bool)
        used[triangles] = True
        return TriangleMesh(self._vertices[used], (np.cumsum(used) - 1)[triangles])

    def _simple(self, cells: tuple[np.ndarray, ...], pattern: np.ndarray) -> np.ndarray:
        """Edges (t, 3) of the interface in cells that neither the wall crosses nor a face with two chords bounds."""
        cell, edge = table_triangles(pattern)
        return self._slot(np.ravel_multi_index(cells, self._nodes.shape)[cell][:, None], edge)

    def _general(self, places: tuple[np.ndarray, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Patch (t,) and points (t, 3) of the triangles in all other cells, and what points are new (p, 3), m.

        Points on edges are numbered by edge, those of the wall and the new ones after them.
        """
        grid, wall = self._grid, self._grid.wall
        cells = np.stack(places, axis=1)
        brick, (i, j, k) = cells[:, 3], np.moveaxis(cells[:, None, :3] + CORNERS, -1, 0)
        row = self._row[brick]
        level = self._block[i, j, k, brick[:, None]]
        depth = np.where(row[:, None] >= 0, wall.depth[i, j, k, row[:, None]], np.float32(1.0))
        cell, patch, code, spot, of_center, center = patches(level, depth)
        fine = self._corner[brick] * grid.split + cells[:, :3]
        result, kind = np.empty_like(code), np.digitize(code, (DEPTH, CONTACT, BETWEEN, CODES))
        edges, of = 3 * len(self._level), np.broadcast_to(cell[:, None], code.shape)
        lowest = np.ravel_multi_index(tuple(cells.T), self._nodes.shape)
        result[kind == 0] = self._slot(lowest[of[kind == 0]], code[kind == 0])
        result[kind == 1] = edges + wall.vertex(fine[of[kind == 1]], code[kind == 1] - DEPTH)
        # Cells that share a face have its points of the contact line in common.
        new = (kind == 2) | (kind == 3)
        face, chords = np.divmod(code[new] - CONTACT, 4)
        start = fine[of[new]] + CORNERS[FACE_CORNERS[face % 6, 0]]
        key = (np.ravel_multi_index(tuple(start.T), wall.shape) * 3 + face % 6 // 2) * 4 + chords
        key = np.where(face < 6, key, -1 - (of[new] * CODES + code[new]))
        _, first, number = np.unique(key, return_index=True, return_inverse=True)
        after = edges + len(wall.vertices)
        result[new] = after + number
        result[kind == 4] = after + len(first) + code[kind == 4] - CODES
        where = of[new][first]
        points = np.concatenate([fine[where] + spot[where, code[new][first]], fine[of_center] + center])
        return patch, result, grid.origin + grid.cell * points

    def _slot(self, cells: np.ndarray, edge: np.ndarray) -> np.ndarray:
        """Numbers of edges (...,) of cells (...,), these as places of their lowest nodes in the blocks."""
        step = np.ravel_multi_index(tuple(CORNERS[EDGE_ENDS[:, 0]].T), self._nodes.shape[:3]) * self._nodes.shape[3]
        return self._nodes.ravel()[cells + step[edge]].astype(np.int64) * 3 + EDGE_AXIS[edge]

    def _on_edges(self, slots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points (n, 3), m, where the level is zero on edges (n,), and by how much it rises along these (n,)."""
        node, axis = np.divmod(slots, 3)
        start, step = self._bricks.fine_indices(node), np.eye(3, dtype=int)[axis]
        low, high = (self._level[nodes].astype(float) for nodes in (node, self._bricks.find(start + step)))
        places = start + (low / (low - high))[:, None] * step
        return self._grid.origin + self._grid.cell * places, np.abs(high - low)

    def _sides_of_wall(self, pattern: np.ndarray, mixed: np.ndarray, positive: np.ndarray) -> dict[int, np.ndarray]:
        """Which triangles of the wall are whole on either side, (t,) bool each."""
        wall = self._grid.wall
        sign = np.where(positive.ravel()[wall.brick], 255, 0)
        number = np.full(self._bricks.number.size, -1)
        number[np.ravel_multi_index(tuple(self._corner.T), self._bricks.coarse_shape)] = np.arange(len(mixed))
        brick = number[wall.brick]
        sign[brick >= 0] = pattern.reshape(self._grid.split**3, len(mixed))[wall.place[brick >= 0], brick[brick >= 0]]
        return {WALL: (sign == 255)[wall.cell], OTHER_WALL: (sign == 0)[wall.cell]}
