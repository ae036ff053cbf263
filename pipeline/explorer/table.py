"""The table of shapes of one eye and one tamponade: made direction by direction, and kept in eight bits."""
import dataclasses
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from pipeline.base.errors import UserError
from pipeline.base.files import replacing
from pipeline.explorer.cases import (
    AZIMUTHS,
    FILLS,
    HALF,
    LATITUDES,
    MERIDIANS,
    TILTS,
    Tamponade,
    fills_at,
)
from pipeline.explorer.chart import Chart
from pipeline.explorer.interface import SIZE
from pipeline.explorer.shapes import PARTS, Shape, Views, shape_at
from pipeline.scenes.load import PROJECT_CONFIG

FOLDER = PROJECT_CONFIG / "oil_at_rest" / "explorer"
REACH = 8e-3                # m from the contact line, where the margin is cut off
DEEPEST = 6e-3              # m from the free surface, where the depth is cut off
SHARE_STEP = 0.002          # of what shares may be less or more
SHIFT_STEP = 0.02e-3        # m, of the contact line
NODES = (len(TILTS), len(AZIMUTHS), len(FILLS))
POLES = (0, len(TILTS) - 1)     # tilts at which every azimuth is the same direction
LEANING = 0.05                  # of a half of the retina: a shape that covers so much more of the other leans to it


@dataclasses.dataclass(frozen=True)
class Table:
    """Shapes at rest for directions and fills; the first three axes are ``TILTS``, ``AZIMUTHS`` and ``FILLS``.

    Attributes
    ----------
    margin : (..., latitudes, ``HALF``) uint8: 1 to 255 mean -``REACH`` to ``REACH``.
    depth : (..., *SIZE) uint8: 1 to 255 mean -``DEEPEST`` to ``DEEPEST``.
    doubt : (..., 10) uint8: what shares may be less (4) and more (4), and how far the contact line lies back and beyond
        then (2), which ``with_shifts`` fills in.
    shares : (..., 4) float32, covered shares of ``PARTS`` of the shapes themselves.
    """

    margin: np.ndarray
    depth: np.ndarray
    doubt: np.ndarray
    shares: np.ndarray

    @classmethod
    def of(cls, shapes: list[Shape | None]) -> "Table":
        """Pack shapes, one behind the other. Where none was found all is zero."""
        nothing = np.zeros((len(LATITUDES), HALF)), np.zeros(SIZE), np.zeros(10), np.full(len(PARTS), np.nan)
        *fields, shares = zip(*(nothing if one is None else (
            128.0 + 127.0 * np.clip(one.margin / REACH, -1.0, 1.0),
            128.0 + 127.0 * np.clip(one.depth / DEEPEST, -1.0, 1.0),
            np.concatenate([one.low / SHARE_STEP, one.high / SHARE_STEP, np.zeros(2)]), one.shares)
            for one in shapes), strict=True)
        margin, depth, doubt = map(_eight_bits, fields)
        return cls(margin, depth, doubt, np.array(shares, np.float32))

    def with_shifts(self, chart: Chart) -> "Table":
        """Return the table with how far the contact line moves where the retina is covered by less and by more."""
        doubt = self.doubt.copy()
        for node in np.ndindex(self.margin.shape[:-2]):
            margin = mirrored(margin_of(self.margin[node]))
            for place, change in ((8, -SHARE_STEP * doubt[node][0]), (9, SHARE_STEP * doubt[node][4])):
                doubt[node][place] = np.rint(chart.shift(margin, change) / SHIFT_STEP)
        return dataclasses.replace(self, doubt=doubt)

    def write(self, path: Path) -> None:
        """Write the table by rename."""
        packed = dataclasses.replace(self, margin=differences(self.margin), depth=differences(self.depth))
        with replacing(path) as temporary:
            np.savez_compressed(temporary, **dataclasses.asdict(packed))

    @classmethod
    def read(cls, path: Path) -> "Table":
        """Read a table.

        Raises
        ------
        UserError : the file is damaged.
        """
        try:
            with np.load(path) as file:
                packed = cls(**{name: file[name] for name in file.files})
        except (OSError, ValueError, TypeError) as error:
            raise UserError(f"{path} is damaged ({error}); remove it, and make it again with "
                            "python -m pipeline.explorer_tables") from error
        margin, depth = (np.cumsum(field, axis=-1, dtype=np.uint8) for field in (packed.margin, packed.depth))
        return dataclasses.replace(packed, margin=margin, depth=depth)


def differences(field: np.ndarray) -> np.ndarray:
    """The same with every number but the first of a row less the one before it, in eight bits: fewer bytes packed."""
    return np.concatenate([field[..., :1], np.diff(field, axis=-1)], axis=-1)


def margin_of(values: np.ndarray) -> np.ndarray:
    """Margins, m, from those of a table."""
    return REACH * (np.asarray(values, float) - 128.0) / 127.0


