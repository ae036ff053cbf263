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
from pipeline.equilibrium.star_cavity import FINE
from pipeline.explorer.cases import FILLS, TABLES, eyes, tamponades
from pipeline.explorer.chart import Chart
from pipeline.explorer.lookup import look_up
from pipeline.explorer.shapes import PARTS, Views, parts_of
from pipeline.explorer.table import FOLDER, Table, path_of
from pipeline.scenes.value_files import down_in_head

FILE = "errors.csv"
HEADS = ("eye [mm]", "tamponade", "fill [%]", "pitch [deg]", "roll [deg]",
         *(f"{part}: {what} [%]" for part in PARTS for what in ("table", "shape")))
USUAL = 90.0                # percent of the settings have no larger error than is told
LEAST_USUAL = 0.005         # of a share
SEED = 20


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
        values = np.array([[float(cell) for cell in row[5:]] for row in self.rows]).reshape(-1, 4, 2)
        return (values[..., 0] - values[..., 1]) / 100.0

    @property
    def usual(self) -> list[float]:
        """Error of each part that most settings do not exceed, as a share."""
        if not self.rows:
            return [0.01] * 4
        return np.maximum(np.percentile(np.abs(self.off), USUAL, axis=0), LEAST_USUAL).round(4).tolist()

    def parts(self) -> list[Markup]:
        """Return a paragraph and a table for a page."""
        if not self.rows:
            return [page.paragraph("No setting between those of the tables was checked.")]
        off = 100.0 * np.abs(self.off)
        lines = [(name, f"{np.sqrt((one**2).mean()):.2f}", f"{np.percentile(one, USUAL):.1f}", f"{one.max():.1f}")
                 for name, one in zip(PARTS, off.T, strict=True)]
        return [page.paragraph(f"{len(self.rows)} random settings, with any direction of gravity, were computed again "
                               "with 10,242 directions; how far this page is off, in percentage points:"),
                page.table(("part of the retina", "root mean square", f"{USUAL:.0f} % within", "largest"), lines)]


def check(count: int, folder: Path, advance: Callable[[float], object]) -> Errors:
    """Compute random settings anew, the same ones every time; what the folder holds of them is kept."""
    found, random, kinds = Errors.read(folder), np.random.default_rng(SEED), tamponades()
    known = {tuple(row[:5]) for row in found.rows}
    there = {case: Table.read(path) for case in TABLES if (path := path_of(*case, folder)).is_file()}
    views = {length: Views(eyes()[length]) for length in {length for length, _ in there}}
    charts = {length: Chart.of(view.wall) for length, view in views.items()}
    if not there:
        raise UserError(f"{folder} holds no tables to check; make them with python -m pipeline.explorer_tables")
    for number in range(count):
        length, name = list(there)[number % len(there)]
        pitch, roll = np.degrees(np.arcsin(random.uniform(-1.0, 1.0))).round(1), round(random.uniform(-180.0, 180.0), 1)
        fill = round(random.uniform(FILLS[0], FILLS[-1]), 3)
        setting, toward = ((length, name, f"{100 * fill:g}", f"{pitch:g}", f"{roll:g}"),
                           kinds[name].toward(down_of(pitch, roll)))
        advance(1)
        if setting in known:
            continue
        looked = look_up(there[length, name], toward, fill)
        shapes = views[length].shapes(kinds[name], toward, fill)
        if looked is None or not shapes:
            continue
        resting = views[length].resting
        fine = resting.finer(shapes[0], kinds[name].liquids, down_of(pitch, roll), FINE)
        if not fine.rest.settled:
            continue
        pairs = zip(charts[length].shares(looked.margin), parts_of(resting.contact(fine)), strict=True)
        found.rows.append([*setting, *(f"{100 * value:.2f}" for pair in pairs for value in pair)])
        found.write(folder)
    return found
