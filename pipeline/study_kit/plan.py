"""Which cases a study has: from ``config/studies/<study>.yaml`` to the parameters of every case."""
import dataclasses
import functools
import importlib
import itertools
import types
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pipeline.base.digest import call_digest
from pipeline.base.errors import UserError
from pipeline.scenes.load import PROJECT_CONFIG, load_scene
from pipeline.scenes.model import Scene
from pipeline.scenes.reader import Errors, Reader, describe, nearest
from pipeline.scenes.yaml_files import read_yaml
from pipeline.study_kit.model import Outcome

STUDIES = Path("config/studies")
OUTPUTS = Path("outputs")
ACCURACY = Path("config/accuracy.yaml")
FAMILIES = Path(__file__).parents[1] / "studies"
KEYS = ("title", "description", "cases", "report")
# Figures of the families, or `tradeoff`, `filled_eye_page` or `patient_eyes_page` of `pipeline.study_kit`.
REPORTS = ("curves", "tradeoff", "filled_eye", "patient_eyes")


@dataclasses.dataclass(frozen=True)
class Case:
    """One case: the family (a module of ``pipeline.studies``), its parameters, and the level of its scenes."""

    name: str
    family: types.ModuleType
    parameters: Any
    accuracy: str

    def folders(self) -> dict[str, Path]:
        """Scenes whose results the case reads, and where these are."""
        names = self.family.scenes(self.parameters) if hasattr(self.family, "scenes") else ()
        return {name: OUTPUTS / name / self.accuracy for name in names}

    def run(self) -> Outcome:
        """Run the case; a family with ``scenes`` gets the folders of their results too, one with ``solves`` a scene."""
        given = [*([self.folders()] if self.folders() else []), *self.solved()]
        return self.family.run(self.parameters, *given)

    def solved(self) -> list[Scene]:
        """The scene that the family solves by itself, if it does."""
        if not hasattr(self.family, "solves"):
            return []
        name = self.family.solves(self.parameters)
        return [load_scene(PROJECT_CONFIG / "scenes" / f"{name}.yaml", self.accuracy)]

    def files(self) -> list[str]:
        """Files beside those of scenes that the case reads."""
        return self.family.files(self.parameters) if hasattr(self.family, "files") else []

    @property
    def reads(self) -> tuple[str, ...]:
        """Stages of those scenes, beside their metrics, whose results the case reads, or names of single files."""
        return getattr(self.family, "READS", ("frames",))

    def digest(self) -> str:
        """A new one means that the outcome may differ."""
        chosen = {*getattr(self.family, "EFFECTS", ()), getattr(self.parameters, "scheme", "")}
        scenes = [scene.to_json() for scene in self.solved()]
        return call_digest(self.family.__name__, chosen, [dataclasses.asdict(self.parameters), *scenes])


@dataclasses.dataclass(frozen=True)
class Study:
    """A study: title and description for its page, and its cases by name."""

    name: str
    title: str
    description: str
    accuracy: str
    cases: dict[str, Case]
    report: str = "curves"

    def families(self) -> list[types.ModuleType]:
        """Families of the cases, each once."""
        return list(dict.fromkeys(case.family for case in self.cases.values()))

    def figures(self) -> list:
        """Figures of all families, each once; none in a study of what accuracy costs, which has its own."""
        if self.report == "tradeoff":
            return []
        return [figure for family in self.families() for figure in getattr(family, "FIGURES", ())]

    def pictures(self) -> list[str]:
        """Names of all PNG files of the study: its figures, and pictures that a family makes itself.

        A case returns its pictures with its outcome; ``pictures(outcomes)`` of a family draws all of its cases.
        """
        if self.report == "tradeoff":
            return [f"{family}_tradeoff" for family in self.family_names()]
        if self.report == "filled_eye":
            return ["fill_curves", "fundus_maps"]
        if self.report == "patient_eyes":
            return ["eye_maps"]
        made = [name for family in self.families() for name in getattr(family, "PICTURES", ())]
        return [figure.name for figure in self.figures()] + made

    def family_names(self) -> list[str]:
        """Names of the families, in the order of the file."""
        return list(dict.fromkeys(case.family.__name__.rpartition(".")[2] for case in self.cases.values()))

    def tables(self) -> list[str]:
        """Names of the CSV files beside ``table.csv``."""
        return {"tradeoff": [*self.family_names(), "orders"], "filled_eye": ["shares"],
                "patient_eyes": ["shares"]}.get(self.report, [])

    def case(self, name: str) -> Case:
        """Return a case by name.

        Raises
        ------
        UserError
            There is no such case; the message lists those that there are.
        """
        if name not in self.cases:
            raise UserError(f'{self.name} has no case "{name}"{nearest(name, self.cases)}; its cases are '
                            f"{', '.join(self.cases)}")
        return self.cases[name]


