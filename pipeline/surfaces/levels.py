"""Levels of the liquids at any point and at the fine nodes of a grid, and the surfaces on which they are zero.

The level of a liquid is its dominance: how far its fraction plus its offset exceeds those of all others. Droplets have
levels of their own, and where one of these is higher it counts.
"""
import functools
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.ndimage import map_coordinates

from pipeline.surfaces.bricks import Bricks, spline_range, spline_weights
from pipeline.surfaces.cavity_grid import CavityGrid
from pipeline.surfaces.contour import TriangleMesh, away_from_zero, contour, signed_volumes
from pipeline.surfaces.contour_lines import ContourLines, contour_lines, enclosed_areas
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
from pipeline.surfaces.droplets import DropletBox

OFFSET_REACH = 0.05     # change of an offset for which the bricks are chosen at first
SLOPE_REACH = 0.1       # of the level on both sides of a surface, where its slope is measured
BRICK_MARGIN = 1e-3     # of the level, for the rounding of splines


def excess(raised: np.ndarray, phase: int) -> np.ndarray:
    """How far one phase exceeds the largest of the others (U5), in the shape of one."""
    others = [raised[k] for k in range(len(raised)) if k != phase]
    if not others:
        return np.ones_like(raised[0])
    return raised[phase] - functools.reduce(np.maximum, others)


class Levels:
    """Levels at points; what is common to both ways to find surfaces.

    Parameters
    ----------
    grid : of the cavity.
    coefficients : (phases, nx, ny[, nz]) float32 of the splines of the fractions, without droplets.
    droplets : their levels in boxes of fine nodes.
    """

    def __init__(self, grid: CavityGrid, coefficients: np.ndarray, droplets: Sequence[DropletBox]):
        self.grid, self.coefficients, self.droplets = grid, coefficients, droplets

    def at(self, points: np.ndarray, offset: np.ndarray) -> np.ndarray:
        """Levels (n, phases) at points (n, D) in m."""
        index = ((points - self.grid.origin) / self.grid.coarse_cell).T
        raised = np.stack([map_coordinates(one, index, order=3, prefilter=False, mode="nearest")
                           for one in self.coefficients]) + offset[:, None]
        fine = (points - self.grid.origin) / self.grid.cell
        lower, upper = fine.min(axis=0), fine.max(axis=0)
        for box in self.droplets:
            shape = np.array(box.level.shape)
            if (box.lowest > upper).any() or (box.lowest + shape - 1 < lower).any():
                continue
            own = ((fine >= box.lowest) & (fine <= box.lowest + shape - 1)).all(axis=1)
            level = map_coordinates(box.level, (fine[own] - box.lowest).T, order=1)
            _raise(raised, box.phase, np.flatnonzero(own), level)
        return np.stack([excess(raised, phase) for phase in range(len(raised))], axis=1)

    @functools.cached_property
    def of_droplets(self) -> list[tuple[int, np.ndarray, np.ndarray]]:
        """Phase, fine indices (k, D) and levels (k,) of the nodes of droplets; where two share one, of the higher."""
        found = []
        for phase in sorted({box.phase for box in self.droplets}):
            own = [box for box in self.droplets if box.phase == phase]
            flat = np.concatenate([box.flat(self.grid.fine_shape) for box in own])
            nodes, place = np.unique(flat, return_inverse=True)
            level = np.full(len(nodes), -np.inf, np.float32)
            np.maximum.at(level, place, np.concatenate([box.level[box.members] for box in own]))
            found.append((phase, np.stack(np.unravel_index(nodes, self.grid.fine_shape), axis=1), level))
        return found


def _raise(raised: np.ndarray, phase: int, nodes: np.ndarray, level: np.ndarray) -> None:
    """Let one phase exceed the others by ``level`` (k,) at least, at nodes (k,) of fractions (phases, n), in place."""
    others = np.delete(raised[:, nodes], phase, axis=0).max(axis=0)
    raised[phase, nodes] = np.maximum(raised[phase, nodes], others + level)


