"""Postures of a patient, and how gravity turns in the eye from one to the other.

Directions are those of gravity in an eye that looks ahead: x to the patient's left, y superior, z anterior.
Equations: docs/methods/gravity.md.
"""
import dataclasses
import functools
import math

import numpy as np

POSTURES = {
    "upright": (0.0, -1.0, 0.0),
    "supine": (0.0, 0.0, -1.0),
    "prone": (0.0, 0.0, 1.0),
    "left_side": (1.0, 0.0, 0.0),
    "right_side": (-1.0, 0.0, 0.0),
}
UPRIGHT = np.array(POSTURES["upright"])
HELD, TURNED = math.radians(5.0), math.radians(15.0)    # a head that moves less rests; one that moves more has turned
NAMED = math.radians(20.0)                              # a posture that is nearer to a named one has its name


@dataclasses.dataclass(frozen=True)
class Move:
    """A turn of gravity from one direction to another, by the shortest way.

    Attributes
    ----------
    begin, end : s.
    start, to : (3,), unit vectors.
    smooth : whether it begins and ends at rest (profile of least jerk), or goes on evenly.
    words : posture after it.
    """

    begin: float
    end: float
    start: tuple[float, ...]
    to: tuple[float, ...]
    smooth: bool
    words: str

    @property
    def angle(self) -> float:
        """Angle of the turn, rad."""
        return math.acos(min(max(float(np.dot(self.start, self.to)), -1.0), 1.0))

    def at(self, time: float) -> np.ndarray:
        """Return the direction (3,) at a time, s."""
        s = min(max((time - self.begin) / (self.end - self.begin), 0.0), 1.0)
        return rotate_towards(self.start, self.to, s**3 * (10.0 - 15.0 * s + 6.0 * s * s) if self.smooth else s)  # (G2)


@dataclasses.dataclass(frozen=True)
class Course:
    """Directions of gravity over time: ``first``, and the moves from there on, in order, with rests between."""

    first: tuple[float, ...]
    words: str
    moves: tuple[Move, ...]

    def at(self, time: float) -> np.ndarray:
        """Return the direction (3,) at a time, s."""
        index = int(np.searchsorted(self._begins, time, side="right")) - 1
        return np.array(self.first) if index < 0 else self.moves[index].at(time)

    @functools.cached_property
    def _begins(self) -> np.ndarray:
        return np.array([move.begin for move in self.moves])

    @property
    def directions(self) -> list[tuple[float, ...]]:
        """Directions that gravity rests in or passes."""
        return [self.first, *(move.to for move in self.moves)]

    def turns(self) -> list[Move]:
        """Return the moves, where many small ones make up a turn as one; what stays near a posture is none."""
        if all(move.smooth for move in self.moves):
            return list(self.moves)
        found: list[list[Move]] = []
        for move in self.moves:
            slow = move.angle < HELD
            if found and not slow and math.isclose(found[-1][-1].end, move.begin):
                found[-1].append(move)
            elif not slow:
                found.append([move])
        merged = [Move(group[0].begin, group[-1].end, group[0].start, group[-1].to, False, words_of(group[-1].to))
                  for group in found]
        return [one for one in merged if one.angle > TURNED]

    def held(self, duration: float) -> list[tuple[float, float, np.ndarray, str]]:
        """Return the postures that are held within a duration, s: begin, end, direction (3,) in the middle, words."""
        turns = [one for one in self.turns() if one.begin < duration]
        edges = [0.0, *(edge for one in turns for edge in (one.begin, min(one.end, duration))), duration]
        words = [self.words, *(one.words for one in turns)]
        return [(begin, end, self.at(0.5 * (begin + end)), name)
                for begin, end, name in zip(edges[::2], edges[1::2], words, strict=True) if end > begin]


def direction_of(posture: str, head_up: float = 0.0, roll: float = 0.0) -> np.ndarray:
    """Return the direction (3,) of gravity in a posture.

    Parameters
    ----------
    head_up : rad, by which the head is raised from lying.
    roll : rad, by which the patient who lies is turned about the long axis, toward the left side from the back.

    >>> direction_of("supine", roll=math.pi / 2).round(9) + 0.0
    array([1., 0., 0.])
    """
    x, y, z = POSTURES[posture]
    turned = np.array([x * math.cos(roll) - z * math.sin(roll), y, x * math.sin(roll) + z * math.cos(roll)])
    return turned if posture == "upright" else math.cos(head_up) * turned + math.sin(head_up) * UPRIGHT  # (G8)


def posture_in_words(posture: str, head_up: float = 0.0, roll: float = 0.0) -> str:
    """Return a posture in words.

    >>> posture_in_words("supine", math.radians(30.0))
    'supine, head up 30 deg'
    """
    words = [posture]
    if head_up:
        words.append(f"head {'up' if head_up > 0.0 else 'down'} {abs(math.degrees(head_up)):.3g} deg")
    if roll:
        words.append(f"turned {abs(math.degrees(roll)):.3g} deg to the {'left' if roll > 0.0 else 'right'}")
    return ", ".join(words)


def words_of(direction) -> str:
    """Return the name of the posture that a direction of gravity (3,) is near to, or its angles.

    >>> words_of((0.0, -0.5, -0.866))
    'head up 30 deg, face up'
    """
    cosines = {name: float(np.dot(one, direction)) for name, one in POSTURES.items()}
    best = max(cosines, key=lambda name: cosines[name])
    if cosines[best] > math.cos(NAMED):
        return best
    x, y, z = direction
    up = math.degrees(math.asin(min(max(-y, -1.0), 1.0)))
    lying = "face up" if -z > abs(x) else "face down" if z > abs(x) else "on the left side" if x > 0.0 else \
        "on the right side"
    return f"head {'up' if up >= 0.0 else 'down'} {abs(up):.0f} deg, {lying}"


def rotate_towards(start, end, fraction: float) -> np.ndarray:
    """Unit vector on the great circle from `start` to `end`; opposite vectors turn about the horizontal x axis."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    angle = np.arccos(np.clip(start @ end, -1.0, 1.0))
    side = end - (start @ end) * start
    if np.linalg.norm(side) < 1e-9:
        side = np.cross(start, (1.0, 0.0, 0.0)) if abs(start[0]) < 0.9 else np.cross(start, (0.0, 1.0, 0.0))
    side = side / np.linalg.norm(side)
    return np.cos(fraction * angle) * start + np.sin(fraction * angle) * side
