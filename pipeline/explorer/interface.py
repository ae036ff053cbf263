"""The free surface of a tamponade as points with normals, and how far from it other points are.

A table holds how deep the points of a lattice lie in the tamponade: the distance to its free surface, which goes on
straight beyond the contact line. Of neighboring shapes this depth is nearly linear, whatever point they are seen from.
"""
import dataclasses
import functools

import numpy as np
from scipy.spatial import cKDTree
from skimage.measure import marching_cubes

from pipeline.cavity.rays import interpolation
from pipeline.equilibrium.rest import Rest
from pipeline.equilibrium.star_cavity import StarCavity
from pipeline.scenes.retina import direction

SIZE = (17, 9, 12)      # points along the meridian that a tamponade goes to, to a side (mirror images), to the front
BEYOND = 1.02           # of the half width of the eye, that a lattice has
PIECES = 3              # of an edge of a triangle of the free surface: a point lies in the middle of each of its parts
NEAR = 1e-3             # m: of points that are nearer the distance along the normal counts


@dataclasses.dataclass(frozen=True)
class Lattice:
    """Points in and around an eye.

    Attributes
    ----------
    low, step : (3,), m, of the first point and between points: along the meridian, to the side, to the front.
    """

    low: np.ndarray
    step: np.ndarray

    @classmethod
    def of(cls, cavity: StarCavity) -> "Lattice":
        """Lay a lattice over a cavity."""
        wide, back, front = np.abs(cavity.wall[:, :2]).max(), cavity.wall[:, 2].min(), cavity.wall[:, 2].max()
        low, high = np.array([-wide, 0.0, back]) * BEYOND, np.array([wide, wide, front]) * BEYOND
        return cls(low, (high - low) / (np.array(SIZE) - 1))

    @functools.cached_property
    def points(self) -> np.ndarray:
        """Points, (*SIZE, 3), m."""
        return self.low + self.step * np.stack(np.meshgrid(*map(np.arange, SIZE), indexing="ij"), axis=-1)


@dataclasses.dataclass(frozen=True)
class Interface:
    """A free surface.

    Attributes
    ----------
    point : (n, 3), m. normal : (n, 3), unit vectors into the tamponade, or out of it.
    """

    point: np.ndarray
    normal: np.ndarray

    @classmethod
    def of(cls, rest: Rest, contact_angle: float) -> "Interface":
        """Read a shape at rest; near the wall, where its tension is blurred, it is straight up to the contact line."""
        cavity = rest.cavity
        distance = cavity.radius + np.tan(contact_angle) * rest.depth / cavity.slope
        free = cavity.faces[rest.depth[cavity.faces].min(axis=1) < 0.0]
        corner = (cavity.viewpoint + distance[:, None] * cavity.direction)[free]
        weight = _middles(PIECES)
        point, free_there = weight @ corner, weight @ rest.depth[free][..., None] < 0.0
        normal = np.cross(corner[:, 2] - corner[:, 0], corner[:, 1] - corner[:, 0])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
        return cls(point[free_there[..., 0]], np.repeat(normal[:, None], len(weight), axis=1)[free_there[..., 0]])

    @classmethod
    def drawn(cls, depth: np.ndarray, lattice: Lattice, meridian: float, wall: StarCavity) -> "Interface":
        """Find where the depth (*SIZE), m, of a lattice is zero within the wall, as the page draws it."""
        fine = functools.reduce(_finer, range(3), np.concatenate([depth[:, :0:-1], depth], axis=1))
        low = lattice.low - [0.0, (SIZE[1] - 1) * lattice.step[1], 0.0]
        corners, faces = marching_cubes(fine, 0.0, spacing=tuple(0.5 * lattice.step))[:2]
        corner = ((corners + low) @ across(meridian))[faces]
        point, normal = corner.mean(axis=1), np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        size, far = np.linalg.norm(normal, axis=1), np.linalg.norm(point, axis=1)
        three, weight = interpolation(wall.wall, wall.faces, point / far[:, None])
        inside = (far < np.linalg.norm((wall.wall[three] * weight[..., None]).sum(axis=1), axis=1)) & (size > 0.0)
        return cls(point[inside], normal[inside] / size[inside, None])

    def depth(self, points: np.ndarray) -> np.ndarray:
        """How deep points (..., 3) lie in the tamponade, (...), m; negative in the aqueous."""
        nearest = self._tree.query(points)[1]
        return ((points - self.point[nearest]) * self.normal[nearest]).sum(axis=-1)

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Distance of points (n, 3) to the surface, (n,), m."""
        far = self._tree.query(points)[0]
        return np.where(far < NEAR, np.abs(self.depth(points)), far)

    def apart(self, other: "Interface") -> tuple[float, float, float]:
        """Distance of two surfaces, m: on average, nine tenths of their points within, and of the farthest point."""
        found = np.concatenate([self.distance(other.point), other.distance(self.point)])
        return float(found.mean()), float(np.percentile(found, 90.0)), float(found.max())

    @functools.cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.point)


def across(meridian: float) -> np.ndarray:
    """Rows: toward the meridian, a quarter of a turn on from it, and to the front, (3, 3)."""
    return np.array([*direction(np.array([meridian, meridian + 90.0]), np.array([90.0, 90.0])), [0.0, 0.0, 1.0]])


def _middles(pieces: int) -> np.ndarray:
    """Weights of the corners of a triangle at the middles of its parts, (parts, 3)."""
    first, second = np.meshgrid(np.arange(pieces), np.arange(pieces), indexing="ij")
    upright, turned = first + second < pieces, first + second < pieces - 1
    found = np.concatenate([np.stack([first[kept] + share, second[kept] + share], axis=1)
                            for kept, share in ((upright, 1.0 / 3.0), (turned, 2.0 / 3.0))]) / pieces
    return np.column_stack([found, 1.0 - found.sum(axis=1)])


def _finer(field: np.ndarray, axis: int) -> np.ndarray:
    """A field with twice as many points along an axis, as smooth as cubics make it."""
    one = np.moveaxis(field, axis, 0)
    wide = np.concatenate([2.0 * one[:1] - one[1:2], one, 2.0 * one[-1:] - one[-2:-1]])
    fine = np.empty((2 * len(one) - 1, *one.shape[1:]))
    fine[::2], fine[1::2] = one, (9.0 * (wide[1:-2] + wide[2:-1]) - wide[:-3] - wide[3:]) / 16.0
    return np.moveaxis(fine, 0, axis)
