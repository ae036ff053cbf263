"""How far what the tables say is off the shape itself, at settings between those of the tables."""
import csv
import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
from markupsafe import Markup

from pipeline.base import page
from pipeline.base.errors import UserError
from pipeline.base.files import write_text
from pipeline.base.tables import csv_of
from pipeline.equilibrium.contact import Contact
from pipeline.equilibrium.least import Resting
from pipeline.equilibrium.star_cavity import FINE
from pipeline.explorer.cases import FILLS, TABLES, tamponades
from pipeline.explorer.chart import Chart
from pipeline.explorer.interface import Interface, Lattice
from pipeline.explorer.lookup import look_up
from pipeline.explorer.shapes import PARTS, parts_of
from pipeline.explorer.table import FOLDER, Table, path_of
from pipeline.scenes.model import Eye
from pipeline.scenes.value_files import down_in_head

FILE = "errors.csv"
SETTING = ("eye [mm]", "tamponade", "fill [%]", "pitch [deg]", "roll [deg]")
SURFACE = ("mean", "90 % within", "largest")    # of the distances between two free surfaces
HEADS = (*SETTING, *(f"{part}: {what} [%]" for part in PARTS for what in ("table", "shape")),
         *(f"free surface: {what} [mm]" for what in SURFACE))
USUAL = 90.0                # percent of the settings have no larger error than is told
LEAST_USUAL = 0.005         # of a share
SEED = 20
LENGTH_STEP = 0.5           # mm, of the eyes that are checked, as of the page


def down_of(pitch: float, roll: float) -> np.ndarray:
    """Direction of gravity (3,) in a head whose face was raised and whose right ear was then lowered, degrees."""
    return down_in_head(*np.radians([pitch, roll]))


@dataclasses.dataclass(frozen=True)
class Errors:
    """Settings that were checked.

    Attributes
    ----------
    rows : cells of ``HEADS`` as text.
    """

    rows: list[list[str]]

    @classmethod
    def read(cls, folder: Path = FOLDER) -> "Errors":
        """Read what was checked; nothing where there is no file."""
        path = folder / FILE
        if not path.is_file():
            return cls([])
        with path.open(newline="", encoding="utf-8") as file:
            return cls(list(csv.reader(file))[1:])

    def write(self, folder: Path = FOLDER) -> None:
        """Write the settings as CSV."""
        write_text(folder / FILE, csv_of(HEADS, self.rows))

    @property
    def off(self) -> np.ndarray:
        """Table less shape, (settings, 4), as shares."""
        values = self._numbers[:, :-len(SURFACE)].reshape(-1, len(PARTS), 2)
        return (values[..., 0] - values[..., 1]) / 100.0

    @property
    def surface(self) -> np.ndarray:
        """Distance of the free surface that is drawn to that of the shape, (settings, ``SURFACE``), mm."""
        return self._numbers[:, -len(SURFACE):]

    @property
    def _numbers(self) -> np.ndarray:
        return np.array([[float(cell) for cell in row[len(SETTING):]] for row in self.rows]).reshape(
            -1, len(HEADS) - len(SETTING))

    @property
    def usual(self) -> list[float]:
        """Error of each part that most settings do not exceed, as a share."""
        if not self.rows:
            return [0.01] * len(PARTS)
        return np.maximum(np.percentile(np.abs(self.off), USUAL, axis=0), LEAST_USUAL).round(4).tolist()

    def parts(self) -> list[Markup]:
        """Return paragraphs and tables for a page."""
        if not self.rows:
            return [page.paragraph("No setting between those of the tables was checked.")]
        off = 100.0 * np.abs(self.off)
        lines = [(name, f"{one.mean():.2f}", f"{np.percentile(one, USUAL):.1f}", f"{one.max():.1f}",
                  f"{100.0 * (one <= 1.0).mean():.0f} %") for name, one in zip(PARTS, off.T, strict=True)]
        apart = [(name, f"{one.mean():.2f}", f"{np.percentile(one, USUAL):.2f}", f"{one.max():.1f}")
                 for name, one in zip(("on average over the surface", "nine tenths of the surface within",
                                       "farthest point"), self.surface.T, strict=True)]
        usual = f"{USUAL:.0f} % of settings within"
        return [page.paragraph(f"{len(self.rows)} random settings, of any eye length, tamponade, fill and direction of "
                               "gravity, were computed again with 10,242 directions, as pipeline.oil_at_rest has "
                               "them. How far this page is off, in percentage points:"),
                page.table(("part of the retina", "mean", usual, "largest", "within 1 point"), lines),
                page.paragraph("How far the free surface that is drawn is from that of the shape itself, in mm:"),
                page.table(("distance", "mean", usual, "largest"), apart),
                page.paragraph("Large errors lie where the shape jumps: there two shapes have nearly the same energy, "
                               "and the tables change from one to the other elsewhere.")]


def settings_of(count: int, lengths: np.ndarray) -> list[tuple[str, str, str, str, str]]:
    """Return random settings as cells of ``SETTING``, the same ones every time."""
    random, names, found = np.random.default_rng(SEED), list(tamponades()), []
    for number in range(count):
        length = round(random.uniform(lengths.min(), lengths.max()) / LENGTH_STEP) * LENGTH_STEP
        pitch, roll = np.degrees(np.arcsin(random.uniform(-1.0, 1.0))), random.uniform(-180.0, 180.0)
        fill = 100.0 * random.uniform(FILLS[0], FILLS[-1])
        found.append((f"{length:.1f}", names[number % len(names)], f"{fill:.1f}", f"{pitch:.1f}", f"{roll:.1f}"))
    return found


def check(count: int, folder: Path, advance: Callable[[float], object]) -> Errors:
    """Compute random settings anew, the same ones every time; what the folder holds of them is kept."""
    found, kinds = Errors.read(folder), tamponades()
    known = {tuple(row[:len(SETTING)]) for row in found.rows}
    there: dict[str, dict[str, Table]] = {name: {} for name in kinds}
    eyes: dict[float, Resting] = {}
    for eye, name in TABLES:
        if (path := path_of(eye, name, folder)).is_file():
            there[name][eye] = Table.read(path)
    lengths = np.array([float(eye) for tables in there.values() for eye in tables])
    if not len(lengths):
        raise UserError(f"{folder} holds no tables to check; make them with python -m pipeline.explorer_tables")
    for setting in settings_of(count, lengths):
        advance(1)
        length, fill, pitch, roll = (float(setting[cell]) for cell in (0, 2, 3, 4))
        tables, kind, down = there[setting[1]], kinds[setting[1]], down_of(pitch, roll)
        if setting in known or not tables:
            continue
        if length not in eyes:
            eyes[length] = Resting.of(Eye(axial_length=1e-3 * length))
        resting = eyes[length]
        looked = look_up(tables, length, kind.toward(down), 0.01 * fill)
        least = resting.least(kind.liquids, down, 0.01 * fill, FINE)
        if looked is None or least is None:
            continue
        if not least.rest.settled:
            continue
        wall = resting.cavity()
        shares = Chart.of(wall).shares(looked.margin), parts_of(Contact.of(least.rest))
        drawn = Interface.drawn(looked.depth, Lattice.of(wall), looked.meridian, wall)
        apart = drawn.apart(Interface.of(least.rest, kind.liquids.contact_angle))
        found.rows.append([*setting, *(f"{100 * value:.2f}" for pair in zip(*shares, strict=True) for value in pair),
                           *(f"{1e3 * value:.3f}" for value in apart)])
        found.write(folder)
    return found
