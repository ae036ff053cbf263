"""Metrics as they are shown: in the order of interest, with the digits that mean something and a unit that fits."""
import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from pipeline.base.numbers import digits_of, plain, with_uncertainty
from pipeline.measures.metric import Metric

DIGITS = 3
ROUND_OFF = 1e-9  # shares and counts below it are none
WITH_PREFIX = ("J", "Pa", "s")
METERS = {"mm": "m", "mm/s": "m/s"}  # in containers, from a thousand on
UNITS = {"1": "", "cm2": "cm²", "um": "µm"}  # that readers write in another way
PREFIXES = {1.0: "", 1e-3: "m", 1e-6: "µ", 1e-9: "n", 1e-12: "p"}


@dataclasses.dataclass(frozen=True)
class Curve:
    """One column of a metric.

    Attributes
    ----------
    part : what tells it from the other columns of the metric; empty where there is one only.
    values : (frames,), NaN where nothing was measured.
    uncertainty : (frames,), half the width of the band around them, NaN or 0 where none is known.
    decimals : digits after the point that are printed.
    """

    part: str
    values: np.ndarray
    uncertainty: np.ndarray
    decimals: int

    @property
    def known(self) -> np.ndarray:
        """Whether there is a number, (frames,)."""
        return np.isfinite(self.values)

    @property
    def whole(self) -> bool:
        """Whether all are whole numbers."""
        return not (self.values[self.known] % 1.0).any()

    @property
    def constant(self) -> bool:
        """Whether it stays the same within the digits that are printed, or was never measured."""
        known = self.values[self.known]
        return not len(known) or bool(np.ptp(known) < 0.999 * 10.0**-self.decimals)

    def text(self, frame: int) -> str:
        """One number, with its uncertainty where there is one."""
        value, uncertainty = self.values[frame], self.uncertainty[frame]
        if not np.isfinite(value):
            return ""
        return with_uncertainty(value, uncertainty, self.decimals)

    def beside(self, other: float, frame: int) -> str:
        """Another number, to stand beside one of these in the same digits."""
        return plain(other, digits_of(self.uncertainty[frame], self.decimals))

    def texts(self) -> list[str]:
        """Numbers at the start and at the end, the smallest and the largest; empty where nothing was measured."""
        frames = np.flatnonzero(self.known)
        if not len(frames):
            return [""] * 4
        known = self.values[frames]
        return [self.text(frame) for frame in (frames[0], frames[-1], frames[known.argmin()], frames[known.argmax()])]


@dataclasses.dataclass(frozen=True)
class Shown:
    """A metric with its curves, in a unit that fits."""

    metric: Metric
    unit: str
    curves: tuple[Curve, ...]

    @property
    def name(self) -> str:
        """Name for readers."""
        return self.metric.name.replace("_", " ")

    @property
    def label(self) -> str:
        """Name with the unit."""
        return f"{self.name}{self.unit and f' [{self.unit}]'}"

    @property
    def constant(self) -> bool:
        """Whether no curve changes, so that there is nothing to draw."""
        return not self.metric.yes_or_no and all(curve.constant for curve in self.curves)


def columns_by_metric(table: Iterable[str], metrics: Iterable) -> dict[str, dict[str, str]]:
    """Return the columns of every metric: name -> {column: what tells it from the metric's other columns}."""
    grouped: dict[str, dict[str, str]] = {metric.name: {} for metric in metrics}
    for column in table:
        name = column.partition(" [")[0]
        owners = [known for known in grouped if name == known or name.startswith(f"{known}_")]
        if owners:
            owner = max(owners, key=len)  # `time_step` is no part of `time`
            grouped[owner][column] = name.removeprefix(owner).lstrip("_")
    return grouped


def shown_metrics(table: Mapping[str, np.ndarray], metrics: Sequence[Metric]) -> list[Shown]:
    """Return the metrics of a table, column -> (frames,), the most interesting first."""
    grouped = columns_by_metric(table, metrics)
    return [_shown(metric, grouped[metric.name], table) for metric in sorted(metrics, key=lambda one: one.place)
            if grouped[metric.name]]


def _shown(metric: Metric, columns: Mapping[str, str], table: Mapping[str, np.ndarray]) -> Shown:
    values = {part: np.asarray(table[column], float) for column, part in columns.items()}
    unit = UNITS.get(metric.unit, metric.unit)
    if unit in ("", "%"):
        values = {part: np.where(np.abs(numbers) < ROUND_OFF, 0.0, numbers) for part, numbers in values.items()}
    largest = max(map(_largest, values.values()))
    if unit in WITH_PREFIX and largest > 0.0 and metric.name != "time":  # which is that of the plots
        factor = next((one for one in PREFIXES if largest >= one), min(PREFIXES))
        unit, largest = PREFIXES[factor] + unit, largest / factor
        values = {part: numbers / factor for part, numbers in values.items()}
    if unit in METERS and largest >= 1e3:
        unit, largest = METERS[unit], 1e-3 * largest
        values = {part: 1e-3 * numbers for part, numbers in values.items()}
    curves = []
    for part, numbers in values.items():
        decimals = min(_decimals(_largest(numbers)), _decimals(largest) + 1)
        band = table.get(f"{metric.uncertainty}{part and f'_{part}'} [{metric.unit}]")
        uncertainty = np.full(len(numbers), np.nan) if band is None else 0.5 * np.asarray(band, float)
        curve = Curve(part.replace("_", " "), numbers, uncertainty, decimals)
        curves.append(dataclasses.replace(curve, decimals=0) if curve.whole else curve)
    return Shown(metric, unit, tuple(curves))


def _largest(numbers: np.ndarray) -> float:
    """Largest size of the numbers (n,) that there are; 0 without any."""
    return float(np.abs(numbers[np.isfinite(numbers)]).max(initial=0.0))


def _decimals(largest: float) -> int:
    """Digits after the point of numbers up to a size."""
    return max(DIGITS - 1 - math.floor(math.log10(largest)), 0) if largest > 0.0 else 0
