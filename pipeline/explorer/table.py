"""The table of shapes of one eye and one tamponade: made direction by direction, and kept in eight bits."""
import dataclasses
import itertools
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from pipeline.base.errors import UserError
from pipeline.base.files import replacing
from pipeline.explorer.cases import AZIMUTHS, FILLS, LATITUDES, MERIDIANS, TILTS, Tamponade
from pipeline.explorer.chart import Chart
from pipeline.explorer.shapes import PARTS, Shape, Views, shape_at
from pipeline.scenes.load import PROJECT_CONFIG

FOLDER = PROJECT_CONFIG / "oil_at_rest" / "explorer"
REACH = 8e-3                # m from the contact line, where the margin is cut off
DEEPEST = 25e-3             # m, a gap that no eye exceeds
SHARE_STEP = 0.002          # of what shares may be less or more
SHIFT_STEP = 0.02e-3        # m, of the contact line
NODES = (len(TILTS), len(AZIMUTHS), len(FILLS))
VIEW_STEP = 0.1e-3          # m, of the viewpoint
POLES = (0, len(TILTS) - 1)     # tilts at which every azimuth is the same direction
LEANING = 0.05                  # of a half of the retina: a shape that covers so much more of the other leans to it


@dataclasses.dataclass(frozen=True)
class Table:
    """Shapes at rest for directions and fills; the first three axes are ``TILTS``, ``AZIMUTHS`` and ``FILLS``.

    Attributes
    ----------
    margin : (..., latitudes, meridians) uint8: 1 to 255 mean -``REACH`` to ``REACH``.
    gap : (..., latitudes, meridians) uint8: the root of gap over ``DEEPEST``, in 255 steps.
    doubt : (..., 10) uint8: what shares may be less (4) and more (4), and how far the contact line lies back and beyond
        then (2), which ``with_shifts`` fills in.
    view : (..., 3) uint8: 128 is 0, in steps of ``VIEW_STEP``, the viewpoint of the gap as ``Shape`` has it.
    shares : (..., 4) float32, covered shares of ``PARTS`` of the shapes themselves.
    """

    margin: np.ndarray
    gap: np.ndarray
    doubt: np.ndarray
    view: np.ndarray
    shares: np.ndarray

    @classmethod
    def of(cls, shapes: list[Shape | None]) -> "Table":
        """Pack shapes, one behind the other. Where none was found all is zero."""
        size = (len(LATITUDES), len(MERIDIANS))
        nothing = (np.zeros(size), np.zeros(size), np.zeros(10), np.zeros(3), np.full(len(PARTS), np.nan))
        *fields, shares = zip(*(nothing if one is None else (
            128.0 + 127.0 * np.clip(one.margin / REACH, -1.0, 1.0),
            255.0 * np.sqrt(np.clip(one.gap / DEEPEST, 0.0, 1.0)),
            np.concatenate([one.low / SHARE_STEP, one.high / SHARE_STEP, np.zeros(2)]),
            128.0 + one.view / VIEW_STEP, one.shares) for one in shapes), strict=True)
        margin, gap, doubt, view = (np.rint(np.clip(values, 0.0, 255.0)).astype(np.uint8) for values in fields)
        return cls(margin, gap, doubt, view, np.array(shares, np.float32))

    def with_shifts(self, chart: Chart) -> "Table":
        """Return the table with how far the contact line moves where the retina is covered by less and by more."""
        doubt = self.doubt.copy()
        for node in np.ndindex(self.margin.shape[:-2]):
            margin = margin_of(self.margin[node])
            for place, change in ((8, -SHARE_STEP * doubt[node][0]), (9, SHARE_STEP * doubt[node][4])):
                doubt[node][place] = np.rint(chart.shift(margin, change) / SHIFT_STEP)
        return dataclasses.replace(self, doubt=doubt)

    def write(self, path: Path) -> None:
        """Write the table by rename."""
        with replacing(path) as temporary:
            np.savez_compressed(temporary, **dataclasses.asdict(self))

    @classmethod
    def read(cls, path: Path) -> "Table":
        """Read a table.

        Raises
        ------
        UserError : the file is damaged.
        """
        try:
            with np.load(path) as file:
                return cls(**{name: file[name] for name in file.files})
        except (OSError, ValueError, TypeError) as error:
            raise UserError(f"{path} is damaged ({error}); remove it, and make it again with "
                            "python -m pipeline.explorer_tables") from error


def margin_of(values: np.ndarray) -> np.ndarray:
    """Margins, m, from those of a table."""
    return REACH * (np.asarray(values, float) - 128.0) / 127.0


def gap_of(values: np.ndarray) -> np.ndarray:
    """Gaps, m, from those of a table."""
    return DEEPEST * (np.asarray(values, float) / 255.0) ** 2


def view_of(values: np.ndarray) -> np.ndarray:
    """Viewpoints, m, from those of a table."""
    return VIEW_STEP * (np.asarray(values, float) - 128.0)


def path_of(eye: str, tamponade: str, folder: Path = FOLDER) -> Path:
    """Return the file of a table."""
    return folder / f"{eye}mm_{tamponade}.npz"


def directions() -> Iterator[tuple[int, int]]:
    """Indices of tilt and azimuth of the directions that are computed; the rest are turns of these."""
    for tilt, azimuth in itertools.product(range(len(TILTS)), range(len(AZIMUTHS))):
        if azimuth == 0 or tilt not in POLES:
            yield tilt, azimuth


def make(views: Views, chart: Chart, tamponade: Tamponade, folder: Path,
         advance: Callable[[float], object]) -> Table:
    """Return the table of an eye and a tamponade; directions that are in the folder already are read.

    Parameters
    ----------
    advance : called with the number of shapes found, after each direction.
    """
    found = {}
    for tilt, azimuth in directions():
        path = folder / f"{TILTS[tilt]:03.0f}_{AZIMUTHS[azimuth]:03.0f}.npz"
        if not path.is_file():
            shapes = [shape_at(views, tamponade, AZIMUTHS[azimuth], TILTS[tilt], fill) for fill in FILLS]
            Table.of(shapes).write(path)
        found[tilt, azimuth] = Table.read(path)
        advance(len(FILLS))
    for tilt, azimuth in itertools.product(POLES, range(1, len(AZIMUTHS))):
        found[tilt, azimuth] = _turned(found[tilt, 0], AZIMUTHS[azimuth])
    parts = [dataclasses.astuple(found[node]) for node in itertools.product(range(len(TILTS)), range(len(AZIMUTHS)))]
    whole = (np.stack(part).reshape(*NODES, *part[0].shape[1:]) for part in zip(*parts, strict=True))
    return Table(*whole).with_shifts(chart)


def _turned(table: Table, azimuth: float) -> Table:
    """The same shapes on the axis, with meridians that count from another one; what leans, leans to that one then."""
    step = -round(azimuth / (MERIDIANS[1] - MERIDIANS[0]))
    straight = (np.abs(table.shares[:, 1] - table.shares[:, 2]) < LEANING)[:, None, None]
    return dataclasses.replace(table, **{name: np.where(straight, np.roll(field, step, axis=-1), field)
                                         for name, field in (("margin", table.margin), ("gap", table.gap))})
