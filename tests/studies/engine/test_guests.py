"""Families and pages that somebody puts beside his own studies: found, run, followed by digests, told when wrong."""
import csv
import re
import sys
from pathlib import Path

import pytest
from helpers import forked
from helpers.snakemake_output import planned

from pipeline.base.digest import modules_used
from pipeline.base.errors import UserError
from pipeline.studies.family import family_names, family_of
from pipeline.studies.guests import family_modules, page_modules
from pipeline.studies.model import Outcome, Row
from pipeline.studies.plan import load_study
from pipeline.studies.report import write_study
from pipeline.workflow.scenes import Workflow
from pipeline.workflow.studies import Studies

FALL = '''
"""A stone that falls: how fast it is below."""
import dataclasses

from pipeline.studies.family import Family
from pipeline.studies.model import Outcome, compared
from sim.parameters import parameter

from ._law import speed_below


@dataclasses.dataclass(frozen=True)
class Parameters:
    height: float = parameter(1.0, unit="m", exclusive_minimum=0.0, meaning="that it falls from")


def run(case: Parameters) -> Outcome:
    return Outcome([compared("speed", speed_below(case.height), (2.0 * 9.81 * case.height)**0.5, 1e-9, "m/s")])


FAMILY = Family(__name__, Parameters, run)
'''
LAW = "def speed_below(height):\n    return (19.62 * height) ** 0.5\n"
PAGE = '''
from pipeline.base import page
from pipeline.studies.question_page import StudyPage


def write(description, outcomes, folder):
    return [page.paragraph(f"It fell {len(outcomes)} times.")]


PAGE = StudyPage(__name__, (), (), write)
'''
STONE = "title: A stone\nreport: stone\ncases:\n  fall: {height: [1 m, 45 cm]}\n"


@pytest.fixture
def studies(project, monkeypatch):
    """The folder of studies of a project with a family, what it shares, a page and a study of somebody's own."""
    folder = project.folder / "config" / "studies"
    for name, text in (("fall.py", FALL), ("_law.py", LAW), ("stone_page.py", PAGE), ("stone.yaml", STONE)):
        (folder / name).write_text(text)
    monkeypatch.chdir(project.folder)
    return folder


def test_what_makes_the_published_tables_is_no_family():
    modules = [*family_modules().values(), *page_modules().values()]
    assert "studies.validation.laplace" in modules
    assert not [one for one in modules if one.startswith("studies.results")]


def test_a_family_and_a_page_beside_the_studies_are_run(studies, project):
    done = forked.run("pipeline.study", "stone", folder=project.folder)
    assert done.returncode == 0, done.stderr
    with open("outputs/studies/stone/draft/table.csv", newline="") as file:
        rows = {row["case"]: row for row in csv.DictReader(file)}
    assert {case: (row["quantity"], row["value"], row["error_is"], row["holds"]) for case, row in rows.items()} == {
        "fall-1": ("speed", "4.42945", "relative", "true"), "fall-0.45": ("speed", "2.97136", "relative", "true")}
    assert {row["command"] for row in rows.values()} == {"snakemake -j2 stone"}
    assert all(" cores" in row["machine"] and re.match(r"\d+\.\d+", row["code"]) for row in rows.values())
    assert "It fell 2 times." in Path("outputs/studies/stone/draft/table.html").read_text()


@pytest.mark.thorough
def test_snakemake_runs_them_again_when_what_they_share_changes(studies, project):
    assert project.snakemake("stone")[0] == 0
    assert not planned(project.snakemake("-n", "stone")[1]).get("study_case")
    (studies / "_law.py").write_text(LAW.replace("19.62", "19.6"))
    assert planned(project.snakemake("-n", "stone")[1])["study_case"] == 2


def test_digests_follow_what_a_family_imports_from_beside_it(studies):
    case = load_study("stone").case("fall-1")
    names = {path.name for path in modules_used(case.family.module)}
    assert {"fall.py", "_law.py", "model.py"} <= names and "stone_page.py" not in names


