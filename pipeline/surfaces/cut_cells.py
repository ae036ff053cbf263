"""Cells of a grid that the surface of a liquid crosses, cut exactly along the wall: segments, loops, triangles.

In a cell two fields are given at the corners: the level of the liquid and the depth below the wall. On every face of
the cell each of them has up to two chords, straight lines between the places where it crosses zero on the edges. Chords
of both that cross have one point in common, a point of the contact line. Chords and the contact line within the cell
are the borders of three patches: the interface, and the wall on both sides of it. The face alone decides on its chords,
so cells that share it agree, and all that is put together of patches is closed.
"""
import functools
import itertools

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

# Corner 4 i + 2 j + k of a cell is at (i, j, k); edge 4 axis + 2 p + q runs along axis from the corner that is p and q
# along the next two axes.
CORNERS = np.array([(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)])
INTERFACE, WALL, OTHER_WALL = range(3)  # patches: between the liquids, wall of the liquid inside, of that outside
# Codes of the points of a cell: on 12 edges for each field, 4 on each face where the fields meet, 24 between such two.
DEPTH, CONTACT, BETWEEN, CODES = 12, 24, 48, 72
NEAREST = 1e-9                          # share of an edge by which its points of both fields differ at least


def _corner(axis: int, along: int, p: int, q: int) -> int:
    place = np.zeros(3, int)
    place[[axis, (axis + 1) % 3, (axis + 2) % 3]] = along, p, q
    return int(place @ (4, 2, 1))


EDGE_ENDS = np.array([[_corner(axis, along, p, q) for along in (0, 1)]
                      for axis in range(3) for p in (0, 1) for q in (0, 1)])
EDGE_AXIS = np.repeat(np.arange(3), 4)
# Faces 2 axis + side: corners counterclockwise seen from the end of the axis, edges between them, and where an edge
# runs against this turn.
FACE_CORNERS = np.array([[_corner(axis, side, p, q) for p, q in ((0, 0), (1, 0), (1, 1), (0, 1))]
                         for axis in range(3) for side in (0, 1)])
FACE_EDGES = np.array([[next(edge for edge, ends in enumerate(EDGE_ENDS) if set(ends) == {face[k], face[(k + 1) % 4]})
                        for k in range(4)] for face in FACE_CORNERS])
AGAINST = np.array([False, False, True, True])
PLACE_IN_FACE = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])


def _chord_table() -> np.ndarray:
    """Chords (16 patterns of signs, 2 joined or not, 2 chords, 2 ends): sides of a face, -1 without a chord.

    A chord runs from where the turn leaves the positive part to where it enters it. Two positive corners across are
    parted by their chords, or joined between them.
    """
    table = np.full((16, 2, 2, 2), -1)
    for pattern in range(16):
        sign = [(pattern >> k) & 1 for k in range(4)]
        leaves = [k for k in range(4) if sign[k] and not sign[(k + 1) % 4]]
        enters = [k for k in range(4) if not sign[k] and sign[(k + 1) % 4]]
        for joined in (0, 1):
            for number, side in enumerate(leaves):
                steps = range(1, 4) if joined else range(3, 0, -1)
                table[pattern, joined, number] = side, next((side + k) % 4 for k in steps if (side + k) % 4 in enters)
    return table


CHORDS = _chord_table()


def patterns(values: np.ndarray) -> np.ndarray:
    """Signs of values (n, 8) at the corners as one number (n,): bit c is set where corner c is positive."""
    return (values > 0.0) @ (1 << np.arange(8))


def block_patterns(values: np.ndarray) -> np.ndarray:
    """The same for the cells (k, k, k, n) between nodes (k + 1, k + 1, k + 1, n) of blocks, uint8."""
    positive, last = (values > 0.0).astype(np.uint8), len(values) - 1
    result = np.zeros((last, last, last, values.shape[3]), np.uint8)
    for bit, (i, j, k) in enumerate(CORNERS):
        result |= positive[i:i + last, j:j + last, k:k + last] << np.uint8(bit)
    return result


