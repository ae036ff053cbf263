"""Quantities of scene files: a bare number is SI, a string carries its unit."""
import functools
import math
import re
from typing import TYPE_CHECKING

from pipeline.base.words import printable

if TYPE_CHECKING:
    import pint

_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*", re.DOTALL)
# Names with an exponent ("m3", "m**3", "m^3", "s-1"), joined by a space, "*", "·" or "/". Only this reaches pint, whose
# parser also evaluates arithmetic.
_FACTOR = r"(?:1|[A-Za-zµμ°%]+)(?:(?:\*\*|\^)?-?[1-9])?"
_UNIT = re.compile(rf"{_FACTOR}(?:(?:\s*[*/·]\s*|\s+){_FACTOR})*")
_LONGEST = 100  # characters of a quantity
_ANGLES = {"degree", "radian", "turn", "arcminute", "arcsecond"}


def parse_quantity(value: object, unit: str = "") -> float:
    """Return ``value`` as a number in ``unit``.

    Parameters
    ----------
    value : a number, taken as already in ``unit``, or a string such as "40 mN/m", "85 %" or "1.5 mL/s".
    unit : target in pint's spelling; "" for a pure number, "rad" or "deg" for an angle (no pure number here).

    Raises
    ------
    ValueError
        With a phrase that completes "<key> is ...": not a number, unknown unit, or another dimension.

    Examples
    --------
    >>> parse_quantity("40 mN/m", "N/m")
    0.04
    >>> parse_quantity("85 %")
    0.85
    >>> parse_quantity("2 s", "m")
    Traceback (most recent call last):
    ValueError: "2 s", but must be in m
    """
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise ValueError(f"{_describe(value)}, but must be {_wanted(unit)}")
    if isinstance(value, str):
        match = len(value) <= _LONGEST and _NUMBER.fullmatch(value)
        if not match:
            raise ValueError(f'"{printable(str(value))}", but must be {_wanted(unit)}')
        number, text = float(match[1]), match[2]
    else:
        number, text = float(str(value)), ""  # by way of text, a whole number beyond the range of floats is infinite
    number = _convert(number, text, unit, value) if text else number
    if not math.isfinite(number):
        raise ValueError(f"{printable(str(value))}, but must be a finite number")
    return number


def is_kinematic_viscosity(value: object) -> bool:
    """Tell whether ``value`` is a string with the dimension of a kinematic viscosity, such as "5000 cSt"."""
    try:
        parse_quantity(value, "m**2/s")
    except ValueError:
        return False
    return isinstance(value, str) and bool(_NUMBER.fullmatch(value)[2])


def _convert(number: float, text: str, unit: str, value: object) -> float:
    source = _parse_unit(text)
    if source is None:
        raise ValueError(f'"{printable(str(value))}" with the unknown unit "{printable(text)}", '
                         f"but must be {_wanted(unit)}")
    target = _parse_unit(unit)
    if source.dimensionality != target.dimensionality or _is_angle(source) != _is_angle(target):
        raise ValueError(f'"{printable(str(value))}", but must be {_wanted(unit)}')
    converted = _registry().Quantity(number, source).to(target).magnitude
    return float(f"{converted:.15g}")  # "1.5 mL" is 1.5e-6 m3, not 1.5000000000000002e-6


def _describe(value: object) -> str:
    kinds = {bool: str(value).lower(), dict: "a mapping", list: "a list", type(None): "empty"}
    return kinds.get(type(value), f"the {type(value).__name__} {value}")


def _wanted(unit: str) -> str:
    if unit.startswith("rad"):
        return f"in {unit.replace('rad', 'deg')} or {unit}"
    return f"in {unit.replace('**', '')}" if unit else 'a pure number (or in "%")'


def _is_angle(unit: "pint.Unit") -> bool:
    return any(name in _ANGLES for name in unit._units)


@functools.cache
def _parse_unit(text: str) -> "pint.Unit | None":
    if text and not _UNIT.fullmatch(text):
        return None
    # "kg/m3" as people write it: a digit after a letter is an exponent.
    spelled = re.sub(r"(?<=[A-Za-zµμ°%])(-?\d)", r"**\1", text).replace("·", "*")
    try:
        return _registry().parse_units(spelled)
    except AttributeError:  # pint.UndefinedUnitError is one
        return None


@functools.cache
def _registry() -> "pint.UnitRegistry":
    import pint  # slow to import and to build, and a resolved scene needs neither

    return pint.UnitRegistry()
