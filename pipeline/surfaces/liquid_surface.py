"""Surfaces of the liquids in one frame, from its particles.

Liquid l is where ``min(dominance_l, depth) > 0``: dominance is how far its fraction exceeds that of every other liquid,
depth the distance to the wall. So two liquids share one interface, and the liquids touch the wall without a gap.
Where there is a free surface, the void beyond it counts as one liquid more, with what the kernel finds empty as its
fraction. Offsets added to the fractions conserve the volume of every liquid; droplets have offsets of their own.
Equations: docs/methods/surfaces.md.
"""
import dataclasses
import functools
import time
from typing import Any

import numpy as np
from scipy.ndimage import correlate1d, map_coordinates
from scipy.optimize import brentq
from scipy.spatial import cKDTree

from pipeline.base.errors import UserError
from pipeline.base.frame_files import FrameData
from pipeline.surfaces.cavity_grid import CavityGrid
from pipeline.surfaces.contour import TriangleMesh
from pipeline.surfaces.contour_lines import ContourLines
from pipeline.surfaces.droplets import droplet_offsets, find_droplets
from pipeline.surfaces.fraction_field import FractionField, sided_fraction, smooth_fraction, taubin_filter

OFFSET_ROUNDS = 3               # with three liquids and more every offset touches the others
OFFSET_LIMIT = 0.8              # of a difference of fractions that lies in -1..1
OFFSET_LIMIT_OPEN = 0.4         # two of them must not turn void into liquid
VOLUME_TOLERANCE = 2e-4         # relative, where the search for the offset stops
LEAST_ROOM = 0.05               # share of the kernel inside the cavity, below which nothing is divided by it
SECTION_LEVEL, SECTION_DEPTH = 0.25, 1e-3       # where dominance and distance (m) in the section are cut off
SECTION_PIXELS = 480            # nodes of the section along its longer side, at least


@dataclasses.dataclass
class LiquidSurface:
    """Surface of one liquid, in two dimensions its outline, and what was measured on it."""

    mesh: TriangleMesh | ContourLines
    statistics: dict[str, Any]


@dataclasses.dataclass
class Section:
    """Fields on the plane x = 0, nodes (ny, nz): fraction (ny, nz, liquids), dominance alike, distance in m."""

    fraction: np.ndarray
    dominance: np.ndarray
    signed_distance: np.ndarray
    origin: np.ndarray
    cell: float


