"""When the breaks of a scene were covered, over all frames: what a surgeon asks of a run."""
import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from pipeline.base.tables import TIME
from pipeline.base.words import duration
from pipeline.measures.places import FARTHEST
from pipeline.scenes.eye_shape import globe_of
from pipeline.scenes.model import Scene

HEADS = ("break", "where", "at the end", "first covered", "longest time not covered", "covered of the time")
EXPLAINED = ("A break is covered when all of it is under oil. In brackets, what a number may be: half a particle "
             "spacing decides. Between frames the contact line is taken to move evenly.")
IN_A_LAPSE = ("Times are those that the time-lapse stands for. The liquids settle in their own time, which looks far "
              "longer than it is: times not covered just after a turn are too long.")
Spans = list[tuple[float, float]]


@dataclasses.dataclass(frozen=True)
class Times:
    """When a break was covered, s.

    Attributes
    ----------
    first_covered : NaN where it never was.
    longest_bare : 0 where it always was covered.
    covered_share : of the whole time.
    """

    first_covered: float
    longest_bare: float
    covered_share: float

    @classmethod
    def of(cls, time: np.ndarray, margin: np.ndarray) -> "Times":
        """Read them from the margin of a break, (frames,), positive where it is covered."""
        spans, length = covered_spans(time, margin), float(time[-1] - time[0])
        edges = [time[0], *(edge for one in spans for edge in one), time[-1]]
        bare = [end - begin for begin, end in zip(edges[::2], edges[1::2], strict=True)]
        covered = sum(end - begin for begin, end in spans)
        return cls(spans[0][0] if spans else np.nan, float(max(bare)),
                   covered / length if length else float(margin[-1] > 0.0))


@dataclasses.dataclass(frozen=True)
class Course:
    """A break over time.

    Attributes
    ----------
    where : in words.
    margin : mm, at the end, and half a particle spacing.
    times, least, most : as the margin is, and if it is half a particle spacing less or more.
    second_means : s, of a time-lapse.
    """

    name: str
    where: str
    margin: tuple[float, float]
    times: Times
    least: Times
    most: Times
    second_means: float | None

    @property
    def at_end(self) -> str:
        """Whether it is covered at the end, in words."""
        value, doubt = self.margin
        if abs(value) >= 1e3 * FARTHEST:
            return f"{'covered' if value > 0.0 else 'not covered'}, as is all of the wall"
        if abs(value) < doubt:
            return "uncertain (less than half a particle spacing decides)"
        return f"covered, and the oil reaches {value:.1f} mm beyond" if value > 0.0 else (
            f"not covered in part: the oil would have to reach {-value:.1f} mm further")

    def sentence(self) -> str:
        """Return it in one sentence."""
        first = "never covered" if np.isnan(self.times.first_covered) else f"first covered after {self._first()}"
        return (f"Break {self.name.replace('_', ' ')}: at the end {self.at_end}; {first}, longest time not covered "
                f"{self._bare()}, covered {self._share()} of the time.")

    def cells(self) -> tuple[str, ...]:
        """Return its row of a table with ``HEADS``."""
        return self.name, self.where, self.at_end, self._first(), self._bare(), self._share()

    def record(self) -> dict[str, Any]:
        """Return it as plain data, times in simulated seconds, unknown ones as None."""
        def plain(times: Times) -> dict[str, float | None]:
            return {name: None if np.isnan(value) else float(value)
                    for name, value in dataclasses.asdict(times).items()}
        value, doubt = self.margin
        return {"name": self.name, "where": self.where, "at_end": self.at_end,
                "margin_at_end [mm]": value, "uncertainty [mm]": doubt,
                "times [s]": plain(self.times), "half_a_spacing_less": plain(self.least),
                "half_a_spacing_more": plain(self.most)}

    def _first(self) -> str:
        return self._ranged("first_covered", self._span)

    def _bare(self) -> str:
        return self._ranged("longest_bare", self._span)

    def _share(self) -> str:
        return self._ranged("covered_share", lambda value: f"{100.0 * value:.0f} %")

    def _ranged(self, name: str, worded: Callable[[float], str]) -> str:
        """A number in words, with what it may be where that differs."""
        value = worded(getattr(self.times, name))
        ends = np.sort([getattr(times, name) for times in (self.least, self.most)])  # NaN comes last
        low, high = (worded(float(end)) for end in ends)
        if low == high:
            return value if low == value else f"{value} ({low})"
        return f"{value} ({low} to {high})"

    def _span(self, value: float) -> str:
        return "never" if np.isnan(value) else duration(value * (self.second_means or 1.0))


def covered_spans(time: np.ndarray, margin: np.ndarray) -> Spans:
    """Spans of time in which a margin (frames,) is positive; between frames it changes evenly.

    >>> covered_spans(np.array([0.0, 1.0, 2.0]), np.array([-1.0, 1.0, 1.0]))
    [(0.5, 2.0)]
    """
    inside = margin > 0.0
    spans, begin = [], float(time[0]) if inside[0] else None
    for index in np.flatnonzero(inside[1:] != inside[:-1]):
        share = margin[index] / (margin[index] - margin[index + 1])
        moment = float(time[index] + share * (time[index + 1] - time[index]))
        if begin is None:
            begin = moment
        else:
            spans.append((begin, moment))
            begin = None
    return [*spans, (begin, float(time[-1]))] if begin is not None else spans


def courses_of(table: Mapping[str, np.ndarray], scene: Scene) -> list[Course]:
    """Return the course of every break of a scene.

    Parameters
    ----------
    table : metrics, column -> (frames,).
    """
    if scene.eye is None:
        return []
    found, doubt = [], 0.5e3 * scene.numerics.particle_spacing
    for name, patch in scene.patches(globe_of(scene.eye))["breaks"].items():
        margin = np.asarray(table[f"break_margin_{name} [mm]"], float)
        times, least, most = (Times.of(table[TIME], margin + more) for more in (0.0, -doubt, doubt))
        found.append(Course(name, patch.words(scene.eye.side), (float(margin[-1]), doubt), times, least, most,
                            scene.output.second_means))
    return found
