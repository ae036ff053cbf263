"""What effects and schemes say of a scene before it is run: sentences, numbers, limits of the time step.

The hooks of :class:`sim.effects.effect.Effect` that say something get its :class:`sim.scales.Scales`.
"""
import dataclasses
import math
from collections.abc import Iterator, Sequence

SEEN_EFFECT, WARNING, NOTE = "matters", "warning", "note"
# In particle spacings: what moves, spreads or acts over less than one is lost between neighboring particles.
SEEN = 1.0
EARTH_GRAVITY = 9.81  # m/s2, where a scene has no gravity of its own
ESTIMATE = "estimate: "


@dataclasses.dataclass(frozen=True)
class Advice:
    """One sentence about an effect; ``level`` is "matters", "warning" or "note"."""

    level: str
    effect: str
    sentence: str


@dataclasses.dataclass(frozen=True)
class Quantity:
    """A number of the scene with its unit (SI) and its definition in a phrase."""

    name: str
    value: float
    unit: str
    meaning: str


@dataclasses.dataclass(frozen=True)
class Limit:
    """A limit of the time step.

    Attributes
    ----------
    source : key of the scene file or part of the solver that sets it.
    value : s, infinite where this source sets none.
    meaning : where the number comes from.
    """

    source: str
    value: float
    meaning: str


Sentences = Iterator[Advice]


def shown(value: float, unit: str) -> str:
    """Return a number in SI as people read it: three digits, small lengths, speeds and times in thousandths."""
    if math.isinf(value):
        return "none"
    if unit in ("m", "s", "m/s") and 0.0 < abs(value) < 0.1:
        return f"{1e3 * value:.3g} m{unit}"
    return f"{value:.3g} {unit}".rstrip()


def long_time(value: float) -> str:
    """Return a time, s, in the unit that fits.

    >>> long_time(5400.0), long_time(0.5)
    ('1.5 h', '0.5 s')
    """
    unit, size = next(((unit, size) for unit, size in (("days", 86400.0), ("h", 3600.0), ("min", 60.0))
                       if value >= size), ("s", 1.0))
    return f"{value / size:.3g} {unit}"


def times(reach: float, scales) -> str:
    """Return a length with its size in particle spacings and the threshold from which it is seen."""
    return f"{shown(reach, 'm')} ({reach / scales.spacing:.3g} particle spacings; seen from {SEEN:g})"


def is_seen(reach: float, scales) -> bool:
    """Whether a length, m, is seen among particles."""
    return reach >= SEEN * scales.spacing


def if_zero(effect: str, parameters, key: str, unit: str) -> Sentences:
    """Warn of an effect whose coefficient is zero."""
    if getattr(parameters, key) == 0.0:
        yield Advice(WARNING, effect, f"does nothing: its {key} is 0 {unit}, not above 0")


def if_alone(effect: str, scales) -> Sentences:
    """Warn of an effect between two liquids where there is one only."""
    if len(scales.liquids) == 1:
        yield Advice(WARNING, effect, "cannot be seen: it acts between 2 liquids, but 1 is ever in the cavity, "
                                      f"{scales.liquids[0].name}")


def without_unit(effect: str, parameters, key: str) -> Sentences:
    """Note that a coefficient of a force is no tension."""
    value = getattr(parameters, key)
    if value:
        yield Advice(NOTE, effect, f"its {key} of {value:g} is above 0, but no tension in N/m: Bo, We, Ca and Oh are "
                                   "unknown")


def smallest(limits: Sequence[Limit], without: str = "") -> float:
    """Return the smallest limit of the time step but that of one source, s."""
    return min(limit.value for limit in limits if limit.source != without)
