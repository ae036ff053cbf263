"""Surfaces of the liquids in one frame, from its particles.

Liquid l is where its level and the depth below the wall are positive: the level is how far its fraction exceeds that of
every other liquid. So two liquids share one interface, and the liquids touch the wall without a gap.
Where there is a free surface, the void beyond it counts as one liquid more, with what the kernel finds empty as its
fraction. Offsets added to the fractions conserve the volume of every liquid; droplets have levels of their own.
Equations: docs/methods/surfaces.md.
"""
import dataclasses
import functools
from typing import Any

import numpy as np
from scipy.ndimage import correlate1d
from scipy.spatial import cKDTree

from pipeline.base.errors import UserError
from pipeline.base.frame_files import FrameData
from pipeline.surfaces.anisotropic_field import AnisotropicField
from pipeline.surfaces.bricks import sliding
from pipeline.surfaces.cavity_grid import CavityGrid
from pipeline.surfaces.contour import TriangleMesh
from pipeline.surfaces.contour_lines import ContourLines
from pipeline.surfaces.droplets import droplet_boxes, find_droplets
from pipeline.surfaces.fraction_field import FractionField, sided_fraction, smooth_fraction, smoothing_filter
from pipeline.surfaces.levels import DenseLevels, SharpLevels
from pipeline.surfaces.section_plane import SectionPlane

SMOOTHING = {False: 1.0, True: 0.5}     # spacings: edges of splashes and blocks stay, interfaces are smooth
OFFSET_ROUNDS = 3               # with three liquids and more every offset touches the others
OFFSET_LIMIT = 0.8              # of a difference of fractions that lies in -1..1
OFFSET_LIMIT_OPEN = 0.4         # two of them must not turn void into liquid
OFFSET_TOLERANCE = 1e-5
VOLUME_TOLERANCE = 2e-4         # relative, where the search for the offset stops
FULL = 0.6                      # share of space filled by particles, from which on there is no void
MIXED, NOTHING = -1, -2         # what is around a node, in place of the number of one liquid
LEAST_ROOM = 0.05               # share of the kernel inside the cavity, below which nothing is divided by it
SECTION_LEVEL, SECTION_DEPTH = 0.25, 1e-3       # where dominance and distance (m) in the section are cut off
SECTION_NODES = {"section": 480, "coronal": 240}    # along the longer side, at least: the coronal one is drawn smaller
SECTION_NORMAL = {"section": 0, "coronal": 2}      # axis that the plane stands on, through the origin


@dataclasses.dataclass
class LiquidSurface:
    """Surface of one liquid, in two dimensions its outline, and what was measured on it."""

    mesh: TriangleMesh | ContourLines
    statistics: dict[str, Any]


@dataclasses.dataclass
class Section:
    """Fields on a plane through the origin, nodes (n, m): fraction (n, m, liquids), dominance alike, distance in m.

    Rows go along the first axis of the plane, columns along the other; ``normal`` is the axis it stands on, ``origin``
    (2,) its first node in m.
    """

    fraction: np.ndarray
    dominance: np.ndarray
    signed_distance: np.ndarray
    origin: np.ndarray
    cell: float
    normal: int = 0


