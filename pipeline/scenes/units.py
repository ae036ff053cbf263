"""Quantities of scene files: a bare number is SI, a string carries its unit."""
import difflib
import functools
import math
import re
import unicodedata
from collections.abc import Callable
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
# Units that people use for a quantity, by the one it has here; a number without a unit is most likely in the first.
_USUAL = {"": ("%",), "rad": ("deg", "rad"), "m": ("mm", "um", "cm"), "m**3": ("mL", "uL"),
          "m**3/s": ("mL/s", "mL/min"), "m/s": ("mm/s",), "s": ("ms", "min"), "N/m": ("mN/m", "dyn/cm"),
          "Pa*s": ("mPa s", "cP", "cSt"), "kg/m**3": ("g/mL", "kg/m3")}
# What else they are called.
_SPOKEN = {"%": ("percent", "vol%"), "deg": ("degrees", "grad"), "mm": ("millimeters",),
           "um": ("micrometers", "microns"), "mL": ("milliliters",), "ms": ("milliseconds",), "min": ("minutes",)}
# Signs that word processors and keyboards give in place of those of ASCII.
_SIGNS = str.maketrans({"\u2212": "-", "\u2013": "-", "\u2010": "-", "\u00ba": "\u00b0", "\u22c5": "\u00b7",
                        "\u2219": "\u00b7", "\u2022": "\u00b7"})
# Powers of ten as they are printed, which would be read as more digits: 10², 5×10⁻³, 5 * 10^-3.
_POWER = re.compile(r"\s*(?:([+-]?[\d.]+)\s*[×x*·]\s*)?10(?:(?:\^|\*\*)([+-]?\d+)|([⁺⁻]?[⁰¹²³⁴-⁹]+))")
_SMALL_DIGIT = re.compile(r"(^\s*|[\d.][⁺⁻]?)[⁰¹²³⁴-⁹₀-₉①-⑳]")
_LEAST_ANGLE = 1.0  # rad: larger angles with two decimals at most, and no unit, look like degrees


def parse_quantity(value: object, unit: str = "") -> float:
    """Return ``value`` as a number in ``unit``.

    Parameters
    ----------
    value : a number, taken as already in ``unit``, or a string such as "40 mN/m", "85 %" or "1.5 mL/s". Typographic
        signs are read as those of the keyboard, such as −, ³ and ⁻¹.
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
        signs = value[:_LONGEST].translate(_SIGNS)
        if _SMALL_DIGIT.search(signs) or _POWER.match(signs):
            raise ValueError(f'"{printable(value)}" with a power, but must be {_wanted(unit)}, with powers of ten as '
                             f"in 1e-3{_without_power(value)}")
        match = len(value) <= _LONGEST and _NUMBER.fullmatch(_plain(value))
        if not match:
            raise ValueError(f'"{printable(str(value))}", but must be {_wanted(unit)}')
        if match[2].startswith(","):
            raise ValueError(f'"{printable(value)}" with a comma, but must be {_wanted(unit)}, with a point '
                             f"(did you mean {printable(_with_point(value))}?)")
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
    return isinstance(value, str) and not is_bare(value)


def is_bare(value: object) -> bool:
    """Tell whether a value that can be parsed carries no unit."""
    return not isinstance(value, str) or not _NUMBER.fullmatch(_plain(value))[2]


def likely(value: object, unit: str, allowed: Callable[[float], bool] = lambda number: True) -> str:
    """Return what a number without a unit probably means, as a question; empty where nothing is likely.

    Parameters
    ----------
    unit : what it is taken to be in. allowed : whether a number in that unit can be meant.

    Examples
    --------
    >>> likely(85, ""), likely("24", "m"), likely("24 m", "m")
    (' (did you mean 85 %?)', ' (did you mean 24 mm?)', '')
    """
    text = f"{str(value).strip()} {_USUAL[unit][0]}" if unit in _USUAL and is_bare(value) else ""
    return f" (did you mean {printable(text)}?)" if text and allowed(parse_quantity(text, unit)) else ""


def looks_like_degrees(value: object, unit: str) -> bool:
    """Tell whether a number without a unit would be an angle in radians as nobody writes one.

    >>> looks_like_degrees(18.2, "rad"), looks_like_degrees(1.5707963, "rad"), looks_like_degrees("3 rad", "rad")
    (True, False, False)
    """
    number = parse_quantity(value, unit) if unit == "rad" and is_bare(value) else 0.0
    return abs(number) >= _LEAST_ANGLE and round(number, 2) == number


def _with_point(text: str) -> str:
    """A quantity whose number has a decimal comma, or commas between thousands, as it is written here."""
    def written(match: re.Match) -> str:
        digits = match[0].replace(".", "") if re.fullmatch(r"[1-9]\d{0,2}(\.\d{3})+,\d+", match[0]) else match[0]
        thousands = re.fullmatch(r"[1-9]\d{0,2}(,\d{3})+(\.\d+)?", digits)
        return digits.replace(",", "" if thousands else ".")

    return re.sub(r"[\d,.]*\d", written, _plain(text).strip(), count=1)


def _without_power(text: str) -> str:
    """A quantity whose number has a power of ten as it is printed, as a question, or nothing."""
    match = _POWER.match(text.translate(_SIGNS))
    if match is None:
        return ""
    exponent = unicodedata.normalize("NFKC", match[2] or match[3]).translate(_SIGNS)
    return f" (did you mean {printable(f'{match[1] or 1}e{exponent}{text[match.end():]}')}?)"


def _plain(text: str) -> str:
    """A quantity with signs of the keyboard: minus, exponents and products as ASCII has them, and Pas as Pa s."""
    text = unicodedata.normalize("NFKC", text.translate(_SIGNS)).translate(_SIGNS)
    text = re.sub(r"(?<=[A-Za-z])\.(?=[A-Za-z])", "\u00b7", text)
    return re.sub(r"(?<![A-Za-z])([m\u00b5\u03bc]?)Pas\b", r"\1Pa s", text)


def _nearest_unit(text: str, unit: str) -> str:
    """The usual unit that is most like what was written, as a question, or nothing."""
    meant = {name.lower(): one for one in _USUAL.get(unit, ()) for name in (one, *_SPOKEN.get(one, ()))}
    matches = difflib.get_close_matches(text.lower(), meant, n=1)
    return f" (did you mean {meant[matches[0]]}?)" if matches else ""


def _convert(number: float, text: str, unit: str, value: object) -> float:
    source = _parse_unit(text)
    if source is None:
        raise ValueError(f'"{printable(str(value))}" with the unknown unit "{printable(text)}", '
                         f"but must be {_wanted(unit)}{_nearest_unit(text, unit)}")
    target = _parse_unit(unit)
    if source.dimensionality != target.dimensionality or _is_angle(source) != _is_angle(target):
        raise ValueError(f'"{printable(str(value))}", but must be {_wanted(unit)}{_nearest_unit(text, unit)}')
    converted = _registry().Quantity(number, source).to(target).magnitude
    return float(f"{converted:.15g}")  # "1.5 mL" is 1.5e-6 m3, not 1.5000000000000002e-6


def _describe(value: object) -> str:
    kinds = {bool: str(value).lower(), dict: "a mapping", list: "a list", type(None): "empty"}
    return kinds.get(type(value), f"the {type(value).__name__} {value}")


def _wanted(unit: str) -> str:
    if unit.startswith("rad"):
        return f"in {unit.replace('rad', 'deg')} or {unit}"
    return f"in {unit.replace('**', '').replace('*', ' ')}" if unit else 'a pure number (or in "%")'


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