def test_every_row_tells_by_which_code_and_where_it_was_found(studies):
    """And one of a case without a result, by which all were."""
    asked = load_study("stone")
    found = [Outcome([Row("speed", 1.0, "m/s")], case=case, machine=machine, code=code) for case, machine, code in (
        ("fall-1", "a machine", "0.1"), ("fall-0.45", "another one", "0.2"))]
    write_study(asked, [*found, Outcome.failed("fall-2", "it was not let go")], Path("so_far"), complete=False)
    with open("so_far/table.csv", newline="") as file:
        rows = {row["case"]: (row["machine"], row["code"]) for row in csv.DictReader(file)}
    assert rows == {"fall-1": ("a machine", "0.1"), "fall-0.45": ("another one", "0.2"),
                    "fall-2": ("a machine; another one", "0.1; 0.2")}


@pytest.mark.usefixtures("nothing_planned")
def test_the_page_of_a_study_is_made_again_when_its_code_changes(studies):
    asked, told = Studies(Workflow({"scenes": ["tiny"], "accuracy": "draft"})), []
    for more in ("", "# why\n", "MORE = 1\n"):
        (studies / "stone_page.py").write_text(PAGE + more)
        told.append(asked.report_depends("stone", "draft"))
    assert told[0] == told[1] != told[2]


def test_another_folder_has_other_families(studies, tmp_path_factory, monkeypatch):
    other = tmp_path_factory.mktemp("other")
    folder = other / "config" / "studies"
    folder.mkdir(parents=True)
    (folder / "fall.py").write_text(FALL.replace("1.0, unit", "2.0, unit").replace("._law", "._own"))
    (folder / "_own.py").write_text(LAW)
    assert family_of("fall").parameters().height == 1.0
    monkeypatch.chdir(other)
    assert "fall" in family_names() and family_of("fall").parameters().height == 2.0
    assert "config.studies._law" not in sys.modules


@pytest.mark.parametrize(("name", "text", "sentence"), [
    ("laplace.py", FALL, "config/studies/laplace.py: has the name of studies/validation/laplace.py"),
    ("fall.py", "FAMILY = 1\n", "config/studies/fall.py: has no FAMILY, which must be a Family with parameters and"),
    ("fall.py", "A = 1\nA = = 2\n", "config/studies/fall.py, line 2: cannot be imported: SyntaxError: "),
    ("fall.py", "A = 1\nimport nothing_of_this_name\n",
     "config/studies/fall.py, line 2: cannot be imported: ModuleNotFoundError: No module named 'nothing_of_this_name'"),
    ("_law.py", "speed_below = 1 / 0\n", "config/studies/_law.py, line 1: cannot be imported: ZeroDivisionError: "),
    ("fall.py", FALL.replace("(case: Parameters)", "()"), "config.studies.fall: run must take 1 arguments"),
    ("fall.py", FALL.replace("Parameters, run)", "Parameters)"), "config.studies.fall: run must be a function"),
    ("fall.py", FALL.replace("Parameters, run)", "run=run)"), "config.studies.fall: parameters must be a frozen"),
    ("stone_page.py", "", "config/studies/stone_page.py: has no PAGE, which must be a StudyPage"),
    ("stone.yaml", STONE.replace("report: stone", "report: stoned"),
     "report is \"stoned\", but must be one of curves, exchanged_oil, "),
    ("stone.yaml", STONE.replace("fall:", "fell:"), "did you mean fall?"),
])
def test_what_is_wrong_is_told_in_a_sentence(studies, name, text, sentence):
    (studies / name).write_text(text)
    with pytest.raises(UserError) as caught:
        load_study("stone").page  # noqa: B018
    assert sentence in str(caught.value)


def test_a_row_without_a_unit_is_told_in_a_sentence(studies, project):
    (studies / "fall.py").write_text(FALL.replace('"m/s")', '"")'))
    done = forked.run("pipeline.study", "stone", "--case", "fall-1", folder=project.folder)
    assert done.stderr.splitlines()[0] == 'error: the row "speed" has no unit; that of a pure number is "1"'


def test_the_command_tells_what_is_wrong_in_a_sentence(studies, project):
    (studies / "fall.py").write_text("A = 1\nA = = 2\n")
    done = forked.run("pipeline.study", "stone", folder=project.folder)
    assert (done.returncode, done.stderr) == (
        2, "error: config/studies/fall.py, line 2: cannot be imported: SyntaxError: invalid syntax\n")
