"""Levels of the parts of an opened eye: functions that are negative inside, near their surfaces about distances.

The cavity is the surface that was simulated. What lies around it is a scheme that no simulation knows: the outlines of
``AnteriorSegment``, turned about the optic axis. A user's mesh has no front: nobody knows where its cornea is. Lengths
in mm; axes of the eye: x to the patient's left, y superior, z anterior, origin in the center of the globe.
Equations: docs/methods/pictures.md.
"""
import dataclasses
from collections.abc import Callable

import numpy as np

from pipeline.cavity.signed_distance_grid import SignedDistance
from pipeline.pictures.anterior_segment import (
    ANGLE,
    CHOROID_END,
    CILIARY_EDGE,
    COATS,
    RETINA_END,
    AnteriorSegment,
    anterior_segment,
)
from pipeline.scenes.eye_shape import EyeShape, shape_of
from pipeline.scenes.model import Eye
from pipeline.scenes.retina import ORA

MM = 1e3                                # mm in a m
ON_CORNEA = 0.15                        # mm: where liquids fill the eye up to the cornea, the wall is clear so near it
NEAR = 0.5                              # mm: farther from the box around an outline, its distance is not asked for

Level = Callable[[np.ndarray], np.ndarray]      # points (..., 3) in mm -> (...)


@dataclasses.dataclass(frozen=True)
class Anatomy:
    """An eye around the cavity of a scene.

    Attributes
    ----------
    cavity : signed distance to the surface of the simulation, m.
    shape : of a parametric eye; None of a user's mesh, which is drawn without a front.
    segment : what lies before the cavity of a parametric eye.
    """

    cavity: SignedDistance
    shape: EyeShape | None = None
    segment: AnteriorSegment | None = None

    def inside(self, points: np.ndarray) -> np.ndarray:
        """Level of the cavity."""
        flat = np.asarray(points, float).reshape(-1, 3)
        return MM * self.cavity.sample(flat / MM).reshape(np.shape(points)[:-1])

    def globe(self, points: np.ndarray) -> np.ndarray:
        """Level of the globe, whose wall goes on before the cavity up to the cornea."""
        return self.inside(points) if self.shape is None else MM * self.shape.globe(points / MM)

    def outside(self, points: np.ndarray) -> np.ndarray:
        """Level of all that sclera and cornea enclose, with them."""
        return self._within(points, AnteriorSegment.outside, COATS)

    def enclosed(self, points: np.ndarray) -> np.ndarray:
        """Level of all that sclera and cornea enclose, without them; the cavity keeps its coat everywhere."""
        within = self._within(points, AnteriorSegment.inside, CHOROID_END)
        if self.segment is None:
            return within
        across, height = in_meridian(points)
        coat = _all(self.inside(points) - MM * CHOROID_END,
                    np.minimum(height - MM * self.segment.front, MM * CILIARY_EDGE - across))
        return np.minimum(within, coat)

    def _within(self, points: np.ndarray, reach: Callable, beyond: float) -> np.ndarray:
        """Level of what lies within a reach (m) of the center of the globe, or so far (m) beyond the wall of a mesh."""
        if self.shape is None or self.segment is None:
            return self.globe(points) - MM * beyond
        x, y, z = np.moveaxis(points / MM, -1, 0)
        across = np.maximum(np.hypot(x, y), 1e-9)
        half = across / np.hypot(x / self.shape.half_axes[0], y / self.shape.half_axes[1]).clip(1e-9)
        meridian = dataclasses.replace(self.segment, globe=(half, self.segment.globe[1]))
        return MM * (np.hypot(across, z) - reach(meridian, np.arctan2(across, z))
                     + self.shape.indentation(points / MM))

    def behind_ora(self, points: np.ndarray) -> np.ndarray:
        """Level of what lies behind the ora serrata."""
        radius = np.maximum(np.linalg.norm(points, axis=-1), 1e-9)
        return radius * (np.arccos(np.clip(-points[..., 2] / radius, -1.0, 1.0)) - np.radians(ORA))

    def before_limbus(self, points: np.ndarray) -> np.ndarray:
        """Level of what lies before the limbus; nothing of a user's mesh does."""
        if self.segment is None:
            return _nowhere(points)
        across, height = in_meridian(points)
        return np.hypot(across, height) * (np.arctan2(across, height) - self.segment.limbus)

    def cornea(self, points: np.ndarray) -> np.ndarray:
        """Level of the cornea."""
        return _all(self.outside(points), -self.enclosed(points), self.before_limbus(points))

    def sclera(self, points: np.ndarray) -> np.ndarray:
        """Level of the sclera."""
        return _all(self.outside(points), -self.enclosed(points), -self.before_limbus(points))

    def choroid(self, points: np.ndarray) -> np.ndarray:
        """Level of the choroid, which goes over into the ciliary body."""
        return _all(self.enclosed(points), -self.retina(points), -self.inside(points),
                    *([] if self.shape is None else [self.behind_ora(points)]))

    def retina(self, points: np.ndarray) -> np.ndarray:
        """Level of the retina."""
        return _all(self.globe(points) - MM * RETINA_END, -self.inside(points), self.behind_ora(points))

    def lens(self, points: np.ndarray) -> np.ndarray:
        """Level of the lens, or of the artificial one; everywhere positive where there is none."""
        outline = self.lens_outline()
        if outline is None:
            return _nowhere(points)
        whole = np.concatenate([outline, outline[::-1] * [-1.0, 1.0]])      # beyond the axis too
        return _all(turned(points, whole), -self.inside(points))

    def lens_outline(self) -> np.ndarray | None:
        """Outline (n, 2) of the lens or the artificial one from pole to pole: distance from the axis and height, mm."""
        if self.segment is None or self.segment.lens == "aphakic":
            return None
        return in_mm(self.segment.own_lens() if self.segment.lens == "phakic" else self.segment.implant())

    def pane(self, points: np.ndarray) -> np.ndarray:
        """Level of the part of the cavity's wall that is clear, up to the ciliary body, or that is the iris."""
        assert self.shape is not None
        edge = ANGLE if self.shape.cornea is not None else CILIARY_EDGE - 0.2e-3
        return _all(np.hypot(points[..., 0], points[..., 1]) - MM * edge, 0.5 * MM * self.shape.front - points[..., 2])

    def on_cornea(self, points: np.ndarray) -> np.ndarray:
        """Level of the part of the cavity's wall that is the cornea, where liquids fill the eye up to there."""
        assert self.shape is not None
        return -MM * self.shape.chamber(points / MM) - ON_CORNEA

    def ciliary(self, points: np.ndarray) -> np.ndarray:
        """Level of the ciliary body and what goes on from it to the ora serrata."""
        if self.segment is None:
            return _nowhere(points)
        return _all(turned(points, in_mm(self.segment.ciliary_body())), self.enclosed(points), -self.inside(points),
                    -self.behind_ora(points), -self.iris(points))

    def iris(self, points: np.ndarray) -> np.ndarray:
        """Level of the iris."""
        if self.shape is None or self.segment is None:
            return _nowhere(points)
        if self.segment.filled:
            body = _all(-MM * self.shape.iris(points / MM), in_meridian(points)[0] - MM * ANGLE)
        else:
            body = turned(points, in_mm(self.segment.iris()))
        return _all(body, self.enclosed(points), -self.inside(points))


