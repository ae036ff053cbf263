"""Pieces of liquid of few particles: each has a level of its own, on which its surface holds their volume.

Equations: docs/methods/surfaces.md.
"""
import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pipeline.base.frame_files import FrameData
from pipeline.surfaces.cavity_grid import CavityGrid
from pipeline.surfaces.fraction_field import NORMALIZATION, wendland

DROPLET_PARTICLES = 200         # pieces up to this size have a level of their own
DROPLET_SUPPORT = 2.0           # of their kernel, in spacings
LINK_DISTANCE = 1.5             # particles nearer than this many spacings belong to one piece
DROPLET_TOLERANCE = 0.01        # relative, where the search for the level of a droplet stops
LEVEL_TOLERANCE = 1e-4          # the same, of the level itself
MOST_NODES = 200_000            # of boxes that are looked at in one go


def find_droplets(frame: FrameData, liquid: int, spacing: float) -> list[np.ndarray]:
    """Particles of every piece of a liquid that is too small to count as bulk."""
    members = np.flatnonzero(frame.phase == liquid)
    if not len(members):
        return []
    position = frame.position.take(members, axis=0).astype(float) / (LINK_DISTANCE * spacing)
    label = _surely_linked(position)
    # What this has already put into bulk stays there: only the rest has to be looked at pair by pair.
    if (few := _of_small_pieces(label)) is None:
        return []
    found = cKDTree(position).query_ball_point(position[few], 1.0)
    one, other = np.repeat(few, [len(near) for near in found]), np.concatenate(found).astype(int)
    label = _pieces(label.max() + 1, label[one], label[other])[label]
    if (small := _of_small_pieces(label)) is None:
        return []
    order = small[np.argsort(label[small], kind="stable")]
    return np.split(members[order], np.flatnonzero(np.diff(label[order])) + 1)


def _of_small_pieces(label: np.ndarray) -> np.ndarray | None:
    """Particles (k,) of pieces of so few that they are droplets; None without any."""
    small = np.bincount(label) <= DROPLET_PARTICLES
    return np.flatnonzero(small[label]) if small.any() else None


def _surely_linked(position: np.ndarray) -> np.ndarray:
    """Labels (n,) of particles: those with one label hang together by links not longer than 1, and most that do have.

    In bins with a diagonal of 1 all particles are linked; of neighboring bins only the first particles are compared.
    """
    dimension = position.shape[1]
    axes = np.ascontiguousarray(position.T)
    place = [((axis - axis.min()) * dimension**0.5).astype(np.int32) + 2 for axis in axes]
    shape = np.array([axis.max() for axis in place]) + 3
    flat = np.ravel_multi_index(tuple(place), shape)
    first = np.full(np.prod(shape), -1, np.int32)
    first[flat] = np.arange(len(flat), dtype=np.int32)
    bins = np.flatnonzero(first >= 0)
    center = axes.take(first[bins], axis=1).astype(np.float32)
    number = first      # of the bin from now on
    number[bins] = np.arange(len(bins), dtype=np.int32)
    strides = np.cumprod([1, *shape[:0:-1]])[::-1]
    piece = _pieces(len(bins), *_links(np.arange(len(bins)), 1, bins, number, center, strides))
    label = piece[number[flat]]
    lone = _of_small_pieces(label)
    if lone is not None:        # a particle may be linked over two bins; rarely is this its only link
        one, other = _links(np.unique(number[flat[lone]]), 2, bins, number, center, strides)
        label = _pieces(len(bins), piece[one], piece[other])[label]
    return label