class DenseLevels(Levels):
    """Levels at all fine nodes, contoured together with the depth: in a plane, and for the contours of libraries."""

    def __init__(self, grid: CavityGrid, coefficients: np.ndarray, droplets: Sequence[DropletBox], method: str):
        super().__init__(grid, coefficients, droplets)
        self.method = method
        self._values = np.stack([_upsampled(one, grid.split) for one in coefficients])

    def volume(self, offset: np.ndarray, phase: int) -> tuple[float, float]:
        """Volume (m**3; m**2 in 2D) inside the surface of a phase, and by how much it grows with its offset."""
        inside = self._inside(offset, phase)
        nearby = ((np.abs(inside) < SLOPE_REACH) & (self.grid.depth > SLOPE_REACH)).sum()
        growth = nearby * self.grid.cell**self.grid.dimension / (2.0 * SLOPE_REACH)
        if self.grid.dimension == 2:
            return float(enclosed_areas(inside[None], self.grid.cell)[0]), growth
        return contour(inside, self.grid.origin, self.grid.cell, self.method).volume, growth

    def surfaces(self, offset: np.ndarray, count: int) -> list[TriangleMesh] | list[ContourLines]:
        """Closed surfaces, in 2D closed lines, of the first ``count`` phases."""
        grid, inside = self.grid, [self._inside(offset, phase) for phase in range(count)]
        if grid.dimension == 2:
            return [contour_lines(one, grid.origin, grid.cell) for one in inside]
        return [contour(one, grid.origin, grid.cell, self.method) for one in inside]

    def _inside(self, offset: np.ndarray, phase: int) -> np.ndarray:
        raised = (self._values + offset.reshape(-1, *[1] * self.grid.dimension)).reshape(len(offset), -1)
        for liquid, fine, level in self.of_droplets:
            _raise(raised, liquid, np.ravel_multi_index(tuple(fine.T), self.grid.fine_shape), level)
        return np.minimum(excess(raised, phase).reshape(self.grid.fine_shape), self.grid.depth)


def _upsampled(coefficients: np.ndarray, split: int) -> np.ndarray:
    """Values of a spline at all fine nodes."""
    values = np.pad(coefficients, 1, mode="edge")
    for axis in range(coefficients.ndim):
        values = np.moveaxis(values, axis, 0)
        count = len(values) - 3
        fine = np.empty((count * split + 1, *values.shape[1:]), values.dtype)
        for place, weights in enumerate(spline_weights(split).astype(values.dtype)):
            fine[place:-1:split] = sum(weight * values[k:k + count] for k, weight in enumerate(weights))
        fine[-1] = np.tensordot(spline_weights(1)[0, :3].astype(values.dtype), values[-3:], 1)
        values = np.moveaxis(fine, 0, axis)
    return values


