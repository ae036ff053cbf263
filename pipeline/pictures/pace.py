"""How fast a movie plays."""
import dataclasses
import math

RATE = 24.0             # pictures per second, as in the cinema
SHORTEST = 3.0          # s so that the eye can follow: pictures that are fewer play more slowly
HOLD = 1.5              # s that the last picture stays at least
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

    def in_words(self, pictures: int, second_means: float | None = None) -> str:
        """Return how a movie of so many pictures plays, and why it shows few of them in a second.

        Parameters
        ----------
        second_means : what a simulated second stands for, s; None where that is a second.

        >>> pace_of(201, 0.05).in_words(201)
        '1.2 × real time, 24 pictures per second, 201 in all, 9.83 s'
        >>> pace_of(21, 0.1).in_words(21)
        '0.5 × real time, 5 pictures per second, 21 in all, 5.5 s; the scene saves a frame every 0.1 s'
        """
        speed = "" if self.speed is None else f"{speed_in_words(self.speed, second_means)}, "
        few = "" if self.speed is None or self.rate >= RATE else \
            f"; the scene saves a frame every {self.speed / self.rate:g} s"
        rate = f"{self.rate:.3g} picture{'' if self.rate == 1.0 else 's'} per second"
        return f"{speed}{rate}, {pictures} in all, {self.duration(pictures):.3g} s{few}"


def pace_of(pictures: int, interval: float | None) -> Pace:
    """Return `RATE`, or the fastest even speed at which the pictures take `SHORTEST` seconds at least.

    Parameters
    ----------
    interval : simulated time between two pictures, s; None where it is not known.
    """
    rate = min(max(pictures - 1, 1) / SHORTEST, RATE)
    speed = None if interval is None else rate * interval
    if speed is not None and rate < RATE:
        speed = even_speed(speed)
        rate = speed / interval
    return Pace(rate, max(HOLD - 1.0 / rate, 0.0), speed, max(1, round(RATE / rate)))


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
