"""Shapes at rest for many fills in one eye, as the studies of fills and of eyes need them.

Of the shapes that are found the one with least energy counts.
"""
import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np
from PIL import Image

from pipeline.equilibrium.contact import Contact, retina_masks
from pipeline.equilibrium.least import Found, Resting
from pipeline.equilibrium.rest import Liquids, Rest
from pipeline.equilibrium.star_cavity import FINE, StarCavity
from pipeline.pictures.fundus_map import FundusMap
from pipeline.pictures.marks import OVERSAMPLING, reduce
from pipeline.planning.settings import postures
from studies.questions.kit.words import PARTS

GRAVITY = 9.81
HEAD_UP = "head_up_45"                      # the patient leans back by half a right angle
POSTURES = ("upright", HEAD_UP, "supine", "prone", "left_side", "right_side")
MAP_SIZE = 168                              # pixels


@dataclasses.dataclass(frozen=True)
class Course:
    """Shapes at one contact angle in one posture, fill by fill.

    Attributes
    ----------
    found : (fills,) all shapes that were found, the one of least energy first; none where none was.
    least : (fills, parts), what the first of them touches; nan where there is none.
    low, high : (fills, parts), the least and the most that any of them touches.
    """

    found: list[list[Found]]
    least: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def best(self, n: int) -> Rest | None:
        """Return the shape of least energy at a fill."""
        return self.found[n][0].rest if self.found[n] else None


def down_of(posture: str) -> np.ndarray:
    """Return the direction (3,) of gravity in the eye."""
    if posture == HEAD_UP:
        middle = postures()["upright"] + postures()["supine"]
        return middle / np.linalg.norm(middle)
    return postures()[posture]


def parts_of(cavity: StarCavity, *, right_eye: bool = True) -> dict[str, np.ndarray]:
    """Triangles of the parts of the retina, name -> (m,) bool, in the order of ``PARTS``."""
    masks, center = retina_masks(cavity), cavity.wall[cavity.faces].mean(axis=1)
    temporal, before = (center[:, 0] < 0.0) == right_eye, center[:, 2] > 0.0
    for half in ("superior", "inferior"):
        masks[f"{half}_temporal"], masks[f"{half}_nasal"] = masks[half] & temporal, masks[half] & ~temporal
    masks["before_equator"], masks["behind_equator"] = masks["retina"] & before, masks["retina"] & ~before
    return {name: masks[name] for name in PARTS}


def shares_of(contact: Contact, masks: dict[str, np.ndarray]) -> np.ndarray:
    """Return the covered shares of parts of the retina, (parts,)."""
    return np.array([contact.share(mask) for mask in masks.values()])


def course_of(resting: Resting, liquids: Liquids, down: np.ndarray, fills: Sequence[float], *,
              right_eye: bool = True) -> Course:
    """Return the shapes at rest at some fills.

    Parameters
    ----------
    down : (3,) direction of gravity.
    """
    masks, nothing = parts_of(resting.cavity(), right_eye=right_eye), np.full((1, len(PARTS)), np.nan)
    found = [resting.shapes(liquids, down, fill) for fill in fills]
    touched = [np.array([shares_of(resting.contact(one), masks) for one in shapes]) if shapes else nothing
               for shapes in found]
    return Course(found, *(np.array([pick(one) for one in touched]) for pick in (
        lambda one: one[0], lambda one: one.min(axis=0), lambda one: one.max(axis=0))))


def change_with_directions(resting: Resting, liquids: Liquids, down: np.ndarray, course: Course,
                           chosen: Iterable[int], *, right_eye: bool = True) -> np.ndarray:
    """Return the largest change of the shares with four times as many directions, (parts,).

    Parameters
    ----------
    chosen : fills of the course that are tried.
    """
    masks, changes = parts_of(resting.cavity(FINE), right_eye=right_eye), [np.zeros(len(PARTS))]
    for n in chosen:
        for one in course.found[n][:1]:
            fine = resting.finer(one, liquids, down, FINE)
            if fine.rest.settled:
                changes.append(np.abs(shares_of(resting.contact(fine), masks) - course.least[n]))
    return np.nanmax(changes, axis=0)


def nearest(fills: Iterable[float], wanted: Iterable[float]) -> list[int]:
    """Return which fills are nearest to those that are wanted, each once."""
    all_fills = np.array(list(fills))
    return sorted({int(np.abs(all_fills - one).argmin()) for one in wanted})


def range_of(courses: Sequence[Course], error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and the largest of the shares of courses, (fills, parts), an error (parts,) beyond."""
    low, high = (np.array([getattr(course, name) for course in courses]) for name in ("low", "high"))
    return np.maximum(np.fmin.reduce(low) - error, 0.0), np.minimum(np.fmax.reduce(high) + error, 1.0)


def percents(*shares: float) -> list[str]:
    """Return shares as cells of a table, in percent; what is not known is empty."""
    return [f"{100 * share:.1f}" if np.isfinite(share) else "" for share in shares]


def in_front(rest: Rest | None) -> float:
    """Return the share of the aqueous that is before the equator; what is not seen of the cavity is beside the lens."""
    if rest is None:
        return np.nan
    seen, whole = rest.cavity.volume, rest.cavity.whole or rest.cavity.volume
    hidden = max(whole - seen, 0.0) / (whole * (1.0 - rest.fill))
    return hidden + (1.0 - hidden) * rest.other.share(rest.other.position[:, 2] > 0.0)


def fundus_maps(resting: Resting, courses: Sequence[Course], chosen: Iterable[int], *,
                right_eye: bool = True) -> list[Image.Image]:
    """Return maps of the fundus at some fills, white ones where no shape was found.

    Hatched is where the courses do not agree.
    """
    import pyvista

    side, cavity = OVERSAMPLING * MAP_SIZE, resting.cavity()
    chart, images = FundusMap(cavity.wall, (side, side), captions=False, right_eye=right_eye), []
    for n in chosen:
        if not courses[0].found[n]:
            images.append(Image.new("RGB", (MAP_SIZE, MAP_SIZE), "white"))
            continue
        margins = np.array([resting.contact(course.found[n][0]).margin for course in courses if course.found[n]])
        wall = pyvista.PolyData(cavity.wall)
        wall.point_data["contact_distance"] = margins[0]
        wall.point_data["oil_fraction_covered"] = np.ones(len(cavity.wall))
        wall.point_data["oil_fraction_bare"] = np.zeros(len(cavity.wall))
        doubtful = (margins > 0.0).any(axis=0) & (margins <= 0.0).any(axis=0)
        images.append(reduce(chart.draw(wall, uncertain=np.where(doubtful, 2.0 * np.abs(margins[0]), 0.0))))
    return images