@functools.cache
def ambiguous() -> np.ndarray:
    """Whether a pattern of signs (256,) has a face with two chords."""
    signs = (np.arange(256)[:, None] >> np.arange(8)) & 1
    faces = signs[:, FACE_CORNERS]
    return ((faces[..., 0] == faces[..., 2]) & (faces[..., 1] == faces[..., 3]) &
            (faces[..., 0] != faces[..., 1])).any(axis=1)


@functools.cache
def triangle_table() -> tuple[np.ndarray, np.ndarray]:
    """Edges (t, 3) of the triangles of all patterns that are not ambiguous, and where each pattern starts (257,).

    The pattern with all signs reversed has the same triangles, turned round.
    """
    known = np.flatnonzero(~ambiguous())
    level = np.where((known[:, None] >> np.arange(8)) & 1, 1.0, -1.0)
    cell, _, start, end, _ = segments(level, np.ones_like(level))
    triangles: list[list[tuple[int, ...]]] = [[] for _ in range(256)]
    for index, pattern in enumerate(known):
        following = dict(zip(start[cell == index], end[cell == index], strict=True))
        while following and pattern < 128:
            first = min(following)
            loop = [first]
            while (edge := following.pop(loop[-1])) != first:
                loop.append(edge)
            fan = [(loop[0], *pair) for pair in itertools.pairwise(loop[1:])]
            triangles[pattern] += fan
            triangles[255 - pattern] += [(a, c, b) for a, b, c in fan]
    count = np.cumsum([0, *map(len, triangles)])
    return np.array([triangle for some in triangles for triangle in some]), count


