"""A cavity as a point that sees its whole wall, and the distance to the wall in many directions.

Equations: docs/methods/equilibrium.md.
"""
import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from pipeline.base.errors import UserError
from pipeline.cavity.signed_distance_grid import distance_of_mesh
from pipeline.cavity.surface import cavity_mesh
from pipeline.scenes.eye_shape import shape_of
from pipeline.scenes.model import Eye

if TYPE_CHECKING:
    import trimesh

COARSE, DRAFT, FINE = 3, 4, 5   # cuts of an icosahedron: 642, 2,562 and 10,242 directions; edges of 1.7, 0.8, 0.4 mm
FARTHEST = 45e-3                # m: no wall of an eye is so far from a point in it
HALVINGS, SIGHTINGS = 45, 300   # of the bisection; points looked at along every ray
SMALLEST_COSINE = 0.05          # between the ray and the normal of the wall: below, a shape cannot be told
CELL = 0.2e-3                   # m, of the signed distance of a user's mesh
VIEWPOINTS = np.linspace(-0.6, 0.2, 9)  # tried along the optic axis, over the half length of the cavity
STEEP_ENOUGH = 0.35             # cosine, of a viewpoint near the front

Level = Callable[[np.ndarray], np.ndarray]


@dataclasses.dataclass(frozen=True)
class StarCavity:
    """Wall of a cavity along rays from a viewpoint.

    Attributes
    ----------
    viewpoint : (3,), m; in the frame of the eye, whose origin is the center of the globe.
    direction : (n, 3), unit vectors; those of a coarser cavity come first.
    faces : (m, 3) int, triangles of neighboring directions, counterclockwise from outside.
    radius : (n,), m, distance to the wall.
    slope : (n,), cosine between the ray and the normal of the wall.
    whole : m3, volume of the cavity where it was taken from another viewpoint, since this one may not see all of it.
    reach : m, how far from the viewpoint the oil may be: only there the triangles need to be fine.
    """

    viewpoint: np.ndarray
    direction: np.ndarray
    faces: np.ndarray
    radius: np.ndarray
    slope: np.ndarray
    whole: float | None = None
    reach: float = np.inf

    @classmethod
    def of_level(cls, level: Level, viewpoint, cuts: int = DRAFT, *, partly: bool = False) -> "StarCavity":
        """Find the wall of a function of points (..., 3) in m, negative inside and near the wall about the distance.

        Parameters
        ----------
        partly : some of the wall may lie behind other parts of it.

        Raises
        ------
        UserError : the viewpoint does not see the whole wall, or is not in the cavity.
        """
        viewpoint = np.asarray(viewpoint, float)
        direction, faces = icosphere(cuts)
        reach = np.linspace(0.0, FARTHEST, SIGHTINGS)[1:]
        outside = np.stack([level(viewpoint + one * direction) > 0.0 for one in reach], axis=1)
        hidden = not partly and (np.diff(outside.astype(int), axis=1) < 0).any()
        if hidden or not outside[:, -1].all() or outside[:, 0].any():
            raise UserError("eye: oil at rest can only be found in a cavity whose whole wall is seen from one point, "
                            f"but {np.round(1e3 * viewpoint, 1).tolist()} mm does not see all of it")
        far = reach[outside.argmax(axis=1)]
        near = far - reach[0]
        for _ in range(HALVINGS):
            middle = 0.5 * (near + far)
            beyond = level(viewpoint + middle[:, None] * direction) > 0.0
            near, far = np.where(beyond, near, middle), np.where(beyond, middle, far)
        wall = viewpoint + near[:, None] * direction
        steps = 1e-3 * near.mean() * np.eye(3)
        gradient = np.stack([level(wall + step) - level(wall - step) for step in steps], axis=-1)
        slope = (gradient * direction).sum(axis=1) / np.linalg.norm(gradient, axis=1)
        return cls(viewpoint, direction, faces, near, np.maximum(slope, SMALLEST_COSINE))

    @property
    def cuts(self) -> int:
        """Cuts of the icosahedron."""
        return round(np.log2(0.1 * (len(self.radius) - 2)) / 2.0)

    @functools.cached_property
    def wall(self) -> np.ndarray:
        """Points of the wall, (n, 3), m."""
        return self.viewpoint + self.radius[:, None] * self.direction

    @functools.cached_property
    def face_area(self) -> np.ndarray:
        """Area of the triangles of the wall, (m,), m2."""
        a, b, c = np.moveaxis(self.wall[self.faces], 1, 0)
        return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)

    @functools.cached_property
    def solid(self) -> np.ndarray:
        """Six times the volume of the tetrahedron between the viewpoint and three unit vectors, (m,)."""
        a, b, c = np.moveaxis(self.direction[self.faces], 1, 0)
        return (a * np.cross(b, c)).sum(axis=1)

    @functools.cached_property
    def volume(self) -> float:
        """Volume between the triangles of the wall, m3."""
        return float(self.solid @ self.radius[self.faces].prod(axis=1)) / 6.0

    @functools.cached_property
    def edge(self) -> float:
        """Length of the edge of a triangle of the wall within reach, on the average, m."""
        near = self.radius[self.faces].max(axis=1) < self.reach
        return float(np.sqrt(4.0 / np.sqrt(3.0) * self.face_area[near if near.any() else ...].mean()))


