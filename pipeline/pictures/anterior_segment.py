"""The eye as ophthalmologists draw it around a simulated cavity, for every kind of picture: a scheme for orientation.

Half outlines in a plane through the optic axis: heights z (m, anterior) and distances from the axis (m). Cornea and
lens have the lengths of Gullstrand's eye; the rest is drawn so that it looks right.
"""
import dataclasses

import numpy as np
from scipy.interpolate import splev, splprep

from pipeline.scenes.eye_shape import (
    ANTERIOR_LENGTH,
    CORNEA_THICKNESS,
    CORNEA_TO_GLOBE,
    LENS_EDGE,
    LENS_RADIUS,
    LENS_THICKNESS,
    shape_of,
)
from pipeline.scenes.eye_shape import CORNEA_RADIUS as CORNEA_BACK_RADIUS
from pipeline.scenes.model import Eye

RETINA_END, CHOROID_END, COATS = 0.22e-3, 0.42e-3, 0.9e-3      # outer sides of retina, choroid, sclera off the cavity
CORNEA_RADIUS = 7.8e-3                  # of its front
LENS_FRONT_RADIUS, LENS_ROUNDING = 10e-3, 1.1e-3
LIMBUS, ANGLE = 5.8e-3, 6.3e-3          # distances from the axis: end of the cornea, and the root of the iris
PUPIL, IMPLANT, IMPLANT_THICKNESS = 1.9e-3, 3.0e-3, 0.9e-3     # half widths; an artificial lens
# Of the ciliary body: where it begins at the front of the cavity; then distances from the axis, m, and shares of the
# way from there to the root of the iris. It goes on into the sclera, whose inner side bounds it.
CILIARY_EDGE, BEYOND = 6.2e-3, 20e-3
PROCESSES = ((5.75e-3, 0.30), (5.25e-3, 0.40), (5.75e-3, 0.50), (5.35e-3, 0.60), (5.8e-3, 0.69), (5.5e-3, 0.78),
             (6.0e-3, 0.90))


