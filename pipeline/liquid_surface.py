"""Surfaces of the liquids in one frame, from its particles.

Liquid l is where ``min(dominance_l, depth) > 0``: dominance is how far its fraction exceeds that of every other liquid,
depth the distance to the wall. So two liquids share one interface, and the liquids touch the wall without a gap.
Offsets added to the fractions conserve the volume of every liquid; droplets have offsets of their own.
"""
import dataclasses
import time

import numpy as np
from scipy.ndimage import correlate1d, distance_transform_edt, map_coordinates
from scipy.optimize import brentq
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pipeline.contour import TriangleMesh, contour
from pipeline.errors import UserError
from pipeline.fraction_field import FractionField, sided_fraction, smooth_fraction, taubin_filter
from pipeline.frames import FrameData

DROPLET_PARTICLES = 200         # pieces up to this size have an offset of their own
LINK_DISTANCE = 1.5             # particles nearer than this many spacings belong to one piece
OFFSET_ROUNDS = 3               # with three liquids and more every offset touches the others
OFFSET_LIMIT = 0.8              # of a difference of fractions that lies in -1..1
DROPLET_TOLERANCE = 0.03        # relative, where the search for a droplet's offset stops
VOLUME_TOLERANCE = 2e-4         # relative, where the search for the offset stops
SECTION_LEVEL, SECTION_DEPTH = 0.25, 1e-3       # where dominance and distance (m) in the section are cut off
SECTION_PIXELS = 480            # nodes of the section along its longer side, at least


