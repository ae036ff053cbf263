"""Levels of the parts of an opened eye: functions that are negative inside, near their surfaces about distances.

The cavity is the surface that was simulated. What lies around it is a scheme that no simulation knows, with the
lengths of the Gullstrand eye: layers of the wall, cornea, iris, ciliary body, zonular fibers, lens. A user's mesh has
no front: nobody knows where its cornea is. Lengths in mm; axes of the eye: x to the patient's left, y superior,
z anterior, origin in the center of the globe.
Equations: docs/methods/pictures.md.
"""
import dataclasses
from collections.abc import Callable

import numpy as np

from pipeline.cavity.signed_distance_grid import SignedDistance
from pipeline.scenes.eye_shape import LENS_EDGE, EyeShape
from pipeline.scenes.retina import ORA

MM = 1e3                                # mm in a m
RETINA, CHOROID, SCLERA = 0.26, 0.56, 1.15      # outer sides of the layers, mm off the cavity; thicker than life
FRONT_SCLERA = 0.5                      # the same of the sclera at the limbus, whose layers taper off
TAPER = (3.0, 9.0)                      # z, mm, between which they do
CORNEA_FRONT, CORNEA_BACK, CORNEA_THICKNESS = 7.8, 6.8, 0.5     # radii, mm
LIMBUS = 5.75                           # mm off the axis
LENS_FRONT, LENS_BACK, LENS_THICKNESS = 10.0, 6.0, 3.6
LENS_ROUND = 0.5                        # mm, over which the edge of the lens is rounded
IRIS_BEFORE_LENS = 1.55                 # mm, before the plane of the lens's equator
CILIARY_TIP, CILIARY_FRONT = 5.35, 1.9  # mm off the axis, and before the plane that closes the cavity in front
PROCESSES, PROCESS_HEIGHT = 70, 0.22    # of the ciliary body; mm
PUPIL = 2.0                             # mm, its radius where the scene gives none
ARTIFICIAL_RADIUS, ARTIFICIAL_THICKNESS = 3.0, 0.7

Level = Callable[[np.ndarray], np.ndarray]      # points (..., 3) in mm -> (...)


