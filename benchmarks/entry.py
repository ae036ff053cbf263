"""Write what this project enters in the benchmark tamponade-10 (benchmarks/tamponade-10), of its own tables.

    snakemake -j2 tamponade_10 outputs/tamponade/draft/metrics.csv      computes all cases
    python benchmarks/entry.py --output mine.csv                        the entry of the level draft
    python benchmarks/entry.py --accuracy standard --output mine.csv    that of another level

Numbers come from the table of the study `tamponade_10`, from the metrics of the scene `tamponade`, and, where neither
has a case, from the tables of docs/results of the same level. A case that lacks a number is left out and told.
"""
import argparse
import csv
import dataclasses
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pipeline.base.cli import run
from pipeline.base.errors import UserError
from pipeline.base.files import write_text
from pipeline.base.tables import TIME, csv_of, read_table
from studies.results.tables import FOLDER, read_layout, read_rows
from studies.results.take_over import taken_of

STUDY, SCENE = "tamponade_10", "tamponade"
OUTPUTS = Path("outputs")
COLUMNS = ("case", "quantity", "time", "value", "unit")
COMPUTING_TIME, CLOCK = "computing time without compilation, all cores", "wall_s"  # quantity and column of a study
Tables = Mapping[tuple[str, str], tuple[float, float]]  # case and quantity of a study -> value, size


@dataclasses.dataclass(frozen=True)
class Line:
    """A line of the entry, and where this project has its number.

    Attributes
    ----------
    quantity, unit, time : of the benchmark; time in s, None for what has none.
    case : of the study. found : its quantity there.
    scale : what a number of the study is multiplied with.
    length : where that number is in particle spacings, the length that the size counts them along, in ``unit``.
    published : case in the study `validation`, where a table of docs/results has the same.
    """

    quantity: str
    unit: str
    case: str
    found: str
    time: float | None = None
    scale: float = 1.0
    length: float = 0.0
    published: str = ""


def _sphere(angle: str) -> list[Line]:
    case, published = f"oil_in_sphere-{angle}", f"oil_in_sphere-3-0.8-{angle}--35-0.1-0"
    lines = [Line(f"arc_{angle}_deg", "deg", case, "arc of contact", published=published),
             Line(f"height_on_axis_{angle}_deg", "mm", case, "height on the axis / spacing", length=11.0,
                  published=published)]
    share = Line(f"covered_share_{angle}_deg", "1", case, "covered share of the wall", published=published)
    return [*lines, share] if angle == "18.2" else lines


def _eye(posture: str) -> list[Line]:
    return [Line(f"covered_{part}_{posture}", "%", f"rest_by_simulation-{posture}", f"covered {part}")
            for part in ("retina", "inferior")]


def _column(fraction: str) -> list[Line]:
    return [Line(f"{which}_front_{fraction}", "m", f"sedimentation-{fraction}",
                 f"{which} front / H at t v_s/H = {share:g}", time=100.0 * share)
            for share in (0.2, 0.4, 0.6, 0.8) for which in ("bottom", "top")]


LINES = {
    "sphere_at_rest": [line for angle in ("18.2", "60", "120") for line in _sphere(angle)],
    "eye_at_rest": [line for posture in ("upright", "supine", "prone") for line in _eye(posture)],
    "film_on_plate": [Line("film_left", "1", "film_on_plate", f"film left after {words} of its time of lubrication",
                           time=time) for words, time in (("1/6", 0.587156), ("1/3", 1.17431), ("1", 3.52294),
                                                          ("2", 7.04587))],
    "deposited_film": [Line(f"thickness_Ca_{number}", "um", f"deposited_film-{number}",
                            "mean thickness of the film left behind / spacing", length=5e3)
                       for number in ("0.0001", "0.001")],
    "capillary_rise": [Line(f"rise_{angle}_deg", "mm", f"capillary_rise-{angle}", "rise between the plates", time=4.0)
                       for angle in ("60", "120")],
    "rising_bubble": [Line("smallest_circularity", "1", "rising_bubble", "smallest circularity"),
                      Line("largest_speed", "m/s", "rising_bubble", "largest speed"),
                      Line("height_of_center", "m", "rising_bubble", "height of the center of mass at 3 s", time=3.0)],
    "saccade": [Line(f"largest_stress_W_{number}", "Pa", f"turned_sphere-{number}", "largest stress at the wall")
                for number in ("2", "5")],
    "spin_down": [Line("decay_rate", "1/s", "spin_down", "decay rate of the angular momentum R² / nu", scale=0.1)],
    "sedimentation": [line for fraction in ("0.2", "0.5") for line in _column(fraction)],
}
FILLING = "filling"
# Quantity, unit, column of the metrics, time in s, and what docs/results reads of that scene for it.
FILLED = (("fill", "%", "fill [%]", 10.0, "fill last"),
          ("covered_retina", "%", "retina_coverage_whole [%]", 10.0, "retina_coverage_whole last"),
          ("covered_inferior", "%", "retina_coverage_inferior [%]", 10.0, "retina_coverage_inferior last"))


