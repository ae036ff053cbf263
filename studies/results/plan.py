"""What `snakemake -j2 results` runs: every run that a number of docs/results comes from, the cheapest first.

``config/results.yaml`` lists the runs. A number names the command that made it; one whose command is of no run is told.
"""
import csv
import dataclasses
import fnmatch
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from pipeline.base.errors import UserError
from pipeline.scenes.yaml_files import read_yaml
from studies.results.tables import FOLDER, Layout, Row
from studies.results.take_over import SO_FAR

PLAN = Path("config") / "results.yaml"
OUTPUTS = Path("outputs")
LONG = 120                  # minutes; what takes longer has a smaller twin
KEYS = ("study", "scene", "level", "minutes", "cases", "twin", "writes")
TAKE = "python -m studies.results --take"
ALL = ("tamponade", "emulsification")  # scenes of `./run all`
STUDY = re.compile(r"python -m pipeline\.study (\w+)")
TARGET = re.compile(r"outputs/([\w-]+)/(\w+)/\S+")
RUN = re.compile(r"(?:snakemake -j\d+|\./run)(?: (\w+))?(?: --config accuracy=\w+)?")


@dataclasses.dataclass(frozen=True)
class Run:
    """One run: a study or a scene at a level.

    Attributes
    ----------
    kind : "study" or "scene". minutes : of two cores, rough.
    cases : patterns of those cases of a study that are run; none: all.
    twin : key of the smaller run for those who have no hours.
    writes : what brings the numbers into a table; empty: nothing takes them.
    """

    kind: str
    name: str
    level: str
    minutes: float
    cases: tuple[str, ...] = ()
    twin: str = ""
    writes: str = ""

    @property
    def key(self) -> str:
        """Name of this run among all."""
        return f"{self.name}_{self.level}"

    @property
    def what(self) -> tuple[str, str, str]:
        """Kind, name and level."""
        return self.kind, self.name, self.level

    @property
    def folder(self) -> Path:
        """Folder with the table of this run."""
        if self.kind == "scene":
            return OUTPUTS / self.name / self.level
        whole = OUTPUTS / "studies" / self.name / self.level
        return whole / SO_FAR if self.cases else whole

    @property
    def stamp(self) -> Path:
        """File that is there when the numbers have been taken."""
        return OUTPUTS / f"results_of_{self.key}.txt"

    @property
    def long(self) -> bool:
        """Whether it takes more than two hours."""
        return self.minutes > LONG

    def targets(self, cases: Iterable[str]) -> list[str]:
        """Return the files that the run makes, of a study with the names of its cases."""
        if self.kind == "scene":
            files = ["metrics.csv"] + ["cost.html"] * (self.name not in ALL)
            return [f"{self.folder}/{file}" for file in files]
        if not self.cases:
            return [f"{self.folder}/table.csv"]
        return [f"{self.folder.parent}/cases/{case}" for case in cases if self.chosen(case)]

    def chosen(self, case: str) -> bool:
        """Whether a case of the study is one of this run."""
        return not self.cases or any(fnmatch.fnmatchcase(case, pattern) for pattern in self.cases)

    def commands(self, layout: Layout, rows: dict[str, list[Row]]) -> list[str]:
        """Return what brings the numbers of the run into tables; none where no table has any."""
        gather = [f"python -m pipeline.study_report {self.name} --accuracy {self.level} --so-far"] * bool(self.cases)
        take = [self.writes] if self.writes else [f"{TAKE} {self.folder}"] * self.is_read(layout, rows)
        return gather + take

    def is_read(self, layout: Layout, rows: dict[str, list[Row]]) -> bool:
        """Whether a table of docs/results takes numbers of this run by itself."""
        if self.kind == "scene":
            return any(row.level == self.level and row.source.startswith(f"{self.name}: ")
                       for page in rows.values() for row in page)
        tables = [(page.name, table.name) for page in layout.pages for table in page.tables if table.study == self.name]
        return any(row.level == self.level for page, table in tables for row in rows[page] if row.table == table)

    def words(self) -> str:
        """Return what is said of it before it is run: what, and about how long it takes."""
        about = f"{self.minutes:g} min" if self.minutes < 100 else f"{self.minutes / 60.0:.1f} h"
        measured = time_taken(self.folder)
        told = f"{measured / 60.0:.1f} min here" if measured else f"about {about} of two cores"
        part = f", {len(self.cases)} kinds of cases" if len(self.cases) > 1 else ""
        smaller = f"; its smaller twin is {self.twin}" if self.long else ""
        return f"{self.name} at {self.level}{part}: {told}{smaller}"


