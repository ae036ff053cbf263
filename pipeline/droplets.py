"""Pieces of liquid of few particles, and the offsets with which their surfaces hold the volume of their particles."""
import numpy as np
from scipy.optimize import brentq
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pipeline.cavity_grid import CavityGrid
from pipeline.frames import FrameData

DROPLET_PARTICLES = 200         # pieces up to this size have an offset of their own
LINK_DISTANCE = 1.5             # particles nearer than this many spacings belong to one piece
DROPLET_TOLERANCE = 0.03        # relative, where the search for a droplet's offset stops


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
    nodes, offsets = [np.zeros(0, int)], [np.zeros((len(fraction), 0))]
    for liquid, piece in ((liquid, piece) for liquid, pieces in enumerate(droplets) for piece in pieces):
        found = tree.query_ball_point(frame.position[piece], LINK_DISTANCE * grid.spacing)
        around = near[np.unique(np.concatenate(found).astype(int))]
        if not len(around):
            continue        # a particle that has left the cavity
        offset = np.zeros((len(fraction), len(around)))
        offset[liquid] = _offset(fraction, liquid, around, np.sum(frame.volume[piece], dtype=float), grid)
        nodes.append(around)
        offsets.append(offset)
    # Where two droplets share nodes, the larger offset shows both.
    unique, place = np.unique(np.concatenate(nodes), return_inverse=True)
    largest = np.full((len(fraction), len(unique)), -np.inf)
    np.maximum.at(largest, (slice(None), place), np.concatenate(offsets, axis=1))
    return unique, largest


def _offset(fraction: np.ndarray, liquid: int, around: np.ndarray, target: float, grid: CavityGrid) -> float:
    """Offset at the flat nodes ``around`` with which the contour there holds the volume ``target``, m**3."""
    index = np.array(np.unravel_index(around, grid.shape))
    low = index.min(axis=1)
    block = tuple(slice(start, stop + 1) for start, stop in zip(low, index.max(axis=1), strict=True))
    own = fraction[(slice(None), *block)]
    level = own[liquid] - np.delete(own, liquid, axis=0).max(axis=0)
    members = np.zeros(level.shape, bool)
    members[tuple(index - low[:, None])] = True
    reach = np.sort(-level[members])

    def error(value: float) -> float:
        relative = grid.enclosed(np.where(members, level + value, -1.0), block) / target - 1.0
        return 0.0 if abs(relative) < DROPLET_TOLERANCE else relative

    if error(reach[-1]) <= 0.0:
        return reach[-1]        # all that is near: a droplet pressed against the wall
    return brentq(error, reach[0], reach[-1], xtol=1e-3)
