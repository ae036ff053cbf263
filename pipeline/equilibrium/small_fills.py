"""A small fill at rest: a bubble at the wall, or a pool, seen from its own middle and not from that of the cavity.

Equations: docs/methods/equilibrium.md.
"""
import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from pipeline.base.errors import UserError
from pipeline.equilibrium.energy import length_of
from pipeline.equilibrium.rest import DRAWN_IN, Liquids, Rest, at_rest, refined_start
from pipeline.equilibrium.star_cavity import COARSE, DRAFT, FINE, Level, StarCavity, cavity_of, levels_of
from pipeline.scenes.model import Eye

SMALL, LARGE = 0.5, 0.75    # fills below are seen from their own middle, those between from both; above, it is the same
ALIKE = 1e-3            # of the energy: views of one shape from two points differ by less
ROUNDS = 5              # of a shape and a view from its middle, at most: two are usual
CENTERED = 0.05         # from the middle of the oil, over the radius of a ball of it: near enough
REACH = 2.0             # over that radius: how far oil is looked for
DEPTHS = 40             # places for the ball that are tried along every ray
LARGEST_BALL = 0.95     # of the largest one that the cavity holds
FIRST_UP = 1e-3         # how little of y decides between places that are equally high
HALVINGS = 50           # of the bisection


def small_at_rest(eye: Eye, liquids: Liquids, down: np.ndarray, fill: float) -> Rest:
    """Return the shape of least energy of those that are found from two starts, seen from its own middle.

    Starts: a ball at the place of the cavity to which gravity drives it, and one on the axis, for oil or gas that lies
    behind the lens. With 2,562 directions.

    Parameters
    ----------
    down : (3,), unit vector of gravity in the frame of the cavity.
    fill : share of the cavity that is oil.

    Raises
    ------
    UserError : the user's mesh cannot be used, or no point sees its whole wall.
    """
    front = cavity_of(eye, COARSE, from_front=True).viewpoint
    return seen_from_its_middle(levels_of(eye)[0], cavity_of(eye), liquids, down, fill, [front])


def seen_from_its_middle(level: Level, cavity: StarCavity, liquids: Liquids, down: np.ndarray, fill: float,
                         others: Sequence[np.ndarray] = (), finest: int = DRAFT) -> Rest:
    """Return the shape of least energy of those that are found from a ball driven up, or around other points.

    Parameters
    ----------
    level, cavity : the same cavity, as a function of points (..., 3) in m and as one point sees all of it.
    others : points (3,), m, in the cavity.
    finest : cuts of the directions that the shape is taken on to.
    """
    drive = np.sign(liquids.density_difference) * np.asarray(down, float)
    radius = (3.0 * fill * cavity.volume / (4.0 * np.pi)) ** (1.0 / 3.0)
    starts = [_place_of_ball(cavity, drive, radius), *others]
    found = [_from_its_middle(level, cavity.volume, liquids, down, fill, start) for start in starts]
    best = min(found, key=lambda rest: (not rest.settled, energy(rest, liquids)))
    for cuts in range(COARSE + 1, finest + 1):
        best = _finer(level, best, liquids, down, cuts)
    return best


def finest_at_rest(eye: Eye, rest: Rest, liquids: Liquids, down: np.ndarray) -> Rest:
    """Return a shape of ``small_at_rest`` with 10,242 directions."""
    return _finer(levels_of(eye)[0], rest, liquids, down, FINE)


def _finer(level: Level, rest: Rest, liquids: Liquids, down: np.ndarray, cuts: int) -> Rest:
    """The same shape with four times as many directions; as it is where it is not at rest."""
    if not rest.settled:
        return rest
    finer = _seen(level, rest.cavity.viewpoint, cuts, rest.cavity.whole, rest.cavity.reach)
    return at_rest(finer, liquids, down, rest.fill, refined_start(rest, finer, cuts))


def _place_of_ball(cavity: StarCavity, drive: np.ndarray, radius: float) -> np.ndarray:
    """Middle (3,), m, of the ball that has gone as far against `drive` as the wall lets it."""
    share = np.linspace(0.0, 1.0, DEPTHS, endpoint=False)
    points = (cavity.viewpoint + share[:, None, None] * (cavity.radius[:, None] * cavity.direction)).reshape(-1, 3)
    room = cKDTree(cavity.wall).query(points)[0]
    points = points[room >= min(radius, LARGEST_BALL * room.max())]
    return points[(FIRST_UP * points[:, 1] - points @ drive).argmax()]


def _seen(level: Level, viewpoint: np.ndarray, cuts: int, whole: float, reach: float) -> StarCavity:
    """The cavity as it is seen from a point that may not see all of it."""
    return dataclasses.replace(StarCavity.of_level(level, viewpoint, cuts, partly=True), whole=whole, reach=reach)


def _from_its_middle(level: Level, whole: float, liquids: Liquids, down: np.ndarray, fill: float,
                     viewpoint: np.ndarray) -> Rest:
    """The shape that a ball around a point comes to, looked at from its middle until that stays where it is."""
    cavity, found = _seen(level, viewpoint, COARSE, whole, np.inf), None
    for _ in range(ROUNDS):
        radius, start = _ball(cavity, fill * whole)
        cavity = dataclasses.replace(cavity, reach=REACH * radius)
        rest = at_rest(cavity, liquids, down, fill, start)
        if found is None or rest.settled >= found.settled:
            found = rest
        middle = _middle(rest)
        if np.linalg.norm(middle - cavity.viewpoint) < CENTERED * radius:
            break
        try:
            cavity = _seen(level, middle, COARSE, whole, np.inf)
        except UserError:  # of a ring the middle may lie in the lens: what was found from beside it is all
            break
    return found


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


def _middle(rest: Rest) -> np.ndarray:
    """Center of mass of the oil, (3,), m."""
    cavity = rest.cavity
    volume = cavity.solid * rest.distance[cavity.faces].prod(axis=1)
    corners = (rest.distance[:, None] * cavity.direction)[cavity.faces]
    return cavity.viewpoint + volume @ corners.sum(axis=1) / (4.0 * volume.sum())


def energy(rest: Rest, liquids: Liquids) -> float:
    """Energy in J, with the weight counted from the origin, so that views from several points can be compared."""
    cavity = rest.cavity
    volume = float(cavity.solid @ rest.distance[cavity.faces].prod(axis=1)) / 6.0
    return liquids.tension * length_of(cavity) ** 2 * rest.energy + volume * float(cavity.viewpoint @ rest.pull)
