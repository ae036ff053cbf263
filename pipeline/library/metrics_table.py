"""The metrics of a run as a table in a notebook."""
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from pipeline.base.errors import UserError
from pipeline.base.tables import TIME
from pipeline.base.words import nearest
from pipeline.measures.metric import Metric
from pipeline.measures.shown import shown_metrics
from pipeline.measures.summary import changing, constant


class MetricsTable(Mapping[str, np.ndarray]):
    """A mapping of columns: name -> (frames,) float64, NaN where nothing was measured; a notebook shows it as a table.

    A column is asked for with its unit, "retina_coverage_whole [%]", or without. ``pandas.DataFrame(table)`` works.

    Parameters
    ----------
    columns : the columns by name, with units.
    metrics : what the columns mean.

    Attributes
    ----------
    metrics : what the columns mean, a :class:`Metric` for one or several of them.

    Examples
    --------
    >>> table = MetricsTable({"frame": np.arange(2.0), "time [s]": np.array([0.0, 0.5]),
    ...                       "fill [%]": np.array([85.0, 85.1])}, [])
    >>> table
    <2 frames, 0 to 0.5 s: frame, time, fill>
    >>> f"{table['fill'].max()} {table.unit('fill')}"
    '85.1 %'
    """

    def __init__(self, columns: Mapping[str, np.ndarray], metrics: Sequence[Metric]):
        self._columns, self.metrics = dict(columns), list(metrics)
        self._short = {column.partition(" [")[0]: column for column in self._columns}

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a column.

        Raises
        ------
        UserError : there is none of that name; which is a KeyError too, as of any mapping.
        """
        column = self._short.get(name, name)
        if column not in self._columns:
            raise UnknownColumn(f"{name}: no such column of the metrics{nearest(name, self._short)}; there are "
                                f"{', '.join(self._short)}")
        return self._columns[column]

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    @property
    def time(self) -> np.ndarray:
        """Times of the frames, (frames,), s."""
        return self._columns[TIME]

    def unit(self, name: str) -> str:
        """Return the unit of a column, "1" for a number without."""
        self[name]
        return self._short.get(name, name).partition(" [")[2].rstrip("]")

    def _repr_html_(self) -> str:
        shown = shown_metrics(self._columns, self.metrics)
        return str(changing(shown)) + (str(constant(shown)) if any(one.constant for one in shown) else "")

    def __repr__(self) -> str:
        return f"<{len(self.time)} frames, {self.time[0]:g} to {self.time[-1]:g} s: {', '.join(self._short)}>"


class UnknownColumn(UserError, KeyError):
    """A column that is not in a table."""

    __str__ = UserError.__str__
