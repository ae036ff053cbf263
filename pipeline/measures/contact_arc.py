"""The arc of the wall that the oil touches in one plane, from the particles along the wall.

Where the interface leaves the wall at the contact angle, a particle beside the contact line is oil as long as it lies
deeper than the wedge of the other liquid is thick there. Points of the wall by themselves are a particle spacing apart,
which is 5 to 10 degrees; many particles at many depths, each moved back to where the wedge is as thick as it lies deep,
tell the line better than any one of them.
Equations: docs/methods/measures.md.
"""
import dataclasses

import numpy as np

from pipeline.cavity.signed_distance_grid import SignedDistance

SLAB, DEEP, REACH = 1.5, 1.2, 4.0   # particle spacings: off the plane, below the wall, from the contact line along it
SMOOTH = 2.5                        # particle spacings along the wall, over which labels are averaged for a first guess
RAYS, HALVINGS = 720, 30            # that find the wall in the plane


@dataclasses.dataclass(frozen=True)
class PlaneWall:
    """The wall in a plane, as a closed curve around the origin.

    Attributes
    ----------
    angle : (RAYS + 1,), rad, from -pi to pi.
    radius, way : (RAYS + 1,), m, from the origin, and along the wall.
    """

    angle: np.ndarray
    radius: np.ndarray
    way: np.ndarray

    @classmethod
    def of(cls, distance: SignedDistance) -> "PlaneWall":
        """Find the wall in the sagittal plane."""
        angle = np.linspace(-np.pi, np.pi, RAYS + 1)
        ray = np.stack([np.zeros_like(angle), np.sin(angle), np.cos(angle)], axis=1)
        low = np.zeros(len(ray))
        high = np.full(len(ray), distance.cell * np.linalg.norm(distance.values.shape))
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            outside = distance.sample(middle[:, None] * ray) > 0.0
            low, high = np.where(outside, low, middle), np.where(outside, middle, high)
        point = low[:, None] * ray
        return cls(angle, low, np.append(0.0, np.cumsum(np.linalg.norm(np.diff(point, axis=0), axis=1))))

    def bend(self, place: float, reach: float) -> float:
        """How the wall bends away from a ball as large as the cavity, 1/m, within `reach` of a place."""
        around = place + np.linspace(-reach, reach, 3)
        angle = np.interp(around % self.way[-1], self.way, self.angle)
        radius = np.interp(around % self.way[-1], self.way, self.radius)
        y, z = radius * np.sin(angle), radius * np.cos(angle)
        turn = np.diff(np.arctan2(np.diff(y), np.diff(z)))[0]
        return float(1.0 / self.radius.mean() - ((turn + np.pi) % (2.0 * np.pi) - np.pi) / reach)

    def apart(self, way: np.ndarray) -> np.ndarray:
        """Difference of two ways around the closed wall, m, the short way."""
        whole = self.way[-1]
        return (way + 0.5 * whole) % whole - 0.5 * whole


def contact_arc(distance: SignedDistance, position: np.ndarray, oil: np.ndarray, spacing: float,
                contact_angle: float | None) -> float:
    """Return the covered arc in the sagittal plane, in degrees around the origin.

    Parameters
    ----------
    distance : to the wall.
    position, oil : (n, 3) in m and (n,) bool, the fluid, and which of it is mostly oil.
    spacing : of the particles, m.
    contact_angle : rad, through the other liquid; None where the scene has none: the labels along the wall count then.
    """
    near = np.abs(position[:, 0]) < SLAB * spacing
    position, oil = position[near], oil[near]
    depth = -distance.sample(position) if len(position) else np.zeros(0)
    near = depth < DEEP * spacing
    if not near.any():
        return 0.0
    position, oil, depth = position[near], oil[near], depth[near]
    foot = (position + depth[:, None] * distance.normal(position))[:, 1:]
    wall, angle = PlaneWall.of(distance), np.arctan2(foot[:, 0], foot[:, 1])
    order = np.argsort(angle)
    way, oil, depth = np.interp(angle[order], wall.angle, wall.way), oil[order], depth[order]
    ends = _ends(wall, way, oil, depth, spacing, contact_angle)
    if not ends:
        return 360.0 * float(np.mean(oil) > 0.5)
    arc = sum(side * np.interp(place % wall.way[-1], wall.way, wall.angle) for place, side in ends)
    return float(np.degrees(arc) % 360.0)


def _ends(wall: PlaneWall, way: np.ndarray, oil: np.ndarray, depth: np.ndarray, spacing: float,
          contact_angle: float | None) -> list[tuple[float, int]]:
    """Where the oil begins (-1) and ends (+1) along the wall: places, m, one behind the other, in turn."""
    weight = np.maximum(0.0, 1.0 - np.abs(wall.apart(way[:, None] - way)) / (SMOOTH * spacing))
    inside = (weight @ oil) / weight.sum(axis=1) > 0.5
    changes = np.flatnonzero(inside != np.roll(inside, 1))
    guesses = [way[here] - 0.5 * wall.apart(way[here] - way[here - 1]) for here in changes]
    found = []
    for here, guess in zip(changes, guesses, strict=True):
        side = -1 if inside[here] else 1
        others = [0.5 * float(np.abs(wall.apart(guess - other))) for other in guesses if other != guess]
        reach = min([REACH * spacing, *others])
        beyond = side * wall.apart(way - guess)
        near = np.abs(beyond) < reach
        back = 0.0 if contact_angle is None else np.minimum(
            _width(depth[near], contact_angle, wall.bend(guess, SMOOTH * spacing)), REACH * spacing)
        found.append((guess + side * _between(beyond[near] - back, oil[near], reach), side))
    return found


def _width(depth: np.ndarray, contact_angle: float, bend: float) -> np.ndarray:
    """Width of the wedge, m, up to where it is so thick (k,): s tan(theta) + bend s^2 / 2. (Q15)"""
    slope = np.tan(max(contact_angle, 1e-6))
    return 2.0 * depth / (slope + np.sqrt(slope**2 + 2.0 * max(bend, 0.0) * np.maximum(depth, 0.0)))


def _between(place: np.ndarray, oil: np.ndarray, reach: float) -> float:
    """The place before which there is oil and behind which there is none, with the least that contradicts it."""
    if not len(place):
        return 0.0
    rows = np.sort(place)
    tried = np.concatenate([rows[:1], 0.5 * (rows[1:] + rows[:-1]), rows[-1:]])
    wrong = (np.maximum(place[oil] - tried[:, None], 0.0).sum(axis=1)
             + np.maximum(tried[:, None] - place[~oil], 0.0).sum(axis=1))
    return float(np.clip(tried[wrong <= wrong.min() + 1e-12].mean(), -reach, reach))