class Reconstructor:
    """Turns frames of one scene into surfaces; made once, because its tables and the compiled kernel are kept.

    Parameters
    ----------
    initial : arrays of ``initial.npz`` (signed distance to the wall, particle spacing; with a free surface the wall
        particles).
    liquids : number of liquids.
    cell_ratio : cell of the grid in particle spacings.
    method : "sharp" (cut along the wall), "flying_edges" or "marching_cubes"; in two dimensions without meaning.
    smoothing_length : of the fractions, in particle spacings; 0 switches it off, None takes a default.
    kernel : "isotropic", or "anisotropic": stretched along the surface.
    free_surface : whether the liquids leave a part of the cavity void.
    """

    def __init__(self, initial: dict, liquids: int, *, cell_ratio: float = 0.5, method: str = "sharp",
                 smoothing_length: float | None = None, kernel: str = "isotropic", free_surface: bool = False):
        # Outside the wall too few neighbors are left to tell void from liquid.
        beyond = 1e-6 if free_surface else 2.0 * max(cell_ratio, 0.5)
        self.grid, self.method = CavityGrid(initial, cell_ratio, beyond), method
        length = SMOOTHING[free_surface] if smoothing_length is None else smoothing_length
        self.filter = smoothing_filter(length, self.grid.coarse_cell / self.grid.spacing).astype(np.float32)
        self.cavity_volume = self.grid.cavity_volume
        self.field = FractionField(self.grid.spacing, self.grid.origin, self.grid.origin + self.grid.extent, liquids)
        self._sums = self.field if kernel == "isotropic" else AnisotropicField(
            self.grid.spacing, self.grid.origin, self.grid.origin + self.grid.extent, liquids,
            initial.get("wall_position"))
        self.free_surface = free_surface
        self.room = self._room(initial) if free_surface else None
        self._planes = {name: SectionPlane(self.grid, normal, SECTION_NODES[name])
                        for name, normal in SECTION_NORMAL.items()} \
            if self.grid.dimension == 3 and not free_surface else {}

    def _room(self, initial: dict) -> np.ndarray:
        """Share (n,) of the kernel at every near node that lies inside the cavity."""
        count = len(initial["wall_position"])
        nothing = np.zeros((count, self.field.liquids))
        self.field.load(initial["wall_position"], initial["wall_volume"], nothing, np.zeros(count, int))
        weight, _ = self.field.sample(self.grid.near_nodes)
        return np.maximum(1.0 - weight.sum(axis=1), LEAST_ROOM)

    def surfaces(self, frame: FrameData) -> list[LiquidSurface]:
        """Closed surface and statistics of every liquid of ``frame``; also prepares :meth:`sections`.

        Raises
        ------
        UserError : the volume of a liquid cannot be met.
        """
        self._frame = frame
        volume, count = np.asarray(frame.volume, np.float64), self.field.liquids
        expected = np.array([volume[frame.phase == liquid].sum() for liquid in range(count)])
        droplets = [find_droplets(frame, liquid, self.grid.spacing) for liquid in range(count)]
        sizes = np.bincount(frame.phase, minlength=count)
        if not self.free_surface and all(sum(map(len, few)) == size for few, size in zip(droplets, sizes, strict=True)):
            # Something must fill a full cavity.
            most = max((few for few in droplets if few), key=lambda few: max(map(len, few)), default=None)
            if most is None:
                raise UserError("a frame without particles has no surface")
            most.pop(max(range(len(most)), key=lambda piece: len(most[piece])))
        bulk = np.array([int(size) - sum(map(len, few)) for size, few in zip(sizes, droplets, strict=True)])
        coefficients = self._coefficients(frame, droplets)
        boxes = droplet_boxes(frame, droplets, self.grid)
        dense = self.grid.dimension == 2 or self.method != "sharp"
        self._levels = DenseLevels(self.grid, coefficients, boxes, self.method) if dense else \
            SharpLevels(self.grid, coefficients, boxes)
        target = np.where(bulk > 0, expected, 0.0) * (1.0 if self.free_surface else self.cavity_volume / expected.sum())
        if self.free_surface:
            target = np.append(target, self.cavity_volume - expected.sum())
        offset = self._offset = self._bulk_offsets(target)
        result, fill = [], volume @ np.asarray(frame.volume_fraction)
        for liquid, mesh in enumerate(self._levels.surfaces(offset, count)):
            others = np.delete(offset, liquid)
            result.append(LiquidSurface(mesh, mesh.counts | {
                "watertight": mesh.is_closed(), "volume": mesh.volume,
                "expected_volume": float(expected[liquid]),
                "volume_error": float(mesh.volume / expected[liquid] - 1.0) if expected[liquid] else 0.0,
                "liquid_volume": float(fill[liquid]),
                "components": int((mesh.component_volumes() > 0).sum()),
                "iso": float(0.5 - 0.5 * (offset[liquid] - others.max(initial=0.0) if len(others) else 0.0)),
                "bulk_particles": int(bulk[liquid]), "droplets": len(droplets[liquid]),
                "droplet_particles": sum(map(len, droplets[liquid])),
            }))
        return result

    def sections(self) -> dict[str, Section]:
        """Sections of the frame given to :meth:`surfaces` last, sharp at the interface; none in a container.

        ``section`` is the plane x = 0 through the optic axis, ``coronal`` the plane z = 0 through the globe's center.
        Dominance and distance are cut off, and the fraction is 0 well outside the cavity: constants make small files.
        """
        if not self._planes:
            return {}
        frame = self._frame
        self.field.load(frame.position, frame.volume, frame.volume_fraction, frame.phase)
        alone = self._alone(frame.position.astype(np.float64), frame.volume, frame.volume_fraction)
        # Around a whole coarse cell there is one liquid if it is alone around each of its corners.
        least, most = sliding(np.minimum, alone, 0, 1), sliding(np.maximum, alone, 0, 1)
        alone = np.where(least == most, least, MIXED)
        return {name: self._section(plane, alone) for name, plane in self._planes.items()}

    def _section(self, plane: SectionPlane, alone: np.ndarray) -> Section:
        level = self._levels.on(plane, self._offset)
        liquid, fraction = alone[tuple(plane.corner)], np.zeros_like(level)
        pure, mixed = plane.band & (liquid >= 0), plane.band & (liquid < 0)
        fraction[pure, liquid[pure]] = 1.0
        weight, share = self.field.sample(plane.points[mixed])
        fraction[mixed] = sided_fraction(weight, share, level[mixed].argmax(axis=1))
        void = ~np.isfinite(fraction).all(axis=1)
        if void.any():
            _, nearest = cKDTree(plane.points[plane.band & ~void]).query(plane.points[void])
            fraction[void] = fraction[plane.band & ~void][nearest]
        return Section(
            fraction.reshape(*plane.shape, -1).astype(np.float32),
            np.clip(level, -SECTION_LEVEL, SECTION_LEVEL).reshape(*plane.shape, -1).astype(np.float32),
            np.clip(plane.distance, -SECTION_DEPTH, SECTION_DEPTH).reshape(plane.shape).astype(np.float32),
            np.delete(self.grid.origin, plane.normal), plane.cell, plane.normal)

    def depth_at(self, points: np.ndarray) -> np.ndarray:
        """Distance of points (m, D) to the wall, m, positive inside the cavity."""
        return -self.grid.distance_at(points)

    def _coefficients(self, frame: FrameData, droplets: list[list[np.ndarray]]) -> np.ndarray:
        """Splines (phases, nx, ny[, nz]) of the smoothed fractions without droplets, extended outward and into voids.

        With a free surface the last phase is the void.
        """
        keep = np.ones(len(frame.phase), bool)
        keep[[particle for few in droplets for piece in few for particle in piece]] = False
        position, volume = frame.position[keep].astype(np.float64), np.asarray(frame.volume)[keep]
        fraction, phase = np.asarray(frame.volume_fraction)[keep], frame.phase[keep]
        self._sums.load(position, volume, fraction, phase)
        alone = self._alone(position, volume, fraction)[self.grid.near]
        near, mixed = np.full((len(alone), self.field.liquids), np.nan, np.float32), alone == MIXED
        near[alone >= 0] = np.eye(self.field.liquids, dtype=np.float32)[alone[alone >= 0]]
        weight, share = self._sums.sample(self.grid.near_nodes[mixed])
        near[mixed] = smooth_fraction(weight, share)
        known = np.isfinite(near[:, 0])
        if self.free_surface:
            filled = (alone >= 0).astype(np.float32)[:, None]
            filled[mixed, 0] = np.clip(weight.sum(axis=1) / self.room[mixed], 0.0, 1.0)     # (U3)
            near = np.concatenate([np.where(known[:, None], filled * near, 0.0), 1.0 - filled], axis=1)
        elif not known.all():
            _, nearest = cKDTree(self.grid.near_nodes[known]).query(self.grid.near_nodes[~known])
            near[~known] = near[known][nearest]
        values = near.T[:, self.grid.extension]
        # The last fraction is what the others leave.
        for liquid in range(len(values) - 1):
            for axis in range(self.grid.dimension):
                values[liquid] = correlate1d(values[liquid], self.filter, axis=axis, mode="nearest")
        values[-1] = 1.0 - values[:-1].sum(axis=0)
        return values

    def _alone(self, position: np.ndarray, volume: np.ndarray, fraction: np.ndarray) -> np.ndarray:
        """The liquid that is alone around every coarse node, where no sum is needed: else MIXED, or NOTHING around."""
        shape, cell = self.grid.shape, self.grid.coarse_cell
        place = np.clip((position - self.grid.origin) / cell, 0.0, np.array(shape) - 1.001).astype(np.float32)
        lowest = place.astype(np.int32)
        flat = np.ravel_multi_index(tuple(lowest.T), shape)
        code = np.where(fraction.max(axis=1) > 1.0 - 1e-6, fraction.argmax(axis=1), MIXED).astype(np.int8)
        least, most = np.full(shape, 127, np.int8), np.full(shape, NOTHING, np.int8)
        np.minimum.at(least.ravel(), flat, code)
        np.maximum.at(most.ravel(), flat, code)
        reach = int(np.ceil(self._sums.reach * self.grid.spacing / cell))
        # Cells from reach below the node to reach above it.
        least, most = sliding(np.minimum, least, reach, reach - 1), sliding(np.maximum, most, reach, reach - 1)
        alone = np.where((least == most) | (most == NOTHING), most, MIXED)
        if self.free_surface:
            # Volumes shared among the nodes of the cells are even where particles are, whatever their places.
            amounts, strides = np.zeros(alone.size), np.cumprod([1, *shape[:0:-1]])[::-1]
            beyond, amount = (place - lowest).T, volume.astype(np.float32) / np.float32(cell) ** len(shape)
            shares = [(1.0 - one, one) for one in beyond]
            for corner in np.ndindex(*[2] * len(shape)):
                share = functools.reduce(np.multiply, [one[k] for one, k in zip(shares, corner, strict=True)], amount)
                amounts += np.bincount(flat + int(np.dot(corner, strides)), share, minlength=alone.size)
            filled = sliding(np.minimum, amounts.reshape(shape).astype(np.float32), reach, reach)
            alone = np.where((alone >= 0) & (filled < FULL), MIXED, alone)
        return alone

    def _bulk_offsets(self, target: np.ndarray) -> np.ndarray:
        """One offset per phase (the first stays 0) such that every surface holds its target volume.

        ``target`` is 0 for a liquid without bulk: droplets alone leave no interface to move.
        """
        offset, count = np.zeros(len(target)), len(target)
        if count == 2 and target.all():
            # Both liquids lose a little where the interface meets the wall; the lesser is held to its volume.
            judged = [0 if self.free_surface else int(target.argmin())]
            self._set_offset(offset, 1, judged, target)
        elif count > 2:
            for phase in [k for k in range(1, count) if target[k]] * OFFSET_ROUNDS:
                # What the void takes is what all liquids lack: the void itself may lose a little.
                void = self.free_surface and phase == count - 1
                judged = [k for k in range(phase) if target[k]] if void else [phase]
                if judged:
                    self._set_offset(offset, phase, judged, target)
        return offset

    def _set_offset(self, offset: np.ndarray, phase: int, judged: list[int], target: np.ndarray) -> None:
        """Change the offset of ``phase`` in place until the surfaces of ``judged`` together hold their targets."""
        sign, wanted = 1.0 if phase in judged else -1.0, target[judged].sum()

        def error(value: float) -> tuple[float, float]:
            offset[phase] = value
            volume, growth = np.sum([self._levels.volume(offset, one) for one in judged], axis=0)
            relative = volume / wanted - 1.0
            return 0.0 if abs(relative) < VOLUME_TOLERANCE else sign * relative, growth / wanted

        limit = OFFSET_LIMIT if not self.free_surface else OFFSET_LIMIT_OPEN
        low, high, value = -limit, limit, 0.0
        off, slope = error(value)
        while off and high - low > OFFSET_TOLERANCE:
            low, high = (value, high) if off < 0.0 else (low, value)
            before, off_before = value, off
            value -= off / slope if slope else 0.0
            if not low < value < high:
                value = 0.5 * (low + high)
            off, _ = error(value)
            slope = (off - off_before) / (value - before)