class SharpLevels(Levels):
    """Levels in bricks near the interface, cut cell by cell along the wall (``cut_cells``)."""

    def __init__(self, grid: CavityGrid, coefficients: np.ndarray, droplets: Sequence[DropletBox]):
        super().__init__(grid, coefficients, droplets)
        # Between no two phases is there an interface where their difference has one sign.
        self._pairs = [(a, b, *spline_range(coefficients[a] - coefficients[b]))
                       for a in range(len(coefficients)) for b in range(a)]
        self._last = None
        self._choose_bricks(OFFSET_REACH)

    def volume(self, offset: np.ndarray, phase: int) -> tuple[float, float]:
        """Volume, m**3, inside the surface of a phase, and by how much it grows with its offset."""
        cut = self._cut(offset, phase)
        return cut.volume, cut.growth

    def surfaces(self, offset: np.ndarray, count: int) -> list[TriangleMesh]:
        """Closed surfaces of the first ``count`` phases; two that are alone share all of their interface."""
        if len(self.coefficients) != 2:
            return [self._cut(offset, phase).mesh() for phase in range(count)]
        # The same cut for both, even when the second has been held to its volume.
        cut = self._cut(offset, 0)
        return [cut.mesh(), cut.mesh(other=True)][:count]

    def _choose_bricks(self, reach: float) -> None:
        """Sample the fractions in all bricks in which levels can be zero while offsets differ by at most ``reach``."""
        chosen = np.zeros(self.grid.shape, bool)
        for _, _, low, high in self._pairs:
            chosen |= (low < reach + BRICK_MARGIN) & (high > -reach - BRICK_MARGIN)
        for _, fine, _ in self.of_droplets:
            for step in CORNERS:        # all bricks with a cell at the node
                chosen[tuple(((fine - step) // self.grid.split).T)] = True
        chosen &= self.grid.wall.inside | (self.grid.wall.bricks.number >= 0)
        chosen[-1], chosen[:, -1], chosen[:, :, -1] = False, False, False
        self._reach, self._bricks = reach, Bricks(chosen, self.grid.split)
        self._values = np.stack([self._bricks.sample(one) for one in self.coefficients[:-1]] or [[]])
        self._values = np.concatenate([self._values, 1.0 - self._values.sum(axis=0, keepdims=True)])
        self._raises = []
        for phase, fine, level in self.of_droplets:
            nodes = self._bricks.find(fine)
            self._raises.append((phase, nodes[nodes >= 0], level[nodes >= 0]))
        self._crossed = self._near_zero(reach)
        self._nodes = self._bricks.nodes(self._crossed)

    def _near_zero(self, reach: float) -> np.ndarray:
        """Numbers (n,) of the chosen bricks at whose nodes levels can have both signs."""
        nodes = self._bricks.nodes(np.arange(self._bricks.count))
        near = np.zeros(self._bricks.count, bool)
        for a, b, *_ in self._pairs:
            difference = (self._values[a] - self._values[b])[nodes]
            near |= (difference.min(axis=(0, 1, 2)) < reach + BRICK_MARGIN) & \
                (difference.max(axis=(0, 1, 2)) > -reach - BRICK_MARGIN)
        for _, own, _ in self._raises:
            raised = np.zeros(self._values.shape[1], bool)
            raised[own] = True
            near |= raised[nodes].any(axis=(0, 1, 2))
        return np.flatnonzero(near)

    def _cut(self, offset: np.ndarray, phase: int) -> "Cut":
        if self._last and self._last[:2] == (phase, tuple(offset)):
            return self._last[2]
        needed = float(np.ptp(offset))
        if needed > self._reach:
            self._choose_bricks(2.0 * needed)
        raised = self._values + offset.astype(np.float32)[:, None]
        for liquid, nodes, level in self._raises:
            _raise(raised, liquid, nodes, level)
        coarse = excess(self.coefficients + offset.astype(np.float32).reshape(-1, 1, 1, 1), phase) > 0.0
        level = away_from_zero(excess(raised, phase))
        self._last = phase, tuple(offset), Cut(self.grid, self._bricks, self._crossed, self._nodes, level, coarse)
        return self._last[2]


class Cut:
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

    @property
    def volume(self) -> float:
        """Volume, m**3, where the level is positive."""
        wall = self._grid.wall
        new = np.concatenate([self._interface, self._cut_wall[WALL]])
        return float(signed_volumes(self._vertices, new, wall.center).sum() + wall.volumes @ self._whole_wall[WALL])

    def mesh(self, *, other: bool = False) -> TriangleMesh:
        """Closed surface of where the level is positive, or of the other side, around the same interface."""
        wall = self._grid.wall
        side = OTHER_WALL if other else WALL
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

    def _general(self, cells: tuple[np.ndarray, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Patch (t,) and points (t, 3) of the triangles in all other cells, and what points are new (p, 3), m.

        Points on edges are numbered by edge, those of the wall and the new ones after them.
        """
        grid, wall = self._grid, self._grid.wall
        cells = np.stack(cells, axis=1)
        brick, place = cells[:, 3], tuple(np.moveaxis(cells[:, None, :3] + CORNERS, -1, 0))
        row = self._row[brick]
        level = self._block[(*place, brick[:, None])]
        depth = np.where(row[:, None] >= 0, wall.depth[(*place, row[:, None])], np.float32(1.0))
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
        _, first, place = np.unique(key, return_index=True, return_inverse=True)
        after = edges + len(wall.vertices)
        result[new] = after + place
        result[kind == 4] = after + len(first) + code[kind == 4] - CODES
        points = np.concatenate([fine[of[new][first]] + spot[of[new][first], code[new][first]], fine[of_center] + center])
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