def depth_of(values: np.ndarray) -> np.ndarray:
    """Depths, m, from those of a table."""
    return DEEPEST * (np.asarray(values, float) - 128.0) / 127.0


def mirrored(field: np.ndarray) -> np.ndarray:
    """A field (..., ``HALF``) with all meridians."""
    return np.concatenate([field, field[..., -2:0:-1]], axis=-1)


def _eight_bits(values: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    return np.rint(np.clip(values, 0.0, 255.0)).astype(np.uint8)


def path_of(eye: str, tamponade: str, folder: Path = FOLDER) -> Path:
    """Return the file of a table."""
    return folder / f"{eye}mm_{tamponade}.npz"


def directions() -> Iterator[tuple[int, int]]:
    """Indices of tilt and azimuth of the directions that are computed."""
    for tilt, azimuth in itertools.product(range(len(TILTS)), range(len(AZIMUTHS))):
        if azimuth == 0 or tilt not in POLES:
            yield tilt, azimuth


def count() -> int:
    """Return how many shapes are computed for a table."""
    return sum(len(fills_at(tilt)) for tilt, _ in directions())


def make(views: Views, chart: Chart, tamponades: Mapping[str, Tamponade], folders: Mapping[str, Path],
         advance: Callable[[float], object]) -> dict[str, Table]:
    """Return the tables of an eye by tamponade; directions that are in the folders already are read.

    Parameters
    ----------
    folders : of the directions, by tamponade.
    advance : called with the number of shapes found, after each direction of all tamponades.
    """
    found: dict[str, dict[tuple[int, int], Table]] = {name: {} for name in tamponades}
    for tilt, azimuth in directions():
        file = f"{TILTS[tilt]:03.0f}_{AZIMUTHS[azimuth]:03.0f}.npz"
        paths = {name: folders[name] / file for name in tamponades}
        shapes: dict[str, list[Shape | None]] = {name: [] for name, path in paths.items() if not path.is_file()}
        # Tamponade by tamponade at a fill: they are looked at from the same point, and the wall that it sees is kept.
        for fill, name in itertools.product(fills_at(tilt), shapes):
            shapes[name].append(shape_at(views, tamponades[name], AZIMUTHS[azimuth], TILTS[tilt], fill))
        for name, some in shapes.items():
            Table.of(some).write(paths[name])
        for name, path in paths.items():
            found[name][tilt, azimuth] = Table.read(path)
        advance(len(paths) * len(fills_at(tilt)))
    return {name: _whole(one).with_shifts(chart) for name, one in found.items()}


def _whole(found: dict[tuple[int, int], Table]) -> Table:
    for tilt, azimuth in itertools.product(POLES, range(1, len(AZIMUTHS))):
        found[tilt, azimuth] = _turned(found[tilt, 0])
    for (tilt, azimuth), here in list(found.items()):
        if few := len(FILLS) - len(fills_at(tilt)):
            found[tilt, azimuth] = _between(found[tilt - 1, azimuth], found[tilt + 1, azimuth], here, few)
    parts = [dataclasses.astuple(found[node]) for node in itertools.product(range(len(TILTS)), range(len(AZIMUTHS)))]
    return Table(*(np.stack(part).reshape(*NODES, *part[0].shape[1:]) for part in zip(*parts, strict=True)))


def _turned(table: Table) -> Table:
    """The same shapes on the axis, a quarter of a turn on; what leans, leans to that meridian then."""
    quarter, middle = len(MERIDIANS) // 4, SIZE[0] // 2
    around, side, along = np.arange(HALF), np.arange(SIZE[1]), np.abs(np.arange(SIZE[0]) - middle)
    whole = mirrored(table.margin)
    margin = [whole[..., (quarter + one) % len(MERIDIANS)] for one in (around, -around)]
    depth = [np.moveaxis(table.depth[:, middle + one][:, :, along], 1, 2) for one in (side, -side)]
    straight = np.abs(table.shares[:, 1] - table.shares[:, 2]) < LEANING
    return dataclasses.replace(table, **{
        name: np.where(np.expand_dims(straight, tuple(range(1, kept.ndim))), _mean(*turned), kept)
        for name, kept, turned in (("margin", table.margin, margin), ("depth", table.depth, depth))})


def _between(before: Table, after: Table, here: Table, few: int) -> Table:
    """A table of a tilt whose first fills are those between the tilts beside it; none where there is none in one."""
    there = before.margin[:few].any(axis=(1, 2)) & after.margin[:few].any(axis=(1, 2))

    def mean(name: str) -> np.ndarray:
        one, other = (getattr(table, name)[:few] for table in (before, after))
        between = 0.5 * (one + other) if name == "shares" else _mean(one, other) * np.expand_dims(
            there, tuple(range(1, one.ndim)))
        return np.concatenate([between, getattr(here, name)])

    return Table(*(mean(field.name) for field in dataclasses.fields(Table)))


def _mean(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return ((one.astype(np.uint16) + other + 1) // 2).astype(np.uint8)