@dataclasses.dataclass(frozen=True)
class Anatomy:
    """An eye around the cavity of a scene.

    Attributes
    ----------
    cavity : signed distance to the surface of the simulation, m.
    shape : of a parametric eye; None of a user's mesh, which is drawn without a front.
    pupil : its radius, mm.
    """

    cavity: SignedDistance
    shape: EyeShape | None
    pupil: float = PUPIL

    def inside(self, points: np.ndarray) -> np.ndarray:
        """Level of the cavity."""
        flat = np.asarray(points, float).reshape(-1, 3)
        return MM * self.cavity.sample(flat / MM).reshape(np.shape(points)[:-1])

    def globe(self, points: np.ndarray) -> np.ndarray:
        """Level of the globe, whose wall goes on before the cavity up to the cornea."""
        return self.inside(points) if self.shape is None else MM * self.shape.globe(points / MM)

    def layer(self, points: np.ndarray, beyond: float) -> np.ndarray:
        """Level of all that lies within a depth of the wall, in mm outside the globe."""
        if self.shape is None:
            return self.globe(points) - beyond
        first, last = TAPER
        share = np.clip((points[..., 2] - first) / (last - first), 0.0, 1.0)
        share = share * share * (3.0 - 2.0 * share)
        return self.globe(points) - (1.0 - share) * beyond - share * FRONT_SCLERA * (beyond == SCLERA)

    def behind_ora(self, points: np.ndarray) -> np.ndarray:
        """Level of what lies behind the ora serrata."""
        radius = np.maximum(np.linalg.norm(points, axis=-1), 1e-9)
        return radius * (np.arccos(np.clip(-points[..., 2] / radius, -1.0, 1.0)) - np.radians(ORA))

    @property
    def apex(self) -> float:
        """Height z of the front of the cornea, mm."""
        from pipeline.scenes.eye_shape import CORNEA_TO_GLOBE

        assert self.shape is not None
        return MM * (float(self.shape.half_axes[2]) + CORNEA_TO_GLOBE)

    @property
    def front(self) -> float:
        """Height z of the plane of the lens's equator, mm; without a lens it would be there."""
        assert self.shape is not None
        return MM * self.shape.front - (IRIS_BEFORE_LENS if self.without_lens else 0.0)

    @property
    def without_lens(self) -> bool:
        """Whether the eye has neither lens."""
        assert self.shape is not None
        return self.shape.lens_pole is None and not self.shape.artificial_lens

    def cornea_front(self, points: np.ndarray) -> np.ndarray:
        """Level of the ball whose surface is the front of the cornea."""
        return np.linalg.norm(points - [0.0, 0.0, self.apex - CORNEA_FRONT], axis=-1) - CORNEA_FRONT

    def cornea_back(self, points: np.ndarray) -> np.ndarray:
        """Level of the ball whose surface is the back of the cornea."""
        return np.linalg.norm(points - [0.0, 0.0, self.apex - CORNEA_THICKNESS - CORNEA_BACK], axis=-1) - CORNEA_BACK

    def before_limbus(self, points: np.ndarray) -> np.ndarray:
        """Level of what lies before the limbus, on a cone that is steep to the wall."""
        height = self.apex - CORNEA_FRONT + np.sqrt(CORNEA_FRONT**2 - LIMBUS**2)
        return height - points[..., 2] + 0.6 * (np.hypot(points[..., 0], points[..., 1]) - LIMBUS)

    def cornea(self, points: np.ndarray) -> np.ndarray:
        """Level of the cornea."""
        return _all(self.cornea_front(points), -self.cornea_back(points), self.before_limbus(points))

    def outside(self, points: np.ndarray) -> np.ndarray:
        """Level of all that sclera and cornea enclose."""
        outer = self.layer(points, SCLERA)
        return outer if self.shape is None else np.minimum(outer, self.cornea_front(points))

    def sclera(self, points: np.ndarray) -> np.ndarray:
        """Level of the sclera."""
        if self.shape is None:
            return _all(self.outside(points), -self.layer(points, CHOROID))
        within = np.minimum(self.layer(points, CHOROID), self.cornea_back(points))
        return _all(self.outside(points), -within, -self.before_limbus(points))

    def choroid(self, points: np.ndarray) -> np.ndarray:
        """Level of the choroid, which ends where the ciliary body begins."""
        return _all(self.layer(points, CHOROID), -self.retina(points), -self.globe(points), -self.inside(points),
                    -self.ciliary(points), *([] if self.shape is None else [points[..., 2] - self.front]))

    def retina(self, points: np.ndarray) -> np.ndarray:
        """Level of the retina."""
        return _all(self.layer(points, RETINA), -self.inside(points), self.behind_ora(points))

    def lens(self, points: np.ndarray) -> np.ndarray:
        """Level of the lens, or of the artificial one; everywhere positive where there is none."""
        if self.shape is None or self.without_lens:
            return np.full(np.shape(points)[:-1], 1.0)
        if self.shape.artificial_lens:
            height = points[..., 2] - self.front - 0.5 * ARTIFICIAL_THICKNESS - 0.1
            return np.sqrt((np.hypot(points[..., 0], points[..., 1]) / ARTIFICIAL_RADIUS) ** 2
                           + (height / (0.5 * ARTIFICIAL_THICKNESS)) ** 2 + 1e-12) - 1.0
        pole = MM * self.shape.lens_pole
        back = np.linalg.norm(points - [0.0, 0.0, pole + LENS_BACK], axis=-1) - LENS_BACK
        front = np.linalg.norm(points - [0.0, 0.0, pole + LENS_THICKNESS - LENS_FRONT], axis=-1) - LENS_FRONT
        overlap = np.maximum(1.0 - np.abs(back - front) / LENS_ROUND, 0.0)
        return np.maximum(_all(back, front) + 0.25 * LENS_ROUND * overlap**2, -self.inside(points))

    def pane(self, points: np.ndarray) -> np.ndarray:
        """Level of the part of the cavity's wall that is clear: the lens, without one the pupil, or the cornea."""
        before = 0.5 * self.front - points[..., 2]
        if self.shape is not None and self.shape.cornea is not None:
            return _all(self.front + 1.6 - points[..., 2], before)      # the iris stays
        edge = self.pupil if self.without_lens else MM * LENS_EDGE
        return _all(np.hypot(points[..., 0], points[..., 1]) - edge, before)

    def ciliary(self, points: np.ndarray, processes: bool = False) -> np.ndarray:
        """Level of the ciliary body, with its processes where these are asked for."""
        if self.shape is None:
            return np.full(np.shape(points)[:-1], 1.0)
        outward, height = np.hypot(points[..., 0], points[..., 1]), points[..., 2]
        within = _all(self.layer(points, CHOROID), -self.inside(points), -self.behind_ora(points))
        corners = np.array([[20.0, -6.0], [CILIARY_TIP + 2.6, -6.0], [CILIARY_TIP + 2.4, -0.3], [CILIARY_TIP, 0.0],
                            [CILIARY_TIP + 0.1, 0.9], [CILIARY_TIP + 0.9, CILIARY_FRONT], [20.0, CILIARY_FRONT + 1.2]])
        shape = polygon_level(np.stack([outward, height - self.front], axis=-1), corners)
        if processes:
            around = np.arctan2(points[..., 1], points[..., 0])
            low = np.clip(CILIARY_FRONT - 0.7 - (height - self.front), 0.0, 1.0)     # none where the iris begins
            shape = shape - PROCESS_HEIGHT * np.cos(PROCESSES * around) * low * (outward < CILIARY_TIP + 2.5)
        return _all(shape, within)

    def iris(self, points: np.ndarray) -> np.ndarray:
        """Level of the iris: a leaf from its root at the ciliary body to the edge of the pupil."""
        if self.shape is None:
            return np.full(np.shape(points)[:-1], 1.0)
        outward = np.hypot(points[..., 0], points[..., 1])
        if self.shape.cornea is not None:
            body = -MM * self.shape.iris(points / MM)
            return _all(body, self.layer(points, CHOROID), -self.inside(points))
        leaf = np.array([[6.4, 1.75], [4.6, 1.42], [3.0, 1.42], [self.pupil + 0.1, 1.5], [self.pupil, 1.65],
                         [self.pupil + 0.25, 1.86], [3.2, 1.96], [4.6, 1.92], [5.6, 1.9], [6.4, 2.05]])
        level = polygon_level(np.stack([outward, points[..., 2] - self.front], axis=-1), leaf)
        return _all(level, self.layer(points, CHOROID), self.cornea_back(points), -self.inside(points))


def polygon_level(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Signed distance (...) of points (..., 2) to a closed polygon (k, 2), negative inside."""
    nearest = np.full(points.shape[:-1], np.inf)
    inside = np.zeros(points.shape[:-1], bool)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = end - start
        place = np.clip((points - start) @ along / (along @ along), 0.0, 1.0)
        nearest = np.minimum(nearest, np.linalg.norm(points - start - place[..., None] * along, axis=-1))
        crosses = (start[1] > points[..., 1]) != (end[1] > points[..., 1])
        if along[1]:
            inside ^= crosses & (points[..., 0] < start[0] + (points[..., 1] - start[1]) * along[0] / along[1])
    return np.where(inside, -nearest, nearest)


def _all(*levels: np.ndarray) -> np.ndarray:
    """Level of what lies in all of several bodies."""
    return np.maximum.reduce(levels)  # (Z4)