def levels_of(eye: Eye) -> tuple[Level, np.ndarray]:
    """Return what is negative in the cavity of an eye, a function of points (..., 3) in m, and its bounds (2, 3), m.

    Raises
    ------
    UserError : the user's mesh cannot be used.
    """
    if eye.model == "parametric":
        shape = shape_of(eye)
        front = shape.front if shape.lens_pole is None else shape.lens_pole
        return shape.level, np.array([-shape.half_axes, [*shape.half_axes[:2], front]])
    mesh = cavity_mesh(eye)[0]
    distance = distance_of_mesh(mesh, CELL, 5.0 * CELL)
    return (lambda points: distance.sample(points.reshape(-1, 3)).reshape(points.shape[:-1])), mesh.bounds


def cavity_of(eye: Eye, cuts: int = DRAFT) -> StarCavity:
    """Return the cavity of an eye, seen from the point of its axis that meets the wall least aslant.

    Raises
    ------
    UserError : the user's mesh cannot be used, or no point sees its whole wall.
    """
    levels = levels_of(eye)
    return StarCavity.of_level(levels[0], viewpoint_of(eye, levels), cuts)


def viewpoint_of(eye: Eye, levels: tuple[Level, np.ndarray], *, from_front: bool = False) -> np.ndarray:
    """Return the point (3,), m, of the axis that meets the wall least aslant.

    An anterior chamber is seen through the pupil only, and a user's mesh from deepest behind all of its triangles.

    Parameters
    ----------
    levels : of ``levels_of``.
    from_front : the foremost point that does not meet the wall too aslant: what lies in the front has it within.

    Raises
    ------
    UserError : no point sees the whole wall.
    """
    level, (low, high) = levels
    best, refusal = None, None
    for viewpoint in _viewpoints(eye, 0.5 * (high[2] - low[2])):
        try:
            found = StarCavity.of_level(level, viewpoint, COARSE)
        except UserError as error:
            refusal = error
            continue
        if best is None or found.slope.min() > best.slope.min() or (from_front and found.slope.min() > STEEP_ENOUGH):
            best = found
    if best is None:
        raise refusal
    return best.viewpoint


def _viewpoints(eye: Eye, half: float) -> Sequence:
    """Points to look from, m."""
    if eye.model == "parametric" and eye.anterior_chamber:
        return [[0.0, 0.0, shape_of(eye).front]]
    if eye.model == "mesh" and (seeing := seeing_all(cavity_mesh(eye)[0])) is not None:
        return [seeing]
    return [[0.0, 0.0, share * half] for share in VIEWPOINTS]


def seeing_all(mesh: "trimesh.Trimesh") -> np.ndarray | None:
    """Return the point (3,), m, deepest behind the planes of all triangles; None where no point is behind all."""
    from scipy.optimize import linprog

    normal, center = mesh.face_normals, mesh.triangles_center
    behind = np.column_stack([normal, np.ones(len(normal))])
    found = linprog([0.0, 0.0, 0.0, -1.0], A_ub=behind, b_ub=(normal * center).sum(axis=1), bounds=(None, None))
    return found.x[:3] if found.x[3] > 0.0 else None


@functools.cache
def icosphere(cuts: int) -> tuple[np.ndarray, np.ndarray]:
    """Directions (n, 3) and triangles (m, 3) of an icosahedron whose triangles were cut in four so many times.

    The directions of fewer cuts come first: the middle of every edge is added behind them (``parents``).
    """
    if cuts == 0:
        golden = 0.5 * (1.0 + np.sqrt(5.0))
        corners = np.array([[-1, golden, 0], [1, golden, 0], [-1, -golden, 0], [1, -golden, 0],
                            [0, -1, golden], [0, 1, golden], [0, -1, -golden], [0, 1, -golden],
                            [golden, 0, -1], [golden, 0, 1], [-golden, 0, -1], [-golden, 0, 1]])
        faces = np.array([[0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4],
                          [11, 10, 2], [10, 7, 6], [7, 1, 8], [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9],
                          [4, 9, 5], [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1]])
        return corners / np.linalg.norm(corners, axis=1, keepdims=True), faces
    points, faces = icosphere(cuts - 1)
    edges, number = _edges(faces)
    middle = points[edges].sum(axis=1)
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    ab, bc, ca = len(points) + number.reshape(3, -1)
    a, b, c = faces.T
    cut = [np.stack(corners, axis=1) for corners in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))]
    return np.concatenate([points, middle]), np.concatenate(cut)


def parents(cuts: int) -> np.ndarray:
    """Directions of one cut less, (k, 2) int, between which the last k directions of ``icosphere`` lie."""
    return _edges(icosphere(cuts - 1)[1])[0]


def _edges(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edges (k, 2) of triangles, and which of them the first, second and third edges of the triangles are, (3 m,)."""
    each = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    edges, number = np.unique(each, axis=0, return_inverse=True)
    return edges, number.ravel()
