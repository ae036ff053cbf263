"""Closed lines around the regions of a plane where a field is positive, and the area of these regions."""
import dataclasses

import numpy as np
from skimage.measure import find_contours

from pipeline.surfaces.contour import away_from_zero


@dataclasses.dataclass(frozen=True)
class ContourLines:
    """Closed lines: a list of points (k, 2) in m, the last equal to the first; holes run the other way round."""

    lines: list[np.ndarray]

    @property
    def volume(self) -> float:
        """Enclosed area, m**2."""
        return float(sum(self._areas()))

    @property
    def counts(self) -> dict[str, int]:
        """Size of the lines for the statistics."""
        return {"segments": sum(len(line) - 1 for line in self.lines)}

    @property
    def points(self) -> np.ndarray:
        """Points (n, 2) of all lines without the repeated last ones, m."""
        return np.concatenate([line[:-1] for line in self.lines]) if self.lines else np.zeros((0, 2))

    def is_closed(self) -> bool:
        """Whether every line ends where it begins."""
        return all(np.array_equal(line[0], line[-1]) for line in self.lines)

    def component_volumes(self) -> np.ndarray:
        """Signed area of every line, m**2, the largest first; holes count negative."""
        return np.sort(self._areas())[::-1]

    def _areas(self) -> np.ndarray:
        # The first point as origin keeps the digits of small lines far from the corner of the container.
        return np.array([signed_area(line - line[0]) for line in self.lines])


def signed_area(line: np.ndarray) -> float:
    """Area (m**2) inside a closed line (k, 2), negative where it runs clockwise."""
    x, y = line.T
    return float(0.5 * (x[:-1] * y[1:] - x[1:] * y[:-1]).sum())


def contour_lines(field: np.ndarray, origin: np.ndarray, cell: float) -> ContourLines:
    """Lines where ``field`` (nx, ny), positive inside, crosses zero; the border of the grid counts as outside."""
    padded = np.pad(away_from_zero(field), 1, constant_values=-1.0)
    if not (padded > 0).any():
        return ContourLines([])
    lines = find_contours(padded, 0.0, fully_connected="high", positive_orientation="high")
    return ContourLines([np.asarray(origin) + (line - 1.0) * cell for line in lines])


def enclosed_areas(fields: np.ndarray, cell: float) -> np.ndarray:
    """Area (k,), m**2, that ``contour_lines`` encloses in each field (k, nx, ny), without the lines: much faster.

    Inner cells count whole. In a cell with a sign change the region is the polygon of its positive corners and of the
    points where its sides cross zero, in this order around the cell.
    """
    padded = np.pad(away_from_zero(fields), ((0, 0), (1, 1), (1, 1)), constant_values=-1.0)
    inside = (padded > 0.0).astype(np.int8)
    positive = inside[:, :-1, :-1] + inside[:, 1:, :-1] + inside[:, 1:, 1:] + inside[:, :-1, 1:]
    field, row, column = np.nonzero((positive > 0) & (positive < 4))
    cut = np.stack([padded[field, row + i, column + j] for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))], axis=-1)
    place = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    points, valid = [], []
    for k in range(4):
        following = (k + 1) % 4
        here, there = cut[:, k], cut[:, following]
        crosses = (here > 0.0) != (there > 0.0)
        share = np.where(crosses, here / np.where(crosses, here - there, 1.0), 0.0)[:, None]
        points += [np.broadcast_to(place[k], (len(cut), 2)), place[k] + share * (place[following] - place[k])]
        valid += [here > 0.0, crosses]
    parts = np.bincount(field, _polygon_areas(points, valid), minlength=len(fields))
    return cell**2 * ((positive == 4).sum(axis=(1, 2)) + parts)


def _polygon_areas(points: list[np.ndarray], valid: list[np.ndarray]) -> np.ndarray:
    """Area (n,) of n polygons, whose corners are the valid ones among the points (n, 2) each."""
    last = points[0]
    for point, use in zip(points, valid, strict=True):      # the last valid one, where the walk around ends
        last = np.where(use[:, None], point, last)
    area = np.zeros(len(last))
    for point, use in zip(points, valid, strict=True):
        step = np.where(use, 0.5 * (last[:, 0] * point[:, 1] - point[:, 0] * last[:, 1]), 0.0)
        area += step
        last = np.where(use[:, None], point, last)
    return area
