"""Pieces of liquid of few particles, and the offsets with which their surfaces hold the volume of their particles."""
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pipeline.base.frame_files import FrameData
from pipeline.surfaces.cavity_grid import CavityGrid

DROPLET_PARTICLES = 200         # pieces up to this size have an offset of their own
LINK_DISTANCE = 1.5             # particles nearer than this many spacings belong to one piece
DROPLET_TOLERANCE = 0.03        # relative, where the search for a droplet's offset stops
OFFSET_TOLERANCE = 1e-3         # the same, of the offset itself
MOST_NODES = 200_000            # of boxes that are looked at in one go


def find_droplets(frame: FrameData, liquid: int, spacing: float) -> list[np.ndarray]:
    """Particles of every piece of a liquid that is too small to count as bulk."""
    members = np.flatnonzero(frame.phase == liquid)
    if not len(members):
        return []
    pairs = cKDTree(frame.position[members]).query_pairs(LINK_DISTANCE * spacing, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs), bool), tuple(pairs.T)), shape=(len(members),) * 2)
    count, label = connected_components(graph, directed=False)
    size = np.bincount(label, minlength=count)
    order = np.argsort(label, kind="stable")
    pieces = np.split(members[order], np.cumsum(size)[:-1])
    return [piece for piece in pieces if len(piece) <= DROPLET_PARTICLES]


def droplet_offsets(frame: FrameData, fraction: np.ndarray, droplets: list[list[np.ndarray]],
                    grid: CavityGrid) -> tuple[np.ndarray, np.ndarray]:
    """Nodes around the droplets (k,) and the offsets there (phases, k) that give each its particles' volume.

    Parameters
    ----------
    fraction : (phases, nx, ny[, nz]).
    droplets : pieces of every liquid.
    """
    tree = cKDTree(grid.near_nodes) if any(droplets) else None
    near = np.flatnonzero(grid.near)
    boxes, shapes = [], {}
    for liquid, piece in ((liquid, piece) for liquid, pieces in enumerate(droplets) for piece in pieces):
        found = tree.query_ball_point(frame.position[piece], LINK_DISTANCE * grid.spacing)
        around = near[np.unique(np.concatenate(found).astype(int))]
        if len(around):         # else it has left the cavity
            box = _Box(fraction, liquid, around, np.sum(frame.volume[piece], dtype=float), grid)
            boxes.append(box)
            shapes.setdefault(tuple(1 << (length - 1).bit_length() for length in box.level.shape), []).append(box)
    for shape, alike in shapes.items():
        number = max(1, MOST_NODES // math.prod(shape))
        for first in range(0, len(alike), number):
            _fit(alike[first:first + number], shape, grid)
    nodes, offsets = [np.zeros(0, int)], [np.zeros((len(fraction), 0))]
    for box in boxes:
        offset = np.zeros((len(fraction), len(box.around)))
        offset[box.liquid] = box.offset
        nodes.append(box.around)
        offsets.append(offset)
    # Where two droplets share nodes, the larger offset shows both.
    unique, place = np.unique(np.concatenate(nodes), return_inverse=True)
    largest = np.full((len(fraction), len(unique)), -np.inf)
    columns: Any = (slice(None), place)
    np.maximum.at(largest, columns, np.concatenate(offsets, axis=1))
    return unique, largest


class _Box:
    """The nodes around a droplet of ``target`` m**3: flat indices ``around`` in the grid, ``members`` of the box.

    ``level`` is how far the liquid exceeds the others, ``depth`` that of the wall; ``offset`` is to be found.
    """

    def __init__(self, fraction: np.ndarray, liquid: int, around: np.ndarray, target: float, grid: CavityGrid):
        index = np.array(np.unravel_index(around, grid.shape))
        low = index.min(axis=1)
        block = tuple(slice(start, stop + 1) for start, stop in zip(low, index.max(axis=1), strict=True))
        own = fraction[(slice(None), *block)]
        self.liquid, self.around, self.target, self.offset = liquid, around, target, 0.0
        self.level, self.depth = own[liquid] - np.delete(own, liquid, axis=0).max(axis=0), grid.depth[block]
        self.members = np.zeros(self.level.shape, bool)
        self.members[tuple(index - low[:, None])] = True


def _fit(boxes: Sequence[_Box], shape: tuple[int, ...], grid: CavityGrid) -> None:
    """Set the offsets with which the contours in boxes that fit into one shape hold their targets: all at once."""
    level, depth = np.zeros((len(boxes), *shape)), np.full((len(boxes), *shape), -1.0)
    members = np.zeros(level.shape, bool)
    for index, box in enumerate(boxes):
        place: Any = (index, *map(slice, box.level.shape))
        level[place], depth[place], members[place] = box.level, box.depth, box.members
    target = np.array([box.target for box in boxes])

    def error(offset: np.ndarray) -> np.ndarray:
        raised = level + offset.reshape(-1, *[1] * len(shape))
        return grid.enclosed_each(np.minimum(np.where(members, raised, -1.0), depth)) / target - 1.0

    low = np.array([-box.level[box.members].max() for box in boxes])
    high = np.array([-box.level[box.members].min() for box in boxes])
    low = np.where(error(high) <= 0.0, high, low)   # all that is near: a droplet pressed against the wall
    while (high - low > OFFSET_TOLERANCE).any():
        middle = 0.5 * (low + high)
        off = error(middle)
        low = np.where(off < DROPLET_TOLERANCE, middle, low)
        high = np.where(off > -DROPLET_TOLERANCE, middle, high)
    for box, offset in zip(boxes, 0.5 * (low + high), strict=True):
        box.offset = offset
