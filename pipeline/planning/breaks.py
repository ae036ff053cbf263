"""A break of the retina as users of a plan write it, such as "6h,60deg" and "2h,15deg" (``pipeline.scenes.retina``)."""
import dataclasses
import re

import numpy as np

from pipeline.base.errors import UserError
from pipeline.scenes.retina import ASSUMED_HEIGHT, HOUR, ORA, Patch, square
from pipeline.scenes.units import parse_quantity

GLOBE = 11.31e-3            # m, radius of the globe of the default eye
_HOURS = re.compile(r"(\d{1,2}(?:\.\d+)?)\s*h|(\d{1,2}):([0-5]\d)")


@dataclasses.dataclass(frozen=True)
class Break(Patch):
    """A break of the retina.

    Attributes
    ----------
    height_assumed : whether the height was not told.
    """

    height_assumed: bool = False

    def words(self, side: str) -> str:
        """Return where the break is, in words."""
        return super().words(side) + (" (height assumed)" if self.height_assumed else "")


def read_break(place: str, size: str, globe: float = GLOBE) -> Break:
    """Read a break as users write it: "6h,60deg" (or "6:30, 60 deg") and "2h", "2h,15deg", "2h,3mm", "15deg" or "3mm".

    Parameters
    ----------
    globe : radius of the globe, m, which turns lengths on the retina into angles.

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
    width, height = _size(size, latitude, globe)
    low, high = max(latitude - 0.5 * (height or ASSUMED_HEIGHT), 0.0), latitude + 0.5 * (height or ASSUMED_HEIGHT)
    if high > ORA:
        raise UserError(f"--break {place} --size {size} reaches from {low:g} to {high:g} deg from the posterior pole, "
                        f"but the retina ends at {ORA:g} deg (ora serrata)")
    return Break(hour * HOUR % 360.0, latitude, width, height or ASSUMED_HEIGHT, height is None)


def _size(size: str, latitude: float, globe: float) -> tuple[float, float | None]:
    """Width as an angle of meridians, and height, degrees; None where it is not told."""
    words = [word.strip() for word in size.split(",")]
    hours = [_hours(word) for word in words]
    if len(words) > 2 or (len(words) == 2 and (hours[0] is None or hours[1] is not None)):
        raise UserError(f'--size is "{size}", but must be a width in clock hours, a height in degrees or mm, or both, '
                        "such as 2h, 15deg, 3mm or 2h,15deg")
    if hours[0] is not None:
        if not 0.0 < hours[0] <= 12.0:
            raise UserError(f'--size is "{size}", but a width must be above 0 and at most 12 clock hours')
        return hours[0] * HOUR, _height(size, words[1], globe) if len(words) == 2 else None
    height = _height(size, words[0], globe)
    return square(0.0, latitude, height).width, height


def _height(size: str, word: str, globe: float) -> float:
    height = float(np.degrees(_length(word) / globe)) or _angle("--size", word)
    if not 0.0 < height <= ORA:
        raise UserError(f'--size is "{size}", but a height must be above 0 and at most {ORA:g} deg '
                        f"({1e3 * np.radians(ORA) * globe:.3g} mm)")
    return height


def _length(word: str) -> float:
    """A length in m; 0 for anything else, a bare number too."""
    try:
        return parse_quantity(word, "m") if re.search("[a-z]", word) else 0.0
    except ValueError:
        return 0.0


def _hours(word: str) -> float | None:
    match = _HOURS.fullmatch(word)
    if not match:
        return None
    if match[1]:
        return float(match[1])
    hour, minutes = int(match[2]), int(match[3])
    return (0 if hour == 12 and minutes else hour) + minutes / 60.0  # after twelve the clock begins anew


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
