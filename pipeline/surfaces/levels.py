"""Levels of the liquids in sections and at the fine nodes of a grid, and the surfaces on which they are zero.

The level of a liquid is its dominance: how far its fraction plus its offset exceeds those of all others. Droplets have
levels of their own, and where one of these is higher it counts.
Equations: docs/methods/surfaces.md.
"""
import abc
import functools
from collections.abc import Sequence

import numpy as np
from scipy.ndimage import map_coordinates

from pipeline.surfaces.bricks import Bricks, spline_range, spline_weights
from pipeline.surfaces.cavity_cut import CavityCut
from pipeline.surfaces.cavity_grid import CavityGrid
from pipeline.surfaces.contour import TriangleMesh, away_from_zero, contour
from pipeline.surfaces.contour_lines import ContourLines, contour_lines, enclosed_areas
from pipeline.surfaces.cut_cells import CORNERS
from pipeline.surfaces.droplets import DropletBox
from pipeline.surfaces.section_plane import SectionPlane

OFFSET_REACH = 0.05     # change of an offset for which the bricks are chosen at first
SLOPE_REACH = 0.1       # of the level on both sides of a surface, where its slope is measured
BRICK_MARGIN = 1e-3     # of the level, for the rounding of splines


def excess(raised: np.ndarray, phase: int) -> np.ndarray:
    """How far one phase exceeds the largest of the others (U5), in the shape of one."""
    others = [raised[k] for k in range(len(raised)) if k != phase]
    if not others:
        return np.ones_like(raised[0])
    return raised[phase] - functools.reduce(np.maximum, others)


class Levels(abc.ABC):
    """Levels in sections; what is common to both ways to find surfaces.

    Parameters
    ----------
    grid : of the cavity.
    coefficients : (phases, nx, ny[, nz]) float32 of the splines of the fractions, without droplets.
    droplets : their levels in boxes of fine nodes.
    """

    def __init__(self, grid: CavityGrid, coefficients: np.ndarray, droplets: Sequence[DropletBox]):
        self.grid, self.coefficients, self.droplets = grid, coefficients, droplets

    @abc.abstractmethod
    def volume(self, offset: np.ndarray, phase: int) -> tuple[float, float]:
        """Volume (m**3; m**2 in 2D) inside the surface of a phase, and by how much it grows with its offset."""

    @abc.abstractmethod
    def surfaces(self, offset: np.ndarray, count: int) -> Sequence[TriangleMesh | ContourLines]:
        """Closed surfaces, in 2D closed lines, of the first ``count`` phases."""

    def on(self, plane: SectionPlane, offset: np.ndarray) -> np.ndarray:
        """Levels (n, phases) at the nodes of a section."""
        raised = with_last([plane.spline(one) for one in self.coefficients[:-1]], plane.band.shape)
        raised += offset.astype(np.float32)[:, None]
        fine, lower, upper = plane.fine, plane.fine.min(axis=0), plane.fine.max(axis=0)
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


def with_last(fractions: Sequence[np.ndarray], shape: tuple[int, ...]) -> np.ndarray:
    """Fractions of all phases but the last, of a shape each, and that of the last, which is what they leave."""
    return np.stack([*fractions, 1.0 - sum(fractions, np.zeros(shape, np.float32))])


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

    def surfaces(self, offset: np.ndarray, count: int) -> Sequence[TriangleMesh | ContourLines]:
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
        self._last_wanted: tuple[float, ...] = ()
        self._choose_bricks(OFFSET_REACH)

    def volume(self, offset: np.ndarray, phase: int) -> tuple[float, float]:
        """Volume, m**3, inside the surface of a phase, and by how much it grows with its offset."""
        cut, other = self._cut(offset, phase)
        return cut.volume(other=other), cut.growth

    def surfaces(self, offset: np.ndarray, count: int) -> Sequence[TriangleMesh]:
        """Closed surfaces of the first ``count`` phases; two that are alone share all of their interface."""
        cuts = (self._cut(offset, phase) for phase in range(count))
        return [cut.mesh(other=other) for cut, other in cuts]

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
        sampled = [self._bricks.sample(one) for one in self.coefficients[:-1]]
        self._values = with_last(sampled, (len(self._bricks.corner) * self.grid.split**3,))
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

    def _cut(self, offset: np.ndarray, phase: int) -> tuple[CavityCut, bool]:
        """The cavity cut around a phase, and whether this is on the other side: of two, both are of one cut."""
        other = len(offset) == 2 and phase == 1
        wanted = (0 if other else phase, *offset)
        if self._last_wanted != wanted:
            self._last, self._last_wanted = self._new_cut(offset, 0 if other else phase), wanted
        return self._last, other

    def _new_cut(self, offset: np.ndarray, phase: int) -> CavityCut:
        needed = float(np.ptp(offset))
        if needed > self._reach:
            self._choose_bricks(2.0 * needed)
        raised = self._values + offset.astype(np.float32)[:, None]
        for liquid, nodes, level in self._raises:
            _raise(raised, liquid, nodes, level)
        coarse = excess(self.coefficients + offset.astype(np.float32).reshape(-1, 1, 1, 1), phase) > 0.0
        level = away_from_zero(excess(raised, phase))
        return CavityCut(self.grid, self._bricks, self._crossed, self._nodes, level, coarse)