class Reconstructor:
    """Turns frames of one scene into surfaces; made once, because its tables and the compiled kernel are kept.

    Parameters
    ----------
    initial : arrays of ``initial.npz`` (signed distance to the wall, particle spacing; with a free surface the wall
        particles).
    liquids : number of liquids.
    cell_ratio : cell of the grid in particle spacings.
    method : "flying_edges" or "marching_cubes".
    smoothing_iterations : passes of Taubin's filter on the fractions; 0 switches it off.
    free_surface : whether the liquids leave a part of the cavity void.
    """

    def __init__(self, initial: dict, liquids: int, *, cell_ratio: float = 0.5, method: str = "flying_edges",
                 smoothing_iterations: int = 20, free_surface: bool = False):
        self.filter = taubin_filter(smoothing_iterations)
        # Outside the wall too few neighbors are left to tell void from liquid.
        beyond = 1e-6 if free_surface else 2.0 * max(cell_ratio, 0.5)
        self.grid = CavityGrid(initial, cell_ratio, method, beyond)
        self.cavity_volume = self.grid.cavity_volume
        self.field = FractionField(self.grid.spacing, self.grid.origin, self.grid.origin + self.grid.extent, liquids)
        self.free_surface = free_surface
        self.room = self._room(initial) if free_surface else None
        self._section = self._section_nodes() if self.grid.dimension == 3 and not free_surface else None

    def _room(self, initial: dict) -> np.ndarray:
        """Share (n,) of the kernel at every near node that lies inside the cavity."""
        count = len(initial["wall_position"])
        nothing = np.zeros((count, self.field.liquids))
        self.field.load(initial["wall_position"], initial["wall_volume"], nothing, np.zeros(count, int))
        weight, _ = self.field.sample(self.grid.near_nodes)
        return np.maximum(1.0 - weight.sum(axis=1), LEAST_ROOM)

    def surfaces(self, frame: FrameData) -> list[LiquidSurface]:
        """Closed surface and statistics of every liquid of ``frame``; also prepares :meth:`section`.

        Raises
        ------
        UserError : the volume of a liquid cannot be met.
        """
        start = time.perf_counter()
        self.field.load(frame.position, frame.volume, frame.volume_fraction, frame.phase)
        fraction = self._fractions()
        volume = np.asarray(frame.volume, np.float64)
        expected = np.array([volume[frame.phase == liquid].sum() for liquid in range(self.field.liquids)])
        droplets = [find_droplets(frame, liquid, self.grid.spacing) for liquid in range(self.field.liquids)]
        patches = droplet_offsets(frame, fraction, droplets, self.grid)
        bulk = np.array([int((frame.phase == liquid).sum()) - sum(map(len, pieces))
                         for liquid, pieces in enumerate(droplets)])
        target = np.where(bulk > 0, expected, 0.0) * (1.0 if self.free_surface else self.cavity_volume / expected.sum())
        if self.free_surface:
            target = np.append(target, self.cavity_volume - expected.sum())
        offset = self._bulk_offsets(fraction, target, patches)
        self._dominance = dominance(fraction, offset, patches)
        result = []
        for liquid in range(self.field.liquids):
            mesh = self.grid.contour(self._dominance[liquid])
            others = np.delete(offset, liquid)
            result.append(LiquidSurface(mesh, mesh.counts | {
                "watertight": mesh.is_closed(), "volume": mesh.volume,
                "expected_volume": float(expected[liquid]),
                "volume_error": float(mesh.volume / expected[liquid] - 1.0) if expected[liquid] else 0.0,
                "liquid_volume": float(frame.fill[liquid]),
                "components": int((mesh.component_volumes() > 0).sum()),
                "iso": float(0.5 - 0.5 * (offset[liquid] - others.max(initial=0.0) if len(others) else 0.0)),
                "bulk_particles": int(bulk[liquid]), "droplets": len(droplets[liquid]),
                "droplet_particles": sum(map(len, droplets[liquid])),
            }))
        seconds = time.perf_counter() - start
        for surface in result:
            surface.statistics["seconds"] = seconds / len(result)
        return result

    def section(self) -> Section | None:
        """Section x = 0 of the frame given to :meth:`surfaces` last, sharp at the interface; ``None`` in a container.

        Dominance and distance are cut off, and the fraction is 0 well outside the cavity: constants make small files.
        """
        if self._section is None:
            return None
        points, shape, cell = self._section
        wall = self.grid.distance_at(points)
        index = ((points - self.grid.origin) / self.grid.cell).T
        level = np.stack([map_coordinates(values, index, order=1, mode="nearest") for values in self._dominance], -1)
        fraction = np.zeros_like(level)
        band = wall < 2.0 * cell
        weight, share = self.field.sample(points[band])
        fraction[band] = sided_fraction(weight, share, level[band].argmax(axis=1))
        void = ~np.isfinite(fraction).all(axis=1)
        if void.any():
            _, nearest = cKDTree(points[band & ~void]).query(points[void])
            fraction[void] = fraction[band & ~void][nearest]
        return Section(
            fraction.reshape(*shape, -1).astype(np.float32),
            np.clip(level, -SECTION_LEVEL, SECTION_LEVEL).reshape(*shape, -1).astype(np.float32),
            np.clip(wall, -SECTION_DEPTH, SECTION_DEPTH).reshape(shape).astype(np.float32), self.grid.origin[1:], cell)

    def depth_at(self, points: np.ndarray) -> np.ndarray:
        """Distance of points (m, D) to the wall, m, positive inside the cavity."""
        return -self.grid.distance_at(points)

    def _section_nodes(self) -> tuple[np.ndarray, tuple[int, ...], float]:
        grid = self.grid
        cell = grid.cell / max(1, int(np.ceil(SECTION_PIXELS * grid.cell / grid.extent[1:].max())))
        shape = tuple(int(n) for n in np.floor(grid.extent[1:] / cell + 1e-9) + 1)
        y, z = np.meshgrid(*(np.arange(n) * cell for n in shape), indexing="ij")
        points = np.stack([np.full_like(y, -grid.origin[0]), y, z], axis=-1).reshape(-1, 3) + grid.origin
        return points, shape, cell

    def _fractions(self) -> np.ndarray:
        """Filtered fractions (phases, nx, ny[, nz]), extended outward and into voids by the nearest known value.

        With a free surface the last phase is the void.
        """
        nodes = self.grid.near_nodes
        weight, share = self.field.sample(nodes)
        near = smooth_fraction(weight, share)
        known = np.isfinite(near[:, 0])
        if not known.any():
            raise UserError("a frame without particles has no surface")
        if self.free_surface:
            filled = np.clip(weight.sum(axis=1) / self.room, 0.0, 1.0)[:, None]  # (U3)
            near = np.concatenate([np.where(known[:, None], filled * near, 0.0), 1.0 - filled], axis=1)
        elif not known.all():
            _, nearest = cKDTree(nodes[known]).query(nodes[~known])
            near[~known] = near[known][nearest]
        values = near.T[:, self.grid.extension]
        # The last fraction is what the others leave.
        for phase in range(len(values) - 1):
            for axis in range(self.grid.dimension):
                values[phase] = correlate1d(values[phase], self.filter, axis=axis, mode="nearest")
        values[-1] = 1.0 - values[:-1].sum(axis=0)
        return values

    def _bulk_offsets(self, fraction: np.ndarray, target: np.ndarray, droplets: tuple) -> np.ndarray:
        """One offset per phase (the first stays 0) such that every surface holds its target volume.

        ``target`` is 0 for a liquid without bulk: droplets alone leave no interface to move.
        """
        offset, count = np.zeros(len(fraction)), len(fraction)
        if count == 2 and target.all():
            # Both liquids lose a little where the interface meets the wall; the lesser is held to its volume.
            judged = [0 if self.free_surface else int(target.argmin())]
            self._set_offset(offset, 1, judged, fraction, droplets, target)
        elif count > 2:
            for phase in [k for k in range(1, count) if target[k]] * OFFSET_ROUNDS:
                # What the void takes is what all liquids lack: the void itself may lose a little.
                void = self.free_surface and phase == count - 1
                judged = [k for k in range(phase) if target[k]] if void else [phase]
                if judged:
                    self._set_offset(offset, phase, judged, fraction, droplets, target)
        return offset

    def _set_offset(self, offset: np.ndarray, phase: int, judged: list[int], fraction, droplets,
                    target: np.ndarray) -> None:
        """Change the offset of ``phase`` in place until the surfaces of ``judged`` together hold their targets."""
        sign, wanted = 1.0 if phase in judged else -1.0, target[judged].sum()

        def error(value: float) -> float:
            offset[phase] = value
            raised = with_offsets(fraction, offset, droplets)
            relative = sum(self.grid.enclosed(excess(raised, one)) for one in judged) / wanted - 1.0
            return 0.0 if abs(relative) < VOLUME_TOLERANCE else sign * relative

        limit = OFFSET_LIMIT if not self.free_surface else OFFSET_LIMIT_OPEN
        reach = limit / 8
        low, high = error(-reach), error(reach)
        while reach < limit and not low <= 0.0 <= high:
            reach *= 2
            low, high = error(-reach), error(reach)
        if low <= 0.0 <= high:
            offset[phase] = brentq(error, -reach, reach, xtol=1e-5)
        else:
            offset[phase] = -reach if abs(low) < abs(high) else reach