def read_study(folder: Path) -> Tables:
    """Return the numbers of a study's table by case and quantity, with the size in the name; the last ones count."""
    path = folder / "table.csv"
    if not path.is_file():
        return {}
    found = {}
    with path.open(newline="", encoding="utf-8") as file:
        for line in csv.DictReader(file):
            case, _, size = line["case"].partition(" ")
            number = size.rpartition("=")[2]
            known = float(number) if number.replace(".", "", 1).isdigit() else 0.0
            if line["value"]:
                found[case, line["quantity"]] = float(line["value"]), known
                found.setdefault((case, CLOCK), (float(line[CLOCK] or "nan"), known))
    return found


def read_published(folder: Path, level: str) -> dict[str, tuple[float, float]]:
    """Return the numbers of docs/results at a level by their source, with the size."""
    found = {}
    for page in read_layout(folder).pages:
        for row in read_rows(folder, page):
            if row.level == level and row.source and row.value:
                size = row.size.rpartition(" ")[2]
                found[row.source] = float(row.value), float(size) if size.isdigit() else 0.0
    return found


def value_of(line: Line, study: Tables, published: Mapping[str, tuple[float, float]]) -> float | None:
    """Return the number of a line; None where no table has it."""
    number, size = study.get((line.case, line.found), (None, 0.0))
    if number is None and line.published:
        names = (name for name in published if name.partition(" ")[0] == line.published
                 and name.partition(": ")[2] == line.found)
        number, size = published.get(next(names, ""), (None, 0.0))
    if number is None or not np.isfinite(number):
        return None
    return number * line.length / size if line.length else number * line.scale


def cost(lines: list[Line], study: Tables) -> tuple[str, float] | None:
    """Return what the cases of some lines took, s: processor time, else time on the clock; None where none is known."""
    cases = dict.fromkeys(line.case for line in lines)
    for name, quantity in (("processor_time", COMPUTING_TIME), ("wall_time", CLOCK)):
        seconds = [study.get((case, quantity), (np.nan, 0.0))[0] for case in cases]
        if np.isfinite(seconds).all():
            return name, float(np.sum(seconds))
    return None


def filled(folder: Path, published: Mapping[str, tuple[float, float]]) -> tuple[list[tuple], float | None]:
    """Return the lines of the filling from the metrics of a run, or what is published, and the processor time, s."""
    if not (folder / "metrics.csv").is_file():
        known = [(FILLING, name, time, published[f"{SCENE}: {source}"][0], unit)
                 for name, unit, _, time, source in FILLED if f"{SCENE}: {source}" in published]
        return known, None
    table = read_table(folder / "metrics.csv")
    lines = [(FILLING, name, time, float(np.interp(time, table[TIME], table[column])), unit)
             for name, unit, column, time, _ in FILLED if column in table and table[TIME][-1] >= time - 1e-9]
    return lines, taken_of(folder).get("simulate", {}).get("cpu")


def entry(study: Tables, scene: Path, published: Mapping[str, tuple[float, float]]) -> tuple[list[tuple], list[str]]:
    """Return the lines of the entry, and sentences on the cases that are left out."""
    lines, missing = [], []
    for case, asked in LINES.items():
        values = [value_of(line, study, published) for line in asked]
        if None in values:
            missing.append(f"{case} is left out: no table has {asked[values.index(None)].quantity}")
            continue
        lines += [(case, line.quantity, "" if line.time is None else f"{line.time:g}", f"{value:.5g}", line.unit)
                  for line, value in zip(asked, values, strict=True)]
        if took := cost(asked, study):
            lines.append((case, took[0], "", f"{took[1]:.4g}", "s"))
    found, seconds = filled(scene, published)
    if len(found) < len(FILLED):
        return lines, [*missing, f"{FILLING} is left out: {scene} has no metrics of it up to 10 s"]
    lines += [(case, name, f"{time:g}", f"{value:.5g}", unit) for case, name, time, value, unit in found]
    if seconds is not None:
        lines.append((FILLING, "processor_time", "", f"{seconds:.4g}", "s"))
    return lines, missing


def main() -> None:
    """Run the command; see ``--help``."""
    p = argparse.ArgumentParser(prog="python benchmarks/entry.py", description=__doc__,
                                formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--accuracy", default="draft", help="level of config/accuracy.yaml (default draft)")
    p.add_argument("--study", type=Path, metavar="DIR", help="folder with the table.csv of the study "
                   f"(default outputs/studies/{STUDY}/<level>)")
    p.add_argument("--scene", type=Path, metavar="DIR",
                   help=f"folder with the metrics.csv of the scene (default outputs/{SCENE}/<level>)")
    p.add_argument("--output", type=Path, required=True, metavar="FILE", help="entry to write (CSV)")
    options = p.parse_args()
    study = read_study(options.study or OUTPUTS / "studies" / STUDY / options.accuracy)
    scene = options.scene or OUTPUTS / SCENE / options.accuracy
    published = read_published(FOLDER, options.accuracy) if FOLDER.is_dir() else {}
    lines, missing = entry(study, scene, published)
    if not lines:
        raise UserError(f"nothing to enter at {options.accuracy}: run `snakemake -j2 {STUDY} --config "
                        f"accuracy={options.accuracy}` first")
    write_text(options.output, csv_of(COLUMNS, lines))
    print("\n".join([f"{options.output}: {len({line[0] for line in lines})} cases", *missing]))


if __name__ == "__main__":
    run(main)
