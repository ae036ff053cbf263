"""Which cases a study has: from ``config/studies/<study>.yaml`` to the parameters of every case."""
import dataclasses
import functools
import itertools
import json
import math
import re
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pipeline.base.digest import code_used, shortened
from pipeline.base.errors import UserError
from pipeline.base.words import nearest, printable
from pipeline.runs.run_folder import RunFolder
from pipeline.scenes.folders import scene_path
from pipeline.scenes.load import PROJECT_CONFIG, load_accuracy_levels, load_scene, project_materials
from pipeline.scenes.model import Scene
from pipeline.scenes.reader import Errors, Reader, describe
from pipeline.scenes.yaml_files import read_yaml
from pipeline.studies.family import Family, family_names, family_of
from pipeline.studies.guests import STUDIES, page_modules
from pipeline.studies.model import Figure, Outcome
from pipeline.studies.question_page import StudyPage, page_of
from sim.parameters import parameter

OUTPUTS = Path("outputs")
ACCURACY = Path("config/accuracy.yaml")
DEFAULT = "draft"  # level
KEYS = ("title", "description", "cases", "report")
CASE = r"[A-Za-z0-9_.-]{1,200}"  # names of cases, as the rules have them
MOST_CASES = 10_000  # of a family
MOST_LISTED = 20  # cases that an error names
CURVES = "curves"  # the report with the figures of the families; others have a file of their own (``StudyPage``)


@dataclasses.dataclass(frozen=True)
class Case:
    """One case: its family, its parameters, and the level of its scenes.

    That is the level of the study, or the ``accuracy`` of its parameters where they have one.
    """

    name: str
    family: Family
    parameters: Any
    accuracy: str

    def folders(self) -> dict[str, Path]:
        """Scenes whose results the case reads, and where these are."""
        return {name: OUTPUTS / name / self.accuracy for name in self.family.scenes(self.parameters)}

    def run(self) -> Outcome:
        """Run the case."""
        runs = {name: RunFolder(folder) for name, folder in self.folders().items()}
        return self.family.run(self.parameters, *([runs] if self.family.reads_runs else []), *self.solved())

    def solved(self) -> list[Scene]:
        """The scene that the family solves by itself, if it does."""
        return [cached_scene(self.family.solves(self.parameters), self.accuracy)] if self.family.solves else []

    def files(self) -> list[str]:
        """Files beside those of scenes that the case reads."""
        return list(self.family.files(self.parameters))

    def choices(self) -> frozenset[str]:
        """Effects and schemes whose code the case runs: those of what it solves, a scene or solvers of its own."""
        scenes = self.solved()
        names = {name for scene in scenes for name in (*scene.effects, scene.numerics.scheme)}
        own = [self.parameters.scheme] if hasattr(self.parameters, "scheme") else []
        return frozenset(names.union(own, self.family.effects))

    def digest(self) -> str:
        """A new one means that the outcome may differ."""
        read: list[Any] = [_scene_text(scene.name, self.accuracy) for scene in self.solved()]
        for name in self.family.liquids(self.parameters):
            liquid = project_materials()[name]
            read.append([liquid.density, liquid.dynamic_viscosity])
        values = json.dumps([dataclasses.asdict(self.parameters), *read], sort_keys=True)
        return shortened(values, _code_digest(self.family.module, self.choices()))