@dataclasses.dataclass(frozen=True)
class AnteriorSegment:
    """Lengths (m) of what lies before the cavity of one eye.

    Attributes
    ----------
    globe : half axes across and along the optic axis of the globe without buckle and staphyloma; the first may be an
        array (n,) of those in the planes of n points.
    lens : "phakic", "pseudophakic" or "aphakic".
    front : height of the plane that closes the cavity.
    filled : whether the liquids fill the anterior chamber too.
    pupil : its radius.
    """

    globe: tuple[float | np.ndarray, float]
    lens: str
    front: float
    filled: bool = False
    pupil: float = PUPIL

    @property
    def apex(self) -> float:
        """Height of the apex of the cornea."""
        return self.globe[1] + CORNEA_TO_GLOBE

    @property
    def lens_pole(self) -> float:
        """Height of the posterior pole of the own lens."""
        return self.apex - ANTERIOR_LENGTH

    @property
    def lens_middle(self) -> float:
        """Height at which its name is written: in the own lens, before an artificial one."""
        return self.lens_pole + 0.5 * LENS_THICKNESS if self.lens == "phakic" else self.front + 3.2e-3

    @property
    def root(self) -> float:
        """Height of the root of the iris, in the angle of the anterior chamber."""
        return _on_ball(ANGLE, self.apex - CORNEA_THICKNESS, CORNEA_BACK_RADIUS)

    @property
    def limbus(self) -> float:
        """Angle from the optic axis at which the cornea ends, rad."""
        return float(np.arctan2(LIMBUS, _on_ball(LIMBUS, self.apex, CORNEA_RADIUS)))

    def outside(self, angle: np.ndarray) -> np.ndarray:
        """Distance (n,) of cornea and sclera from the center of the globe, by the angle from the optic axis, rad."""
        end = np.array(self.limbus)
        thin = _ball(end, self.apex, CORNEA_RADIUS) - self._globe(end)
        grown = _step(angle, self.limbus, self.limbus + np.radians(35.0))
        return np.where(angle < self.limbus, _ball(angle, self.apex, CORNEA_RADIUS),
                        self._globe(angle) + (1.0 - grown) * thin + grown * COATS)

    def inside(self, angle: np.ndarray) -> np.ndarray:
        """The same of the inner side of cornea and sclera, which is the outer one of ciliary body and choroid."""
        corner = np.arctan2(ANGLE, self.root)
        back = _ball(np.minimum(angle, corner), self.apex - CORNEA_THICKNESS, CORNEA_BACK_RADIUS)
        turn = _step(angle, corner, corner + np.radians(14.0))
        thick = (1.0 - turn) * (self.outside(corner) - _ball(corner, self.apex - CORNEA_THICKNESS, CORNEA_BACK_RADIUS))
        return np.where(angle < corner, back, self.outside(angle) - thick - turn * (COATS - CHOROID_END))

    def lens_level(self, across: np.ndarray, height: np.ndarray) -> np.ndarray:
        """Negative in the own lens, which is round at its equator; about the distance in m."""
        front = np.hypot(across, height - (self.lens_pole + LENS_THICKNESS - LENS_FRONT_RADIUS)) - LENS_FRONT_RADIUS
        back = np.hypot(across, height - (self.lens_pole + LENS_RADIUS)) - LENS_RADIUS
        overlap = np.maximum(1.0 - np.abs(front - back) / LENS_ROUNDING, 0.0)
        return np.maximum(front, back) + 0.25 * LENS_ROUNDING * overlap**2

    def own_lens(self) -> tuple[np.ndarray, np.ndarray]:
        """Outline of the own lens, from its posterior pole to its anterior one."""
        turn, middle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 181), self.lens_pole + 0.5 * LENS_THICKNESS
        near, far = np.zeros_like(turn), np.full_like(turn, 1.2 * LENS_EDGE)
        for _ in range(40):
            reach = 0.5 * (near + far)
            beyond = self.lens_level(reach * np.cos(turn), middle + reach * np.sin(turn)) > 0.0
            near, far = np.where(beyond, near, reach), np.where(beyond, reach, far)
        return near * np.cos(turn), middle + near * np.sin(turn)

    def implant(self) -> tuple[np.ndarray, np.ndarray]:
        """Optic of an artificial lens before the cavity, biconvex and thin, from pole to pole."""
        turn = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 101)
        thick = np.sign(np.sin(turn)) * np.abs(np.sin(turn)) ** 1.3
        return IMPLANT * np.cos(turn), self.front + 0.7e-3 + 0.5 * IMPLANT_THICKNESS * thick

    def haptic(self) -> tuple[np.ndarray, np.ndarray]:
        """One of the arms that hold it in the bag of the lens."""
        return _through([IMPLANT - 0.1e-3, 3.9e-3, LENS_EDGE + 0.3e-3],
                        self.front + np.array([0.7e-3, 0.75e-3, 0.35e-3]))

    def bag(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """The capsule of a lens that was taken out: its back at the cavity, and the rim of its front."""
        edge = LENS_EDGE + 0.45e-3
        return [_through([0.0, 3.2e-3, edge], self.front + np.array([0.08e-3, 0.10e-3, 0.35e-3])),
                _through([edge, 4.2e-3, 2.4e-3], self.front + np.array([0.35e-3, 1.0e-3, 1.32e-3]))]

    @property
    def iris_plane(self) -> float:
        """Height of the back of the iris at the pupil: on the lens where there is one."""
        if self.lens == "phakic":
            return _on_ball(self.pupil, self.lens_pole + LENS_THICKNESS, LENS_FRONT_RADIUS) + 0.05e-3
        return max(self.front + (1.45e-3 if self.lens == "pseudophakic" else 0.05e-3), self.root - 0.2e-3)

    def iris(self) -> tuple[np.ndarray, np.ndarray]:
        """A leaf: its front from the thin root over its thickest part to the round edge of the pupil, and its back."""
        root, edge = self.root - 0.25e-3, self.iris_plane
        across = np.linspace(ANGLE + 0.4e-3, self.pupil, 60)
        share = (across - self.pupil) / np.ptp(across)       # 0 at the pupil, 1 at the root
        back = np.maximum(edge + (root - edge) * share**1.5, self.front + 0.05e-3)
        thick = 0.20e-3 + 0.30e-3 * np.sin(np.pi * np.clip(1.15 * share + 0.28, 0.0, 1.0)) ** 1.2
        thick = thick * np.sqrt(np.clip(share / 0.07, 0.0, 1.0))
        ends = 0.25e-3 * (1.0 - np.sqrt(np.clip(share / 0.07, 0.0, 1.0)))       # the edge is round
        return np.concatenate([across, across[::-1]]), np.concatenate([back + ends + thick, (back + ends)[::-1]])

    def processes(self) -> tuple[np.ndarray, np.ndarray]:
        """The side of the ciliary body toward the lens, from the front of the cavity to the root of the iris."""
        across, share = np.array(((CILIARY_EDGE, 0.0), *PROCESSES, (ANGLE, 1.0))).T
        return across, np.minimum(self.front + share * (self.root - self.front), self.root - 0.15e-3)

    def ciliary_body(self) -> tuple[np.ndarray, np.ndarray]:
        """A triangle behind the root of the iris, of which cavity and sclera leave what lies between them."""
        across, height = self.processes()
        if self.filled:
            across, height = np.array([ANGLE]), np.array([0.0])
        end = max(self.root, self.front + CHOROID_END)
        return (np.concatenate([[BEYOND, CILIARY_EDGE], across, [CILIARY_EDGE, BEYOND]]),
                np.concatenate([[0.0, 0.0], height, [end, end]]))

    def zonules(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Fibers from the processes to the capsule around the equator of the own lens."""
        equator = self.lens_pole + LENS_RADIUS - np.sqrt(LENS_RADIUS**2 - LENS_EDGE**2)
        ends = [(4.05e-3, 0.55e-3), (4.3e-3, 0.35e-3), (4.45e-3, 0.1e-3), (4.3e-3, -0.22e-3), (4.05e-3, -0.42e-3)]
        starts = np.linspace(0.75, 0.35, len(ends))
        return [(np.array([across, 5.6e-3]),
                 np.array([equator + 0.15e-3 + up, self.front + share * (self.root - self.front)]))
                for (across, up), share in zip(ends, starts, strict=True)]

    def _globe(self, angle: np.ndarray) -> np.ndarray:
        return 1.0 / np.hypot(np.sin(angle) / self.globe[0], np.cos(angle) / self.globe[1])


def anterior_segment(eye: Eye) -> AnteriorSegment | None:
    """Return what lies before the cavity of a scene's eye; None for a user's mesh, whose front is not known."""
    if eye.model != "parametric":
        return None
    shape = shape_of(eye)
    return AnteriorSegment((float(shape.half_axes[1]), float(shape.half_axes[2])), eye.lens, float(shape.front),
                           eye.anterior_chamber, shape.pupil or PUPIL)


def _on_ball(across: float, apex: float, radius: float) -> float:
    """Height of a ball's front at a distance from the axis."""
    return apex - radius + float(np.sqrt(radius**2 - across**2))


def _ball(angle: np.ndarray, apex: float, radius: float) -> np.ndarray:
    """Distance (n,) of a ball's front from the origin, by the angle from the axis, rad; NaN-free beyond its edge."""
    center = apex - radius
    return center * np.cos(angle) + np.sqrt(np.maximum(radius**2 - (center * np.sin(angle)) ** 2, 0.0))


def _step(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """From 0 to 1 between two values, smoothly."""
    share = np.clip((values - low) / (high - low), 0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)


def _through(across, height) -> tuple[np.ndarray, np.ndarray]:
    """A smooth line through points."""
    knots, _ = splprep([np.asarray(across), np.asarray(height)], s=0.0, k=min(3, len(across) - 1))
    return tuple(splev(np.linspace(0.0, 1.0, 120), knots))