@dataclasses.dataclass
class LiquidSurface:
    """Mesh of one liquid and what was measured on it."""

    mesh: TriangleMesh
    statistics: dict[str, object]


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
    initial : arrays of ``initial.npz`` (signed distance to the wall, particle spacing).
    liquids : number of liquids.
    cell_ratio : cell of the grid in particle spacings.
    method : "flying_edges" or "marching_cubes".
    smoothing_iterations : passes of Taubin's filter on the fractions; 0 switches it off.
    """

    def __init__(self, initial: dict, liquids: int, *, cell_ratio: float = 0.5, method: str = "flying_edges",
                 smoothing_iterations: int = 20):
        self.spacing = float(initial["particle_spacing"])
        self.wall = np.asarray(initial["sdf_values"], np.float64)
        self.wall_origin, self.wall_cell = np.asarray(initial["sdf_origin"]), float(initial["sdf_cell"])
        if self.wall.ndim != 3:
            raise UserError("surfaces are made of scenes in three dimensions, but this scene has `dimension: 2`")
        self.method = method
        self.filter = taubin_filter(smoothing_iterations)
        self.cell = cell_ratio * self.spacing
        self.origin = self.wall_origin
        extent = (np.array(self.wall.shape) - 1) * self.wall_cell
        self.shape = tuple(np.ceil(extent / self.cell - 1e-9).astype(int) + 1)
        nodes = np.stack(np.meshgrid(*(np.arange(n) for n in self.shape), indexing="ij"), axis=-1) * self.cell
        self.depth = -self._wall_at(self.origin + nodes) / self.spacing
        self.near = self.depth > -2.0 * max(cell_ratio, 0.5)
        self.near_nodes = (self.origin + nodes)[self.near]
        known = distance_transform_edt(~self.near, return_distances=False, return_indices=True)
        number = np.cumsum(self.near.ravel()).reshape(self.shape) - 1
        self.extension = number[tuple(known)]       # for every node the nearest of near_nodes
        self.cavity_volume = self._fit_wall(initial.get("cavity_volume"))
        self.field = FractionField(self.spacing, self.origin, self.origin + extent, liquids)
        self._section = self._section_nodes(extent)

    def _fit_wall(self, volume: float | None) -> float:
        """Move the wall of the grid so that its contour holds the cavity's volume (m**3); return what it holds.

        The flat triangles of a coarse grid cut off a little of a round wall: 0.1 % at 0.8 mm, 2 % at 2 mm.
        """
        wall, reach = self.depth, 0.25 * self.cell / self.spacing

        def error(shift: float) -> float:
            self.depth = wall + shift
            return self._mesh(np.ones(self.shape)).volume - float(volume)

        if volume is None or error(-reach) * error(reach) > 0.0:
            self.depth = wall
        else:
            self.depth = wall + brentq(error, -reach, reach, xtol=1e-4)
        return self._mesh(np.ones(self.shape)).volume

    def surfaces(self, frame: FrameData) -> list[LiquidSurface]:
        """Closed mesh and statistics of every liquid of ``frame``; also prepares :meth:`section`.

        Raises
        ------
        UserError : the volume of a liquid cannot be met.
        """
        start = time.perf_counter()
        self.field.load(frame.position, frame.volume, frame.volume_fraction, frame.phase)
        fraction = self._fractions()
        volume = np.asarray(frame.volume, np.float64)
        expected = np.array([volume[frame.phase == liquid].sum() for liquid in range(self.field.liquids)])
        droplets = [self._droplets(frame, liquid) for liquid in range(self.field.liquids)]
        patches = self._droplet_offsets(frame, fraction, droplets)
        bulk = np.array([int((frame.phase == liquid).sum()) - sum(map(len, pieces))
                         for liquid, pieces in enumerate(droplets)])
        offset = self._bulk_offsets(fraction, np.where(bulk > 0, expected, 0.0), expected.sum(), patches)
        self._dominance = dominance(fraction, offset, patches)
        result = []
        for liquid in range(self.field.liquids):
            mesh = self._mesh(self._dominance[liquid])
            others = np.delete(offset, liquid)
            result.append(LiquidSurface(mesh, {
                "triangles": len(mesh.triangles), "watertight": mesh.is_closed(), "volume": mesh.volume,
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

    def section(self) -> Section:
        """Section x = 0 of the frame given to :meth:`surfaces` last, sharp at the interface.

        Dominance and distance are cut off, and the fraction is 0 well outside the cavity: constants make small files.
        """
        points, shape, cell = self._section
        wall = self._wall_at(points)
        index = ((points - self.origin) / self.cell).T
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
            np.clip(wall, -SECTION_DEPTH, SECTION_DEPTH).reshape(shape).astype(np.float32), self.origin[1:], cell)

    def depth_at(self, points: np.ndarray) -> np.ndarray:
        """Distance of points (m, 3) to the wall, m, positive inside the cavity."""
        return -self._wall_at(points)

    def _section_nodes(self, extent: np.ndarray) -> tuple[np.ndarray, tuple[int, int], float]:
        cell = self.cell / max(1, int(np.ceil(SECTION_PIXELS * self.cell / extent[1:].max())))
        shape = tuple(int(n) for n in np.floor(extent[1:] / cell + 1e-9) + 1)
        y, z = np.meshgrid(*(np.arange(n) * cell for n in shape), indexing="ij")
        points = np.stack([np.full_like(y, -self.origin[0]), y, z], axis=-1).reshape(-1, 3) + self.origin
        return points, shape, cell

    def _wall_at(self, points: np.ndarray) -> np.ndarray:
        index = np.moveaxis((points - self.wall_origin) / self.wall_cell, -1, 0)
        return map_coordinates(self.wall, index, order=1, mode="nearest")

    def _mesh(self, level: np.ndarray) -> TriangleMesh:
        return contour(np.minimum(level, self.depth), self.origin, self.cell, self.method)

    def _fractions(self) -> np.ndarray:
        """Filtered fractions (liquids, nx, ny, nz), extended outward and into voids by the nearest known value."""
        weight, share = self.field.sample(self.near_nodes)
        near = smooth_fraction(weight, share)
        known = np.isfinite(near[:, 0])
        if not known.any():
            raise UserError("a frame without particles has no surface")
        if not known.all():
            _, nearest = cKDTree(self.near_nodes[known]).query(self.near_nodes[~known])
            near[~known] = near[known][nearest]
        values = near.T[:, self.extension]
        # The last fraction is what the others leave.
        for liquid in range(self.field.liquids - 1):
            for axis in range(3):
                values[liquid] = correlate1d(values[liquid], self.filter, axis=axis, mode="nearest")
        values[-1] = 1.0 - values[:-1].sum(axis=0)
        return values

    def _bulk_offsets(self, fraction: np.ndarray, expected: np.ndarray, total: float, droplets: tuple) -> np.ndarray:
        """One offset per liquid (the first stays 0) such that every mesh has its liquid's share of the cavity.

        ``expected`` is 0 for a liquid without bulk: droplets alone leave no interface to move.
        """
        offset = np.zeros(len(fraction))
        target = expected * (self.cavity_volume / total)
        if len(fraction) == 2 and target.all():
            # Both liquids lose a little where the interface meets the wall; the lesser is held to its volume.
            self._set_offset(offset, 1, int(target.argmin()), fraction, droplets, target)
        elif len(fraction) > 2:
            for liquid in [k for k in range(1, len(fraction)) if target[k]] * OFFSET_ROUNDS:
                self._set_offset(offset, liquid, liquid, fraction, droplets, target)
        return offset

    def _set_offset(self, offset: np.ndarray, liquid: int, judged: int, fraction, droplets, target: np.ndarray) -> None:
        """Change the offset of ``liquid`` in place until the mesh of ``judged`` has its target volume."""
        sign = 1.0 if judged == liquid else -1.0

        def error(value: float) -> float:
            offset[liquid] = value
            volume = self._mesh(dominance(fraction, offset, droplets)[judged]).volume
            relative = volume / target[judged] - 1.0
            return 0.0 if abs(relative) < VOLUME_TOLERANCE else sign * relative

        reach = OFFSET_LIMIT / 8
        while reach < OFFSET_LIMIT and not error(-reach) <= 0.0 <= error(reach):
            reach *= 2
        low, high = error(-reach), error(reach)
        if low <= 0.0 <= high:
            offset[liquid] = brentq(error, -reach, reach, xtol=1e-5)
        else:
            offset[liquid] = -reach if abs(low) < abs(high) else reach

    def _droplets(self, frame: FrameData, liquid: int) -> list[np.ndarray]:
        """Particles of every piece of the liquid that is too small to count as bulk."""
        members = np.flatnonzero(frame.phase == liquid)
        if not len(members):
            return []
        pairs = cKDTree(frame.position[members]).query_pairs(LINK_DISTANCE * self.spacing, output_type="ndarray")
        graph = coo_matrix((np.ones(len(pairs), bool), tuple(pairs.T)), shape=(len(members),) * 2)
        count, label = connected_components(graph, directed=False)
        size = np.bincount(label, minlength=count)
        return [members[label == piece] for piece in np.flatnonzero(size <= DROPLET_PARTICLES)]

    def _droplet_offsets(self, frame: FrameData, fraction: np.ndarray, droplets) -> tuple[np.ndarray, np.ndarray]:
        """Nodes around the droplets (k,) and the offsets there (liquids, k) that give each its particles' volume."""
        tree = cKDTree(self.near_nodes) if any(droplets) else None
        near = np.flatnonzero(self.near)
        nodes, offsets = [np.zeros(0, int)], [np.zeros((len(fraction), 0))]
        for liquid, piece in ((liquid, piece) for liquid, pieces in enumerate(droplets) for piece in pieces):
            found = tree.query_ball_point(frame.position[piece], LINK_DISTANCE * self.spacing)
            around = near[np.unique(np.concatenate(found).astype(int))]
            if not len(around):
                continue        # a particle that has left the cavity
            offset = np.zeros((len(fraction), len(around)))
            offset[liquid] = self._droplet_offset(fraction, liquid, around, np.sum(frame.volume[piece], dtype=float))
            nodes.append(around)
            offsets.append(offset)
        return np.concatenate(nodes), np.concatenate(offsets, axis=1)

    def _droplet_offset(self, fraction: np.ndarray, liquid: int, around: np.ndarray, target: float) -> float:
        """Offset at the flat nodes ``around`` with which the contour there holds the volume ``target``, m**3."""
        index = np.array(np.unravel_index(around, self.shape))
        low = index.min(axis=1)
        block = tuple(slice(start, stop + 1) for start, stop in zip(low, index.max(axis=1), strict=True))
        own = fraction[(slice(None), *block)]
        level = own[liquid] - np.delete(own, liquid, axis=0).max(axis=0)
        members = np.zeros(level.shape, bool)
        members[tuple(index - low[:, None])] = True
        reach = np.sort(-level[members])
        depth = self.depth[block]

        def error(value: float) -> float:
            raised = np.minimum(np.where(members, level + value, -1.0), depth)
            relative = contour(raised, self.origin, self.cell, self.method).volume / target - 1.0
            return 0.0 if abs(relative) < DROPLET_TOLERANCE else relative

        if error(reach[-1]) <= 0.0:
            return reach[-1]        # all that is near: a droplet pressed against the wall
        return brentq(error, reach[0], reach[-1], xtol=1e-3)


def dominance(fraction: np.ndarray, offset: np.ndarray, droplets: tuple) -> np.ndarray:
    """How far every fraction plus its offset exceeds the largest of the others: (liquids, nx, ny, nz) in -1..1.

    With two liquids the second is the exact negative of the first: one shared interface. One liquid alone: 1.
    """
    liquids = len(fraction)
    if liquids == 1:
        return np.ones_like(fraction)
    raised = fraction + offset[:, None, None, None]
    nodes, own_offset = droplets
    raised.reshape(liquids, -1)[:, nodes] = fraction.reshape(liquids, -1)[:, nodes] + own_offset
    if liquids == 2:
        difference = raised[0] - raised[1]
        return np.stack([difference, -difference])
    return np.stack([raised[k] - np.delete(raised, k, axis=0).max(axis=0) for k in range(liquids)])