def _links(which: np.ndarray, reach: int, bins: np.ndarray, number: np.ndarray, center: np.ndarray,
           strides: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (k,) of bins of which the first particles are linked: each of ``which`` with bins after it within reach.

    With a reach of more than one, those before it count as well.
    """
    ones, others = [], []
    for step in np.ndindex(*[2 * reach + 1] * len(strides)):
        change = int((np.array(step) - reach) @ strides)
        if change > 0 or (change and reach > 1):
            other = number[bins[which] + change]
            one = np.flatnonzero(other >= 0)
            one, other = which[one], other[one]
            near = sum((axis[one] - axis[other]) ** 2 for axis in center) < 0.999       # in single precision
            ones.append(one[near])
            others.append(other[near])
    return np.concatenate(ones), np.concatenate(others)


def _pieces(count: int, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Piece (count,) of everything, of which ``one`` and ``other`` (k,) are linked."""
    graph = coo_matrix((np.ones(len(one), bool), (one, other)), shape=(count, count))
    return connected_components(graph, directed=False)[1]


@dataclasses.dataclass
class DropletBox:
    """Level of a droplet in a box of fine nodes.

    Attributes
    ----------
    phase : liquid of the droplet.
    lowest : (D,) index of the lowest node of the box.
    level : (nx, ny[, nz]) float32, sum of volume * W over its particles, less what its surface has of it.
    members : nodes at which it has any.
    """

    phase: int
    lowest: np.ndarray
    level: np.ndarray
    members: np.ndarray

    def flat(self, shape: tuple[int, ...]) -> np.ndarray:
        """Flat indices of the members in a grid."""
        index = np.stack(np.nonzero(self.members), axis=1) + self.lowest
        return np.ravel_multi_index(tuple(index.T), shape)


def droplet_boxes(frame: FrameData, droplets: Sequence[Sequence[np.ndarray]], grid: CavityGrid) -> list[DropletBox]:
    """Levels of all droplets (pieces of every liquid) whose surfaces hold the volume of their particles (U4)."""
    boxes, targets, shapes = [], [], {}
    for phase, piece in ((phase, piece) for phase, pieces in enumerate(droplets) for piece in pieces):
        box = _box(frame.position[piece].astype(float), frame.volume[piece], phase, grid)
        shapes.setdefault(tuple(1 << (length - 1).bit_length() for length in box.level.shape), []).append(len(boxes))
        boxes.append(box)
        targets.append(np.sum(frame.volume[piece], dtype=float))
    for shape, alike in shapes.items():
        number = max(1, MOST_NODES // math.prod(shape))
        for first in range(0, len(alike), number):
            some = alike[first:first + number]
            _fit([boxes[k] for k in some], np.array([targets[k] for k in some]), shape, grid)
    return boxes


def _box(position: np.ndarray, volume: np.ndarray, phase: int, grid: CavityGrid) -> DropletBox:
    """Sums of volume * W of one droplet in a box of nodes of the grid around it."""
    places, reach = (position - grid.origin) / grid.cell, DROPLET_SUPPORT * grid.spacing / grid.cell
    lowest = np.maximum(np.floor(places.min(axis=0) - reach).astype(int), 0)
    highest = np.minimum(np.ceil(places.max(axis=0) + reach).astype(int), np.array(grid.fine_shape) - 1)
    axes = [np.arange(low, high + 1) for low, high in zip(lowest, highest, strict=True)]
    total = np.zeros([len(axis) for axis in axes])
    for place, own in zip(places, volume, strict=True):
        near = [slice(*np.searchsorted(axis, (center - reach, center + reach)))
                for axis, center in zip(axes, place, strict=True)]
        squared = sum(np.ix_(*((axis[one] - center) ** 2 for axis, one, center in zip(axes, near, place, strict=True))))
        total[tuple(near)] += own / grid.spacing**grid.dimension * wendland(np.sqrt(squared) / reach)
    total *= NORMALIZATION[grid.dimension] / DROPLET_SUPPORT**grid.dimension
    return DropletBox(phase, lowest, total.astype(np.float32), total > 0.0)


def _fit(boxes: Sequence[DropletBox], target: np.ndarray, shape: tuple[int, ...], grid: CavityGrid) -> None:
    """Lower the levels of boxes that fit into one shape to where their surfaces hold ``target`` (k,): all at once."""
    level, depth = np.zeros((len(boxes), *shape)), np.full((len(boxes), *shape), -1.0)
    for index, box in enumerate(boxes):
        place: Any = (index, *map(slice, box.level.shape))
        nodes = np.stack(np.meshgrid(*map(np.arange, box.level.shape), indexing="ij"), axis=-1) + box.lowest
        level[place], depth[place] = box.level, grid.depth_at(grid.origin + grid.cell * nodes)

    def error(taken: np.ndarray) -> np.ndarray:
        lowered = level - taken.reshape(-1, *[1] * len(shape))
        return grid.enclosed_each(np.minimum(lowered, depth)) / target - 1.0

    # Least is all that is near: a droplet pressed against the wall.
    low, high = np.full(len(boxes), 1e-3), level.reshape(len(boxes), -1).max(axis=1)
    high = np.where(error(low) <= 0.0, low, high)
    while (high - low > LEVEL_TOLERANCE).any():
        middle = 0.5 * (low + high)
        off = error(middle)
        high = np.where(off < DROPLET_TOLERANCE, middle, high)
        low = np.where(off > -DROPLET_TOLERANCE, middle, low)
    for box, taken in zip(boxes, 0.5 * (low + high), strict=True):
        box.level -= np.float32(taken)