@dataclasses.dataclass(frozen=True)
class Study:
    """A study: title and description for its page, and its cases by name."""

    name: str
    title: str
    description: str
    accuracy: str
    cases: dict[str, Case]
    report: str = CURVES

    @functools.cached_property
    def solving(self) -> int:
        """How many cases do more than read the results of scenes."""
        return sum(not case.folders() for case in self.cases.values())

    @property
    def page(self) -> StudyPage | None:
        """What writes its page, where it is no table with the figures of its families."""
        return page_of(self.report) if self.report != CURVES else None

    @property
    def command(self) -> str:
        """What makes it."""
        level = "" if self.accuracy == DEFAULT else f" --config accuracy={self.accuracy}"
        return f"snakemake -j2 {self.name}{level}"

    def families(self) -> list[Family]:
        """Families of the cases, each once."""
        return list(dict.fromkeys(case.family for case in self.cases.values()))

    def figures(self) -> list[Figure]:
        """Figures of all families, each once; none where the page has its own by family."""
        if self.page and self.page.judge:
            return []
        return [figure for family in self.families() for figure in family.figures]

    def pictures(self) -> list[str]:
        """Names of all PNG files of the study: its figures, and pictures that a family makes itself.

        A case returns its pictures with its outcome; ``draw`` of a family shows all of its cases.
        """
        if self.page:
            return list(self.page.named(self.page.pictures, self.family_names()))
        made = [name for family in self.families() for name in family.pictures]
        return [figure.name for figure in self.figures()] + made

    def family_names(self) -> list[str]:
        """Names of the families, in the order of the file."""
        return [family.name for family in self.families()]

    def tables(self) -> list[str]:
        """Names of the CSV files beside ``table.csv``."""
        return list(self.page.named(self.page.tables, self.family_names())) if self.page else []

    def case(self, name: str) -> Case:
        """Return a case by name.

        Raises
        ------
        UserError
            There is no such case; the message lists those that there are, or says how to.
        """
        if name not in self.cases:
            known = (f"cases are {', '.join(self.cases)}" if len(self.cases) <= MOST_LISTED else
                     f"{len(self.cases)} cases are listed by: python -m pipeline.study {self.name} --accuracy "
                     f"{self.accuracy} --list")
            raise UserError(f'{self.name} has no case "{name}"{nearest(name, self.cases)}; its {known}')
        return self.cases[name]


def spacings() -> dict[str, float]:
    """Particle spacing of every accuracy level, m."""
    return {name: numerics.particle_spacing for name, numerics in load_accuracy_levels(ACCURACY).items()}


def study_names(folder: Path = STUDIES) -> list[str]:
    """Return the names of all studies."""
    return sorted(path.stem for path in folder.glob("*.yaml"))


def load_study(name: str, accuracy: str = DEFAULT, folder: Path = STUDIES) -> Study:
    """Read a study and lay out its cases.

    Parameters
    ----------
    accuracy : level of ``config/accuracy.yaml``; a value given as ``{draft: ..., standard: ..., fine: ...}`` follows
        it. At a level that is not named the value is that of the next coarser one that is, at one that is coarser than
        all of them that of the coarsest.

    Raises
    ------
    UserError
        No such study or level, or a file with errors: one sentence for each.
    """
    if name not in study_names(folder):
        raise UserError(f'{folder}: no study is called "{name}"{nearest(name, study_names(folder))}; there are '
                        f"{', '.join(study_names(folder))}")
    path, levels = folder / f"{name}.yaml", spacings()
    if accuracy not in levels:
        raise UserError(f'--accuracy is "{accuracy}", but must be one of {", ".join(levels)}'
                        f"{nearest(accuracy, levels)}")
    data, errors = read_yaml(path), Errors(path)
    reader = Reader(errors)
    reader.refuse_unknown(data, KEYS, ())
    cases: dict[str, Case] = {}
    declared = data.get("cases")
    if reader.is_mapping({} if declared is None else declared, ("cases",)) and declared:
        reader.refuse_unknown(declared, family_names(), ("cases",))
        for family in [known for known in declared if known in family_names()]:
            cases |= _family_cases(family, declared[family], _Level(accuracy, levels), errors)
    elif not declared:
        errors.add(("cases",), f"is empty, but must name at least one of {', '.join(family_names())}")
    words = reader.record(_Words, {key: data[key] for key in ("title", "description") if key in data})
    report = data.get("report", CURVES)
    if not isinstance(words, _Words):
        errors.raise_any()
    study = Study(name, words.title or name, words.description, accuracy, cases, report)
    if report not in (known := (CURVES, *page_modules())):
        errors.add(("report",), f"is {describe(report)}, but must be one of {', '.join(known)}")
    elif study.page:
        for family in study.families():
            if lack := study.page.lacks(family):
                errors.add(("cases", family.name), lack)
    errors.raise_any()
    return study


@dataclasses.dataclass(frozen=True)
class _Words:
    title: str = parameter("", longest=200, meaning="heading of the page")
    description: str = parameter("", longest=5000, meaning="what the study asks")