def dominance(fraction: np.ndarray, offset: np.ndarray, droplets: tuple) -> np.ndarray:
    """How far every fraction plus its offset exceeds the largest of the others: (phases, nx, ny[, nz]) in -1..1.

    With two phases the second is the exact negative of the first: one shared interface. One liquid alone: 1.
    """
    raised = with_offsets(fraction, offset, droplets)
    return np.stack([excess(raised, phase) for phase in range(len(raised))])


def with_offsets(fraction: np.ndarray, offset: np.ndarray, droplets: tuple) -> np.ndarray:
    """Fractions (phases, nx, ny[, nz]) plus one offset each; the nodes of droplets have their own in place of it."""
    phases = len(fraction)
    raised = fraction + offset.reshape(phases, *[1] * (fraction.ndim - 1))
    nodes, own_offset = droplets
    raised.reshape(phases, -1)[:, nodes] = fraction.reshape(phases, -1)[:, nodes] + own_offset
    return raised


def excess(raised: np.ndarray, phase: int) -> np.ndarray:
    """How far one phase exceeds the largest of the others (U4), (nx, ny[, nz])."""
    others = [raised[k] for k in range(len(raised)) if k != phase]
    if not others:
        return np.ones_like(raised[0])
    return raised[phase] - functools.reduce(np.maximum, others)