def anatomy_of(eye: Eye, cavity: SignedDistance) -> Anatomy:
    """The eye around the cavity of a scene."""
    return Anatomy(cavity, shape_of(eye) if eye.model == "parametric" else None, anterior_segment(eye))


def in_mm(outline: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Points (n, 2), mm, of an outline of ``AnteriorSegment``."""
    return MM * np.stack(outline, axis=-1)


def in_meridian(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances (...) of points (..., 3) from the optic axis, and their heights."""
    return np.hypot(points[..., 0], points[..., 1]), points[..., 2]


def turned(points: np.ndarray, outline: np.ndarray) -> np.ndarray:
    """Level (...) of what an outline (n, 2) encloses that turns about the optic axis; far from it only a bound."""
    place = np.stack(in_meridian(points), axis=-1)
    low, high = outline.min(axis=0), outline.max(axis=0)
    level = np.linalg.norm(np.maximum(np.maximum(low - place, place - high), 0.0), axis=-1)
    near = level < NEAR
    level[near] = polygon_level(place[near], outline)
    return level


def polygon_level(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Signed distance (...) of points (..., 2) to a closed polygon (k, 2), negative inside."""
    nearest = np.full(points.shape[:-1], np.inf)
    inside = np.zeros(points.shape[:-1], bool)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = end - start
        place = np.clip((points - start) @ along / max(along @ along, 1e-18), 0.0, 1.0)
        nearest = np.minimum(nearest, np.linalg.norm(points - start - place[..., None] * along, axis=-1))
        crosses = (start[1] > points[..., 1]) != (end[1] > points[..., 1])
        if along[1]:
            inside ^= crosses & (points[..., 0] < start[0] + (points[..., 1] - start[1]) * along[0] / along[1])
    return np.where(inside, -nearest, nearest)


def _nowhere(points: np.ndarray) -> np.ndarray:
    return np.full(np.shape(points)[:-1], 1.0)


def _all(*levels: np.ndarray) -> np.ndarray:
    """Level of what lies in all of several bodies."""
    return np.maximum.reduce(levels)  # (Z4)