@dataclasses.dataclass(frozen=True)
class Plan:
    """All runs, the cheapest first, and commands that are no run, with the reason."""

    runs: tuple[Run, ...]
    besides: dict[str, str]

    @property
    def small(self) -> list[Run]:
        """What everybody can run: no run of more than two hours."""
        return [run for run in self.runs if not run.long]

    def told(self) -> str:
        """Return all runs in words, a line each, and how long they take together."""
        lines = [run.words() for run in self.runs]
        hours = [sum(run.minutes for run in runs) / 60.0 for runs in (self.runs, self.small)]
        return "\n".join([*lines, f"results: {len(self.runs)} runs, about {hours[0]:.0f} h of two cores together; "
                          f"results_small: {len(self.small)} runs, {hours[1]:.0f} h"])

    def priority(self, run: Run) -> int:
        """Return the priority of the cases of a study: the cheaper the higher; below zero of what is long."""
        rank = len(self.runs) - self.runs.index(run)
        return rank - len(self.runs) - 1 if run.long else rank


def read_plan(path: Path = PLAN) -> Plan:
    """Read the plan.

    Raises
    ------
    UserError : a key is missing or unknown, a run is there twice, or a long one lacks its twin.
    """
    plain, runs = read_yaml(path), []
    for one in plain.get("runs") or ():
        unknown = [key for key in one if key not in KEYS]
        kinds = [kind for kind in ("study", "scene") if kind in one]
        if unknown or len(kinds) != 1 or "level" not in one or not isinstance(one.get("minutes"), (int, float)):
            raise UserError(f"{path}: {one} must have a study or a scene, a level and minutes, and may have cases, a "
                            "twin and what writes its table")
        kind = kinds[0]
        runs.append(Run(kind, one[kind], one["level"], float(one["minutes"]), tuple(one.get("cases", ())),
                        one.get("twin", ""), one.get("writes", "")))
    keys = [run.key for run in runs]
    if double := [key for key in keys if keys.count(key) > 1]:
        raise UserError(f"{path}: {double[0]} is there twice")
    short = {run.key for run in runs if not run.long}
    for run in runs:
        if run.long and run.twin not in short:
            raise UserError(f"{path}: {run.key} takes more than {LONG} minutes and so needs a twin, which must be a "
                            "run of the list that takes less")
    besides = {one["command"]: one["why"] for one in plain.get("besides") or ()}
    return Plan(tuple(sorted(runs, key=lambda run: run.minutes)), besides)


def made_by(row: Row) -> set[tuple[str, str, str]]:
    """Return the runs that the command of a number stands for; none where it is no run."""
    command = row.command
    if match := STUDY.search(command):
        return {("study", match[1], row.level)}
    if match := TARGET.search(command):
        kind = "study" if match[1] == "studies" else "scene"
        return {(kind, match[2] if kind == "study" else match[1], row.level)}
    if not (match := RUN.fullmatch(command)):
        return set()
    name = match[1] or "all"
    return {("scene", scene, row.level) for scene in ALL} if name == "all" else {("study", name, row.level)}


def not_made(plan: Plan, rows: dict[str, list[Row]]) -> Iterator[str]:
    """Return a sentence for every table of docs/results with numbers that neither the plan makes nor sets aside."""
    made, told = {run.what for run in plan.runs}, set()
    for page, ones in rows.items():
        for row in ones:
            runs = made_by(row)
            if row.command in plan.besides or (runs and runs <= made) or (page, row.table, row.command) in told:
                continue
            told.add((page, row.table, row.command))
            yield (f"{FOLDER / page}.csv: the table {row.table} has numbers of `{row.command}` at "
                   f"{row.level or 'no level'}, which no run of {PLAN} makes")


def time_taken(folder: Path) -> float:
    """Return the seconds on the clock that the cases of a study took, one after the other; 0 where it was not run."""
    path = folder / "table.csv"
    if not path.is_file():
        return 0.0
    with path.open(newline="", encoding="utf-8") as file:
        longest: dict[str, float] = {}
        for line in csv.DictReader(file):
            if line.get("wall_s"):
                longest[line["case"]] = max(longest.get(line["case"], 0.0), float(line["wall_s"]))
    return sum(longest.values())
