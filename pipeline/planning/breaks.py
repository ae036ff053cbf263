"""A break of the retina: where it is on the surgeon's chart, and the patch of wall that oil must touch.

Clock hours are those that an observer sees who faces the patient, as in the charts of Amsler and Dubois: 12 is
superior, 3 is on the patient's left, in both eyes; so 3 is nasal in a right eye and temporal in a left one. Latitude is
the angle from the posterior pole, seen from the center of the globe: macula 0, equator 90, ora serrata 115 degrees.
"""
import dataclasses
import re

import numpy as np

from pipeline.base.errors import UserError
from pipeline.cavity.regions import RETINA_ANGLE
from pipeline.scenes.units import parse_quantity

HOUR = 30.0                 # degrees
ORA = float(np.degrees(RETINA_ANGLE))
ASSUMED_HEIGHT = 10.0       # degrees, of a break whose width alone is told: 2 mm
STEP = 2.5                  # degrees between the points of a patch, at most
_HOURS = re.compile(r"(\d{1,2}(?:\.\d+)?)\s*h|(\d{1,2}):([0-5]\d)")


@dataclasses.dataclass(frozen=True)
class Break:
    """A break of the retina; angles in degrees.

    Attributes
    ----------
    meridian : of its middle, clockwise from 12 as an observer sees it who faces the patient.
    latitude : of its middle, from the posterior pole.
    width, height : along the circle of latitude, as an angle of meridians, and along the meridian.
    height_assumed : whether the height was not told.
    """

    meridian: float
    latitude: float
    width: float
    height: float
    height_assumed: bool = False

    def patch(self, margin: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Meridians and latitudes (k,) of points that cover the break, degrees; a margin, degrees, all around."""
        low, high = self.latitude - 0.5 * self.height - margin, self.latitude + 0.5 * self.height + margin
        low, high = max(low, 0.0), min(high, ORA)
        latitude = np.linspace(low, high, 1 + int(np.ceil((high - low) / STEP)))
        meridians, latitudes = [], []
        for one in latitude:
            # Around the pole itself a margin reaches all meridians.
            sines = np.sin(np.radians([margin, one]))
            wider = 180.0 if margin >= one else np.degrees(np.arcsin(sines[0] / sines[1]))
            half = min(max(0.5 * self.width + wider, 0.0), 180.0)
            count = 1 + int(np.ceil(2.0 * half / STEP))
            meridians.append(self.meridian + np.linspace(-half, half, count))
            latitudes.append(np.full(count, one))
        return np.concatenate(meridians) % 360.0, np.concatenate(latitudes)

    def words(self, side: str) -> str:
        """Return where the break is, in words."""
        hour = self.meridian / HOUR or 12.0
        minutes = round(60.0 * (hour % 1.0))
        clock = f"{int(hour)}:{minutes:02d}" if minutes else f"{int(hour)}"
        rows = ("superior" if np.cos(np.radians(self.meridian)) > 0.3 else
                "inferior" if np.cos(np.radians(self.meridian)) < -0.3 else "")
        left = np.sin(np.radians(self.meridian))
        nasal = left > 0.0 if side == "right" else left < 0.0
        columns = ("nasal" if nasal else "temporal") if abs(left) > 0.3 else ""
        place = " ".join(word for word in (rows, columns) if word)
        return (f"{clock} o'clock ({place}), {self.latitude:g} degrees from the posterior pole, "
                f"{self.width / HOUR:.3g} h of the clock wide and {self.height:g} degrees high"
                + (" (height assumed)" if self.height_assumed else ""))


def direction(meridian: np.ndarray, latitude: np.ndarray) -> np.ndarray:
    """Directions (k, 3) from the center of the globe, of meridians and latitudes (k,) in degrees.

    >>> direction(np.array([90.0]), np.array([90.0])).round(9) + 0.0
    array([[1., 0., 0.]])
    """
    around, down = np.radians(meridian), np.radians(latitude)
    return np.stack([np.sin(down) * np.sin(around), np.sin(down) * np.cos(around), -np.cos(down)], axis=-1)


def read_break(place: str, size: str) -> Break:
    """Read a break as users write it: "6h,60deg" (or "6:30, 60 deg") and "2h", "2h,15deg" or "15deg".

    Raises
    ------
    UserError : something else, or a break that is not on the retina.
    """
    words = [word.strip() for word in place.split(",")]
    hour = _hours(words[0])
    if len(words) != 2 or hour is None:
        raise UserError(f'--break is "{place}", but must be a clock hour and an angle from the posterior pole, such as '
                        "6h,60deg or 10:30,95deg")
    if not 0.0 < hour <= 12.0:
        raise UserError(f'--break is "{place}", but a clock hour must be above 0 and at most 12')
    latitude = _angle("--break", words[1])
    if not 0.0 <= latitude <= ORA:
        raise UserError(f'--break is "{place}", but the retina reaches from 0 (posterior pole) to {ORA:g} deg (ora '
                        "serrata)")
    width, height = _size(size, latitude)
    low, high = max(latitude - 0.5 * (height or ASSUMED_HEIGHT), 0.0), latitude + 0.5 * (height or ASSUMED_HEIGHT)
    if high > ORA:
        raise UserError(f"--break {place} --size {size} reaches from {low:g} to {high:g} deg from the posterior pole, "
                        f"but the retina ends at {ORA:g} deg (ora serrata)")
    return Break(hour * HOUR % 360.0, latitude, width, height or ASSUMED_HEIGHT, height is None)


def _size(size: str, latitude: float) -> tuple[float, float | None]:
    """Width as an angle of meridians, and height, degrees; None where it is not told."""
    words = [word.strip() for word in size.split(",")]
    hours = [_hours(word) for word in words]
    if len(words) > 2 or (len(words) == 2 and (hours[0] is None or hours[1] is not None)):
        raise UserError(f'--size is "{size}", but must be a width in clock hours, a height in degrees, or both, such '
                        "as 2h, 15deg or 2h,15deg")
    if hours[0] is not None:
        if not 0.0 < hours[0] <= 12.0:
            raise UserError(f'--size is "{size}", but a width must be above 0 and at most 12 clock hours')
        return hours[0] * HOUR, _height(size, words[1]) if len(words) == 2 else None
    height = _height(size, words[0])
    # As wide as high, on the retina.
    return float(min(height / max(np.sin(np.radians(latitude)), 1e-3), 360.0)), height


def _height(size: str, word: str) -> float:
    height = _angle("--size", word)
    if not 0.0 < height <= ORA:
        raise UserError(f'--size is "{size}", but a height must be above 0 and at most {ORA:g} deg')
    return height


def _hours(word: str) -> float | None:
    match = _HOURS.fullmatch(word)
    if not match:
        return None
    return float(match[1]) if match[1] else int(match[2]) + int(match[3]) / 60.0


def _angle(option: str, word: str) -> float:
    """An angle in degrees; a bare number would be in radians, which nobody means here."""
    try:
        float(word)
    except ValueError:
        try:
            return float(f"{np.degrees(parse_quantity(word, 'rad')):.12g}")
        except ValueError as error:
            raise UserError(f"{option} has an angle that is {error}, such as 60deg") from error
    raise UserError(f'{option} has the angle "{word}" without a unit, but must be in deg, such as {word}deg')
