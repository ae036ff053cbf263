"""Views of a small fill: a bubble at the wall, or a pool, is seen from its own middle and not from that of the cavity.

Equations: docs/methods/equilibrium.md.
"""
import dataclasses
import functools

import numpy as np
from scipy.spatial import cKDTree

from pipeline.base.errors import UserError
from pipeline.equilibrium.rest import DRAWN_IN, Liquids, Rest, at_rest
from pipeline.equilibrium.star_cavity import COARSE, Level, StarCavity

ROUNDS = 5              # of a shape and a view from its middle, at most: two are usual
CENTERED = 0.05         # from the middle of the oil, over the radius of a ball of it: near enough
REACH = 2.0             # over that radius: how far oil is looked for
DEPTHS = 40             # places for the ball that are tried along every ray
LARGEST_BALL = 0.95     # of the largest one that the cavity holds
LEAN = 0.3              # of the radius of the ball: how far off the axis it starts, for oil that may lean to any side
HALVINGS = 50           # of the bisection


class Ball:
    """Where a ball of oil starts in a cavity.

    Parameters
    ----------
    cavity : as one point sees all of it.
    """

    def __init__(self, cavity: StarCavity):
        self._cavity = cavity

    def start(self, drive: np.ndarray, volume: float) -> np.ndarray:
        """Middle (3,), m, of the ball of a volume that has gone as far along `drive` as the wall lets it.

        From there it leans a little to the side that `drive` leans to; superior, where it leans to none.
        """
        radius = (3.0 * volume / (4.0 * np.pi)) ** (1.0 / 3.0)
        points, room = self._places
        kept = points[room >= min(radius, LARGEST_BALL * room.max())]
        place = kept[(kept @ drive).argmax()]
        side = np.array([*drive[:2], 0.0])
        side = side / np.linalg.norm(side) if np.linalg.norm(side) > 1e-6 else np.array([0.0, 1.0, 0.0])
        return place + LEAN * min(radius, LARGEST_BALL * room.max()) * side

    @functools.cached_property
    def _places(self) -> tuple[np.ndarray, np.ndarray]:
        """Points (n, 3), m, in the cavity, and how far the wall is from them, (n,), m."""
        cavity, share = self._cavity, np.linspace(0.0, 1.0, DEPTHS, endpoint=False)
        points = (cavity.viewpoint + share[:, None, None] * (cavity.radius[:, None] * cavity.direction)).reshape(-1, 3)
        return points, cKDTree(cavity.wall).query(points)[0]


def seen_from_its_middle(level: Level, whole: float, liquids: Liquids, down: np.ndarray, fill: float,
                         start: np.ndarray) -> Rest:
    """Return the shape that a ball around a point comes to, looked at from its middle until that stays where it is.

    With 642 directions.

    Parameters
    ----------
    level, whole : the cavity, and its volume, m3.
    down : (3,), unit vector of gravity. fill : share of the cavity that is oil.
    start : (3,), m.

    Raises
    ------
    UserError : the point is not in the cavity.
    """
    cavity, found = seen(level, start, COARSE, whole, np.inf), None
    for _ in range(ROUNDS):
        radius, distance = _ball(cavity, fill * whole)
        cavity = dataclasses.replace(cavity, reach=REACH * radius)
        rest = at_rest(cavity, liquids, down, fill, distance)
        if found is None or rest.settled >= found.settled:
            found = rest
        middle = middle_of(rest)
        if np.linalg.norm(middle - cavity.viewpoint) < CENTERED * radius:
            break
        try:
            cavity = seen(level, middle, COARSE, whole, np.inf)
        except UserError:  # of a ring the middle may lie in the lens: what was found from beside it is all
            break
    return found


def seen(level: Level, viewpoint: np.ndarray, cuts: int, whole: float, reach: float) -> StarCavity:
    """Return the cavity as it is seen from a point that may not see all of it."""
    return dataclasses.replace(StarCavity.of_level(level, viewpoint, cuts, partly=True), whole=whole, reach=reach)


def _ball(cavity: StarCavity, volume: float) -> tuple[float, np.ndarray]:
    """Radius and distances (n,), m, of the ball around the viewpoint that holds a volume inside the wall."""
    low, high = 0.0, float(cavity.radius.max())
    for _ in range(HALVINGS):
        radius = 0.5 * (low + high)
        distance = np.minimum(radius, DRAWN_IN * cavity.radius)
        if cavity.solid @ distance[cavity.faces].prod(axis=1) / 6.0 < volume:
            low = radius
        else:
            high = radius
    return radius, distance


def middle_of(rest: Rest) -> np.ndarray:
    """Return the center of mass of the oil, (3,), m."""
    cavity = rest.cavity
    volume = cavity.solid * rest.distance[cavity.faces].prod(axis=1)
    corners = (rest.distance[:, None] * cavity.direction)[cavity.faces]
    return cavity.viewpoint + volume @ corners.sum(axis=1) / (4.0 * volume.sum())