@dataclasses.dataclass(frozen=True)
class _Level:
    """The level of a study, and the particle spacings of all that there are, m."""

    accuracy: str
    spacings: dict[str, float]

    def choose(self, value: Any) -> Any:
        """The value for this level, where it is given level by level."""
        named = self.named(value)
        not_finer = [name for name in named if self.spacings[name] >= self.spacings[self.accuracy]]
        return value if not named else value[not_finer[0] if not_finer else named[-1]]

    def named(self, value: Any) -> list[str]:
        """The levels that a value is given for, fine to coarse, of several alike that of the study first."""
        named = value.keys() & self.spacings.keys() if isinstance(value, dict) else ()
        return sorted(named, key=lambda name: (self.spacings[name], name != self.accuracy, name))


def _family_cases(name: str, declared: Any, level: _Level, errors: Errors) -> dict[str, Case]:
    """Cases of one family; a list of mappings is laid out one after the other."""
    family = family_of(name)
    key, blocks = ("cases", name), declared if isinstance(declared, list) else [declared]
    if any(not isinstance(block, dict) for block in blocks):
        errors.add(key, f"is {describe(declared)}, but must be a mapping (`name: value` lines), or a list of mappings")
        return {}
    reader = Reader(errors)
    for field, value in itertools.chain.from_iterable(block.items() for block in blocks):
        if level.named(value):
            reader.refuse_unknown(value, level.spacings, (*key, field))
    chosen = [{field: level.choose(value) for field, value in block.items()} for block in blocks]
    count = sum(math.prod(map(len, _choices(family.parameters, block))) for block in chosen)
    if count > MOST_CASES:
        errors.add(key, f"has {count} combinations, but must have at most {MOST_CASES}")
        return {}
    read = [reader.record(family.parameters, values, key) for block in chosen
            for values in _combinations(family.parameters, block)]
    if not all(isinstance(one, family.parameters) for one in read):
        return {}
    telling = _telling_fields(family, read)
    cases = {}
    for one in read:
        values = [value for field in telling if (value := getattr(one, field)) is not None]
        case = "-".join([name, *(f"{value:g}" if isinstance(value, float) else f"{value}" for value in values)])
        if not re.fullmatch(CASE, case):
            errors.add(key, f'would name a case "{printable(case)}", but its results get a folder of that name, which '
                            "must be made of letters, digits, _, . and -")
        if case in cases:
            errors.add(key, f"declares the case {case} twice")
        accuracy = getattr(one, "accuracy", level.accuracy)
        if accuracy not in level.spacings:
            errors.add((*key, "accuracy"), f"is {describe(accuracy)}, but must be one of {', '.join(level.spacings)}")
        cases[case] = Case(case, family, one, accuracy)
    return cases


def _telling_fields(family: Family, cases: list) -> list[str]:
    """Fields that tell cases of one family from each other, as few as needed: scheme, its own ones, inherited ones.

    Those in `unnamed` of the family never do: how long a case runs is not what it is.
    """
    own = ("scheme", *vars(family.parameters)["__annotations__"])
    telling, known = [], 1
    named = [field for field in dataclasses.fields(family.parameters) if field.name not in family.unnamed]
    for field in sorted(named, key=lambda one: one.name not in own):
        groups = {tuple(getattr(one, name) for name in (*telling, field.name)) for one in cases}
        if len(groups) > known and not _is_list(field.type):
            telling.append(field.name)
            known = len(groups)
    return telling


def _combinations(parameters: type, block: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Every combination of the values that are lists, except where the parameter itself is one."""
    for combination in itertools.product(*_choices(parameters, block)):
        yield dict(zip(block, combination, strict=True))


def _choices(parameters: type, block: dict[str, Any]) -> list[list]:
    """The values that each field of a block takes in turn."""
    lists = {field.name for field in dataclasses.fields(parameters) if _is_list(field.type)}
    return [value if isinstance(value, list) and name not in lists else [value] for name, value in block.items()]


def _is_list(kind: Any) -> bool:
    return typing.get_origin(kind) is tuple


# A study of a thousand cases reads its scenes and its code once in a process, not a thousand times.

@functools.cache
def cached_scene(name: str, accuracy: str) -> Scene:
    """Return a scene of ``config/scenes`` at a level."""
    return load_scene(scene_path(name, PROJECT_CONFIG / "scenes"), accuracy)


@functools.cache
def _scene_text(name: str, accuracy: str) -> str:
    return cached_scene(name, accuracy).to_json()


@functools.cache
def _code_digest(module: str, chosen: frozenset[str]) -> str:
    return shortened(code_used(module, chosen))


@functools.cache
def cached_study(name: str, accuracy: str) -> Study:
    """``load_study``, once per process."""
    return load_study(name, accuracy)