def study_names(folder: Path = STUDIES) -> list[str]:
    """Return the names of all studies."""
    return sorted(path.stem for path in folder.glob("*.yaml"))


def family_names() -> list[str]:
    """Return the names of all families of cases."""
    return sorted(path.stem for path in FAMILIES.glob("*.py") if path.stem != "__init__")


def load_study(name: str, accuracy: str = "draft", folder: Path = STUDIES) -> Study:
    """Read a study and lay out its cases.

    Parameters
    ----------
    accuracy : level of ``config/accuracy.yaml``; a value given as ``{draft: ..., standard: ..., fine: ...}`` follows
        it.

    Raises
    ------
    UserError
        No such study or level, or a file with errors: one sentence for each.
    """
    if name not in study_names(folder):
        raise UserError(f'{folder}: no study is called "{name}"{nearest(name, study_names(folder))}; there are '
                        f"{', '.join(study_names(folder))}")
    path, levels = folder / f"{name}.yaml", list(read_yaml(ACCURACY))
    if accuracy not in levels:
        raise UserError(f'accuracy is "{accuracy}", but must be one of {", ".join(levels)}')
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
    report = data.get("report", REPORTS[0])
    if report not in REPORTS:
        errors.add(("report",), f"is {describe(report)}, but must be one of {', '.join(REPORTS)}")
    errors.raise_any()
    return Study(name, str(data.get("title", name)), str(data.get("description", "")), accuracy, cases, report)


@dataclasses.dataclass(frozen=True)
class _Level:
    accuracy: str
    known: list[str]

    def choose(self, value: Any) -> Any:
        """The value for this level, where it is given level by level."""
        return value[self.accuracy] if isinstance(value, dict) and set(value) == set(self.known) else value


def _family_cases(name: str, declared: Any, level: _Level, errors: Errors) -> dict[str, Case]:
    """Cases of one family; a list of mappings is laid out one after the other."""
    family = importlib.import_module(f"pipeline.studies.{name}")
    key, blocks = ("cases", name), declared if isinstance(declared, list) else [declared]
    if any(not isinstance(block, dict) for block in blocks):
        errors.add(key, f"is {describe(declared)}, but must be a mapping (`name: value` lines), or a list of mappings")
        return {}
    reader = Reader(errors)
    read = [reader.record(family.Parameters, values, key) for block in blocks for values in _combinations(
        family.Parameters, {field: level.choose(value) for field, value in block.items()})]
    if not all(isinstance(one, family.Parameters) for one in read):
        return {}
    telling = _telling_fields(family.Parameters, read)
    cases = {}
    for one in read:
        values = [value for field in telling if (value := getattr(one, field)) is not None]
        case = "-".join([name, *(f"{value:g}" if isinstance(value, float) else f"{value}" for value in values)])
        if case in cases:
            errors.add(key, f"declares the case {case} twice")
        cases[case] = Case(case, family, one, level.accuracy)
    return cases


def _telling_fields(parameters: type, cases: list) -> list[str]:
    """Fields that tell cases of one family from each other, as few as needed: scheme, its own ones, inherited ones.

    Those in `UNNAMED` of the family's parameters never do: how long a case runs is not what it is.
    """
    own, unnamed = ("scheme", *vars(parameters)["__annotations__"]), getattr(parameters, "UNNAMED", ())
    telling, known = [], 1
    named = [field for field in dataclasses.fields(parameters) if field.name not in unnamed]
    for field in sorted(named, key=lambda one: one.name not in own):
        groups = {tuple(getattr(one, name) for name in (*telling, field.name)) for one in cases}
        if len(groups) > known and not _is_list(field.type):
            telling.append(field.name)
            known = len(groups)
    return telling


def _combinations(parameters: type, block: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Every combination of the values that are lists, except where the parameter itself is one."""
    lists = {field.name for field in dataclasses.fields(parameters) if _is_list(field.type)}
    choices = [value if isinstance(value, list) and name not in lists else [value] for name, value in block.items()]
    for combination in itertools.product(*choices):
        yield dict(zip(block, combination, strict=True))


def _is_list(kind: Any) -> bool:
    return typing.get_origin(kind) is tuple


@functools.cache
def cached_study(name: str, accuracy: str) -> Study:
    """``load_study``, once per process."""
    return load_study(name, accuracy)
