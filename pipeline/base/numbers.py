"""Numbers as people read them: with the digits that their uncertainty leaves, the same wherever they stand."""
import math


def plain(value: float, decimals: int) -> str:
    """Return a number with so many digits after the point, without the sign of a zero.

    >>> plain(-0.001, 1), plain(2.25, 0)
    ('0.0', '2')
    """
    text = f"{value:.{max(decimals, 0)}f}"
    return text.lstrip("-") if not text.strip("-0.") else text


def decimals_of(uncertainty: float) -> int:
    """Return the digits after the point that an uncertainty leaves: its first one, or two where that is a 1.

    >>> decimals_of(4.2), decimals_of(1.4), decimals_of(15.5), decimals_of(0.28)
    (0, 1, 0, 1)
    """
    first = math.floor(math.log10(uncertainty))
    return max(1 - first if f"{uncertainty:e}"[0] == "1" else -first, 0)


def with_uncertainty(value: float, uncertainty: float, decimals: int) -> str:
    """Return a number, with what it is uncertain by where that is known.

    Parameters
    ----------
    uncertainty : NaN or 0 where none is known.
    decimals : digits after the point at most.

    >>> with_uncertainty(81.93, 4.1, 1), with_uncertainty(42.461, 15.51, 1), with_uncertainty(99.93, 0.28, 1)
    ('82 ± 4', '42 ± 16', '99.9 ± 0.3')
    >>> with_uncertainty(100.0, 0.0, 1)
    '100.0'
    """
    digits = digits_of(uncertainty, decimals)
    return f"{plain(value, digits)} ± {plain(uncertainty, digits)}" if uncertainty > 0.0 else plain(value, digits)


def digits_of(uncertainty: float, decimals: int) -> int:
    """Return the digits after the point of a number: those that its uncertainty leaves, where one is known."""
    return min(decimals_of(uncertainty), decimals) if uncertainty > 0.0 else decimals
