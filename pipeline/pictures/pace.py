"""How fast a movie plays."""
import dataclasses
import math

SHORTEST = 8.0          # s, so that the eye can follow
MOST_PER_SECOND = 30.0  # pictures: players drop more
HOLD = 1.5              # s that the last picture stays at least
PLAYED = 25.0           # pictures per second that players like, about: slower ones are repeated
STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)  # speeds are one of these and a power of ten: 0.5, 0.25, 0.2, 0.1 ...
UNITS = (("week", 604800.0), ("day", 86400.0), ("hour", 3600.0), ("minute", 60.0), ("second", 1.0))


@dataclasses.dataclass(frozen=True)
class Pace:
    """How fast pictures follow each other.

    Attributes
    ----------
    rate : pictures per second.
    hold : s that the last one stays beyond its own time.
    speed : simulated seconds per second; None where the time between pictures is not known.
    repeats : how often a movie has every picture.
    """

    rate: float
    hold: float
    speed: float | None
    repeats: int = 1

    def duration(self, pictures: int) -> float:
        """Return how long a movie of so many pictures lasts, s."""
        return pictures / self.rate + self.hold


def pace_of(pictures: int, interval: float | None) -> Pace:
    """Return the fastest even speed at which the pictures take `SHORTEST` seconds at least.

    Parameters
    ----------
    interval : simulated time between two pictures, s; None where it is not known.
    """
    rate = min(max(pictures - 1, 1) / SHORTEST, MOST_PER_SECOND)
    speed = None
    if interval is not None:
        speed = even_speed(rate * interval)
        rate = speed / interval
    return Pace(rate, max(HOLD - 1.0 / rate, 0.0), speed, max(1, round(PLAYED / rate)))


def even_speed(limit: float) -> float:
    """Return the largest of the even speeds (`STEPS`) up to a limit.

    >>> [even_speed(limit) for limit in (0.6, 0.25, 0.03, 1.9)]
    [0.5, 0.25, 0.025, 1.0]
    """
    power = 10.0 ** math.floor(math.log10(limit))
    return float(f"{power * max(step for step in STEPS if step * power <= limit * (1.0 + 1e-9)):.3g}")


def speed_in_words(speed: float, second_means: float | None) -> str:
    """Return what a second of a movie shows.

    Parameters
    ----------
    speed : simulated seconds per second.
    second_means : what a simulated second stands for, s; None where that is a second.

    >>> speed_in_words(0.5, None), speed_in_words(1.0, None), speed_in_words(0.25, 2419200.0)
    ('0.5 × real time', 'real time', '1 week per second')
    """
    if second_means is None:
        return "real time" if speed == 1.0 else f"{speed:g} × real time"
    shown = speed * second_means
    unit, size = next(((unit, size) for unit, size in UNITS if shown >= size * (1.0 - 1e-9)), UNITS[-1])
    number = f"{shown / size:.3g}"
    return f"{number} {unit}{'' if number == '1' else 's'} per second"