def table_triangles(pattern: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cell (t,) and edges (t, 3) of the triangles in cells whose patterns (n,) are not ambiguous."""
    triangles, first = triangle_table()
    count = np.diff(first)[pattern]
    cell = np.repeat(np.arange(len(pattern)), count)
    number = np.arange(len(cell)) - np.repeat(np.cumsum(count) - count, count)
    return cell, triangles[first[pattern][cell] + number]


def crossings(values: np.ndarray) -> np.ndarray:
    """Where on the edges (n, 12) values (n, 8) at the corners cross zero, from 0 to 1; NaN where they do not."""
    low, high = (values[:, EDGE_ENDS[:, k]].astype(float) for k in (0, 1))
    crosses = (low > 0.0) != (high > 0.0)
    return np.where(crosses, low / np.where(crosses, low - high, 1.0), np.nan)


def patches(level: np.ndarray, depth: np.ndarray):
    """Triangles of the patches in cells.

    Parameters
    ----------
    level, depth : (n, 8) at the corners, nowhere 0.

    Returns
    -------
    cell, patch : (t,) of the triangles; they face out of what is inside, and OTHER_WALL out of what is not.
    corners : (t, 3) codes of their points in the cell, ``CODES`` and more for the centers of loops.
    place : (n, CODES, 3) of the points in their cells, from 0 to 1; NaN where there is none.
    of_cell, center : (l,) and (l, 3) cells and places of the centers, in the order of their codes.
    """
    cell, patch, start, end, place = segments(level, depth)
    cell, patch, start, end = _with_contact_line(cell, patch, start, end, place)
    cell, patch, corners, of_cell, center = _triangles(cell, patch, start, end, place)
    return cell, patch, corners, place, of_cell, center


def segments(level: np.ndarray, depth: np.ndarray):
    """Borders of the patches on the faces of cells: cell, patch, codes of both ends (s,); places (n, CODES, 3)."""
    at_level, at_depth = crossings(level), crossings(depth)
    close = np.abs(at_level - at_depth) < NEAREST
    at_depth[close] = at_level[close] + NEAREST
    place = np.full((len(level), CODES, 3), np.nan)
    for first, at in ((0, at_level), (DEPTH, at_depth)):
        place[:, first:first + 12] = CORNERS[EDGE_ENDS[:, 0]]
        place[:, first + np.arange(12), EDGE_AXIS] += at
    found = [(np.zeros(0, np.int64),) * 4]
    for face in range(6):
        one, other = _Chords(level, at_level, face), _Chords(depth, at_depth, face)
        meets, share, other_share = _meeting(one, other)
        points = CONTACT + 4 * face + np.arange(4).reshape(2, 2)
        axis, side = divmod(face, 2)
        for i, j in np.ndindex(2, 2):
            met = meets[:, i, j]
            at = one.start_place[met, i] + share[met, i, j, None] * (one.end_place - one.start_place)[met, i]
            place[met, points[i, j], axis] = side
            place[met, points[i, j], (axis + 1) % 3], place[met, points[i, j], (axis + 2) % 3] = at.T
        for k in range(2):
            for chords, base, cross, along, at, against, kinds in (
                    (one, 0, meets[:, k], share[:, k], points[k], other, (INTERFACE, None)),
                    (other, DEPTH, meets[:, :, k], other_share[:, :, k], points[:, k], one, (WALL, OTHER_WALL))):
                found += chords.pieces(k, base, cross, along, at, against, kinds, reverse=side == 1)
    return *(np.concatenate(part) for part in zip(*found, strict=True)), place


class _Chords:
    """Chords of one field on one face of n cells: ``start``, ``end`` (n, 2) as turns 0..4 around it, and places."""

    def __init__(self, values: np.ndarray, at: np.ndarray, face: int):
        self.values = values[:, FACE_CORNERS[face]]
        self.edges = FACE_EDGES[face]
        along = at[:, self.edges]
        self.turn = np.arange(4) + np.where(AGAINST, 1.0 - along, along)
        a, b, c, d = self.values.T
        pattern = (self.values > 0.0) @ (1, 2, 4, 8)
        joined = np.where(a > 0.0, a * c > b * d, a * c < b * d)
        self.sides = CHORDS[pattern, joined.astype(int)]
        self.exists = self.sides[..., 0] >= 0
        turns = np.take_along_axis(self.turn, self.sides.reshape(-1, 4), axis=1).reshape(-1, 2, 2)
        self.start, self.end = turns[..., 0], turns[..., 1]
        corner, following = PLACE_IN_FACE[self.sides], PLACE_IN_FACE[(self.sides + 1) % 4]
        places = corner + (turns - self.sides)[..., None] * (following - corner)
        self.start_place, self.end_place = places[:, :, 0], places[:, :, 1]

    def positive_at(self, rows: np.ndarray, side: np.ndarray, turn: np.ndarray) -> np.ndarray:
        """Whether the field of cells ``rows`` (m,) is positive at turns (m,), each on a side (m,) of the face."""
        before, after = self.values[rows, side] > 0.0, self.values[rows, (side + 1) % 4] > 0.0
        return np.where(turn < self.turn[rows, side], before, after)

    def pieces(self, k, base, cross, along, at, against, kinds, *, reverse):
        """Chord k cut at the points ``at`` (2,) of its crossings with another field's, as segments of patches."""
        own = np.flatnonzero(self.exists[:, k])
        order = np.argsort(np.where(cross[own], along[own], np.inf), axis=1)
        point, count = at[order], cross[own].sum(axis=1)
        sides = self.sides[own, k]
        first, last = base + self.edges[sides[:, 0]], base + self.edges[sides[:, 1]]
        inside = against.positive_at(own, sides[:, 0], self.start[own, k])
        for piece in range(3):
            start = first if piece == 0 else point[:, piece - 1]
            end = np.where(piece < count, point[:, min(piece, 1)], last)
            for kind, wanted in zip(kinds, (True, False), strict=True):
                use = (piece <= count) & ((inside ^ (piece % 2 == 1)) == wanted)
                if kind is not None and use.any():
                    ends = (start[use], end[use])
                    yield own[use], np.full(use.sum(), kind), *(ends[::-1] if reverse else ends)


def _meeting(one: _Chords, other: _Chords) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which chords cross (n, 2, 2), and the shares of both at which they do."""
    def between(turn):
        return (turn - one.start[:, :, None]) % 4.0 < ((one.end - one.start) % 4.0)[:, :, None]

    meets = one.exists[:, :, None] & other.exists[:, None] & \
        (between(other.start[:, None]) != between(other.end[:, None]))
    run, other_run = one.end_place - one.start_place, other.end_place - other.start_place
    apart = other.start_place[:, None] - one.start_place[:, :, None]
    spread = _cross(run[:, :, None], other_run[:, None])
    with np.errstate(invalid="ignore", divide="ignore"):
        shares = [np.nan_to_num(np.clip(_cross(apart, length) / spread, 0.0, 1.0), nan=0.5)
                  for length in (other_run[:, None], run[:, :, None])]
    return meets, *shares


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _with_contact_line(cell, patch, start, end, place):
    """The segments and those of the contact line within the cells, each of which borders on three patches.

    Any way to pair the points where the interface leaves the faces with those where it comes back closes the patches;
    the shortest is taken.
    """
    interface = patch == INTERFACE
    leaves, enters = (np.flatnonzero(interface & (code >= CONTACT)) for code in (end, start))
    leaves, enters = leaves[np.argsort(cell[leaves], kind="stable")], enters[np.argsort(cell[enters], kind="stable")]
    where, origin, target = cell[leaves], end[leaves], start[enters]
    _, first, count = np.unique(where, return_index=True, return_counts=True)
    for begin, number in zip(first[count > 1], count[count > 1], strict=True):
        some = slice(begin, begin + number)
        a, b = place[where[begin], origin[some]], place[where[begin], target[some]]
        target[some] = target[some][linear_sum_assignment(np.linalg.norm(a[:, None] - b, axis=2))[1]]
    # Two points of one face may be joined in the cell beyond it too: a point between them tells the lines apart.
    same = (origin - CONTACT) // 4 == (target - CONTACT) // 4
    between = BETWEEN + origin - CONTACT
    place[where, between] = 0.5 * (place[where, origin] + place[where, target])
    parts = [(where[~same], origin[~same], target[~same]), (where[same], origin[same], between[same]),
             (where[same], between[same], target[same])]
    where, origin, target = (np.concatenate(part) for part in zip(*parts, strict=True))
    kinds = np.repeat((INTERFACE, WALL, OTHER_WALL), len(where))
    return (np.concatenate([cell, where, where, where]), np.concatenate([patch, kinds]),
            np.concatenate([start, origin, target, origin]), np.concatenate([end, target, origin, target]))


def _triangles(cell, patch, start, end, place):
    """Triangles of the loops that the segments form: one for three segments, else a fan around the center."""
    base = (cell * 3 + patch) * CODES
    ends, link = np.unique(np.concatenate([base + start, base + end]), return_inverse=True)
    graph = coo_matrix((np.ones(len(cell), bool), (link[:len(cell)], link[len(cell):])), shape=(len(ends),) * 2)
    _, label = connected_components(graph, directed=False)
    loop = label[link[:len(cell)]]
    size = np.bincount(loop)
    simple = size[loop] == 3
    # The third corner of a triangle is what its first segment leaves of the sum of all.
    first = np.flatnonzero(simple)[np.unique(loop[simple], return_index=True)[1]]
    total = np.bincount(loop, start).astype(np.int64)
    third = total[loop[first]] - start[first] - end[first]
    fan = np.flatnonzero(~simple)
    number = np.cumsum(size != 3) - 1
    places = place[cell[fan], start[fan]]
    center = np.stack([np.bincount(number[loop[fan]], places[:, axis]) for axis in range(3)], axis=1) / \
        size[size != 3][:, None]
    of_cell = np.zeros(len(center), np.int64)
    of_cell[number[loop[fan]]] = cell[fan]
    chosen = np.concatenate([first, fan])
    apex = np.concatenate([third, CODES + number[loop[fan]]])
    return cell[chosen], patch[chosen], np.stack([start[chosen], end[chosen], apex], axis=1), of_cell, center
