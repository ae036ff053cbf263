"""Studies: their plans, what a case returns, the table, and that a rerun repeats only what changed."""
import ast
import csv
import dataclasses
import functools
import importlib
import math
import sys
from collections import Counter
from pathlib import Path

import pytest
from conftest import ROOT
from helpers.cases import thorough
from helpers.snakemake_output import TRACE, planned

from pipeline import study as study_stage
from pipeline import study_report
from pipeline.base import digest
from pipeline.base.digest import modules_used
from pipeline.base.errors import UserError
from pipeline.scenes.load import load_accuracy_levels
from pipeline.studies import plan
from pipeline.studies.family import Family, Headline, family_names, family_of
from pipeline.studies.model import COLUMNS, MADE, Curve, Outcome, Row, bounded, compared, observed_order
from pipeline.studies.plan import load_study, study_names
from pipeline.studies.report import outcomes_so_far, summary
from pipeline.study import run_case
from pipeline.workflow.scenes import Workflow
from pipeline.workflow.studies import Studies
from sim.effects import REGISTRY
from studies.validation.taylor_green import Parameters

SMALL = """
title: Small
cases:
  taylor_green:
    reynolds: [5, 10]
    start: regular
    decay: 0.02
    resolutions: {draft: [8], standard: [10, 12], fine: [12, 14]}
"""


@pytest.fixture
def write(project, monkeypatch):
    """Return a function that writes the study `small` into a copy of the project, which is the current folder."""
    monkeypatch.chdir(project.folder)

    def written(text):
        (project.folder / "config" / "studies" / "small.yaml").write_text(text)
    return written


# What a case returns

def test_row_holds_only_with_a_finite_error_within_the_tolerance():
    assert Row("a", 1.0).holds is None
    assert compared("a", 1.02, 1.0, 0.03).holds and not compared("a", 1.04, 1.0, 0.03).holds
    assert bounded("a", -0.5, 0.5).holds and not bounded("a", math.nan, 0.5).holds
    assert compared("a", 0.9, -1.0, None).error == pytest.approx(1.9)


def test_observed_order_is_the_slope_and_ignores_runs_without_an_error():
    assert observed_order([0.1, 0.05, 0.025], [0.02, 0.005, 0.00125]) == pytest.approx(2.0)
    assert observed_order([0.1, 0.05, 0.025], [0.02, math.nan, 0.00125]) == pytest.approx(2.0)
    assert math.isnan(observed_order([0.1, 0.05], [0.02, 0.0]))


def test_outcome_survives_its_file(tmp_path):
    outcome = Outcome([compared("a", math.nan, 2.0, 0.1, "m", at="n=4", wall_s=1.5)],
                      [Curve("f", "b", [1.0, 2.0], [3.0, 4.0])], ["a remark"], {"picture": b"png"}, "case")
    outcome.write(tmp_path)
    read = Outcome.read(tmp_path)
    assert [row.cells("case") for row in read.rows] == [row.cells("case") for row in outcome.rows]
    assert (read.curves, read.remarks, read.pictures, read.case) == (
        outcome.curves, outcome.remarks, outcome.pictures, outcome.case)
    with pytest.raises(UserError, match="run the case first"):
        Outcome.read(tmp_path / "elsewhere")


@pytest.mark.parametrize("content", [b"", b"{\xff}", b"[]", b"{}"])
def test_damaged_outcome_is_told_and_stops_no_table_of_what_is_there(write, content):
    write("cases: {oil_at_rest: {}}")
    study = load_study("small")
    case, = study.cases
    folder = Path("outputs/studies/small/draft/cases") / case
    folder.mkdir(parents=True)
    (folder / "outcome.json").write_bytes(content)
    with pytest.raises(UserError, match="is no outcome of a case"):
        Outcome.read(folder)
    outcome, = outcomes_so_far(study, folder.parents[1])
    assert outcome.case == case and "run the case again" in outcome.failure


def test_summary_names_every_row_that_does_not_hold():
    rows = [row.cells("c") for row in (compared("good", 1.0, 1.0, 0.1), compared("bad", 2.0, 1.0, 0.1), Row("c", 1.0))]
    assert "1 of 2 rows hold, these do not:\n  c: bad is 2 1, error 1 above 0.1" in summary("s", rows)


def test_summary_says_plainly_that_a_case_has_no_result():
    row, = Outcome.failed("lost-1", "the disk was full").rows
    assert summary("study", [row.cells("lost-1")]).splitlines()[1] == "  lost-1: no result"


def test_summary_of_many_rows_is_short():
    rows = [row.cells("c") for row in [compared("bad", 2.0, 1.0, 0.1)] * 1000]
    lines = summary("s", rows).splitlines()
    assert len(lines) == 22 and lines[-1] == "  and 980 more, see its table"


# Cases without a result

def family_that_runs(run):
    """A family as small as one can be."""
    return Family("studies.small", Parameters, run)


def test_case_that_cannot_be_run_has_a_failure_as_its_outcome(taichi, write):
    def run(parameters):
        raise UserError("a drop of 3 mm does not fit into a box of 2 mm")

    write(SMALL)
    case = dataclasses.replace(load_study("small").case("taylor_green-5"), family=family_that_runs(run))
    outcome = run_case(case)
    assert outcome.failure == "a drop of 3 mm does not fit into a box of 2 mm"
    assert [row.cells(outcome.case)["holds"] for row in outcome.rows] == ["false"]


def test_defect_of_the_program_is_no_outcome(taichi, write):
    write(SMALL)
    family = family_that_runs(lambda parameters: {}["missing"])
    with pytest.raises(KeyError):
        run_case(dataclasses.replace(load_study("small").case("taylor_green-5"), family=family))


@pytest.mark.thorough
def test_table_so_far_says_of_every_case_why_it_has_no_result(write, monkeypatch):
    write(SMALL.replace("[5, 10]", "[5, 6, 7, 8, 9]"))
    folder = Path("outputs/studies/small/draft")
    done, failed = folder / "cases" / "taylor_green-5", folder / "cases" / "taylor_green-6"
    for path, outcome in ((done, Outcome([compared("decay", 1.0, 1.0, 0.1)], case="taylor_green-5")),
                          (failed, Outcome.failed("taylor_green-6", "it cannot be"))):
        path.mkdir(parents=True)
        outcome.write(path)
    logs = folder / "logs"
    logs.mkdir()
    (logs / "taylor_green-7.log").write_text("starts\nerror: out of memory\n")
    (logs / "taylor_green-8.log").write_text("Traceback (most recent call last):\n  File x\nZeroDivisionError: by 0\n")
    monkeypatch.setattr(sys, "argv", ["study_report", "small", "--so-far"])
    study_report.main()
    with (folder / "so_far" / "table.csv").open() as file:
        rows = {row["case"]: (row["quantity"], row["holds"]) for row in csv.DictReader(file)}
    assert rows == {"taylor_green-5": ("decay", "true")} | {
        f"taylor_green-{number}": ("no result", "false") for number in (6, 7, 8, 9)}
    page = (folder / "so_far" / "table.html").read_text()
    for number, why in ((6, "it cannot be"), (7, "out of memory"), (8, "ZeroDivisionError: by 0"),
                        (9, "it has not been run")):
        assert f"taylor_green-{number} has no result: {why}" in page
    assert not (folder / "table.csv").exists()


def test_what_is_known_so_far_has_no_number_of_an_earlier_version_of_a_case(write, monkeypatch):
    def known(decay, case):
        """After a case is run that asks for a decay: quantities of all cases, and why they have none."""
        write(SMALL.replace("decay: 0.02", f"decay: {decay}"))
        monkeypatch.setattr(sys, "argv", ["study", "small", "--case", case, "--device", "cpu"])
        study_stage.main()
        found = outcomes_so_far(load_study("small"), Path("outputs/studies/small/draft"))
        return [(outcome.case, outcome.rows[0].quantity, outcome.failure) for outcome in found]

    five, ten = "taylor_green-5", "taylor_green-10"
    monkeypatch.setattr(study_stage, "run_case", lambda case, *_, **more: Outcome([Row("decay", 1.0)], case=case.name))
    assert known(0.02, five) == [(five, "decay", ""), (ten, "no result", "it has not been run")]
    assert known(0.03, ten) == [(five, "no result", "what is there is of an earlier version of the case or its code; "
                                                    "run it again"), (ten, "decay", "")]
    assert known(0.03, five) == [(five, "decay", ""), (ten, "decay", "")]


# What a family has to say of itself

@dataclasses.dataclass
class Loose:
    """Parameters that can be changed."""


@pytest.mark.parametrize(("parameters", "changes", "sentence"), [
    (Loose, {}, "parameters must be a frozen dataclass"),
    (dict, {}, "parameters must be a frozen dataclass"),
    (Parameters, {"run": None}, "run must be a function"),
    (Parameters, {"run": lambda: None}, "run must take 1 arguments: the parameters"),
    (Parameters, {"solves": lambda case: "tiny"}, "run must take 2 arguments: the parameters, a scene"),
    (Parameters, {"scenes": lambda case: ()}, "run must take 2 arguments: the parameters, runs of scenes"),
    (Parameters, {"effects": ("gravty",)}, "there is no effect gravty (did you mean gravity?)"),
    (Parameters, {"unnamed": ("tims",)}, "unnamed has tims, but the parameters are"),
    (Parameters, {"headline": Headline("error", 1.0)}, "needs a positive per_width, and effects by which it is shown"),
    (Parameters, {"pictures": ("one", "one")}, "figures and pictures must have names of their own"),
    (Parameters, {"draw": lambda outcomes: {}}, "draws pictures, but names none"),
    (Parameters, {"threads": 0}, "threads is 0, but must be at least 1"),
])
def test_family_that_lacks_a_part_is_refused_in_a_sentence(parameters, changes, sentence):
    with pytest.raises(UserError) as caught:
        Family("studies.small", parameters, **{"run": lambda case: Outcome()} | changes)
    assert len(caught.value.messages) == 1 and caught.value.messages[0].startswith("studies.small: ")
    assert sentence in str(caught.value)


def test_file_without_a_family_is_told(monkeypatch):
    monkeypatch.setattr("studies.validation.taylor_green.FAMILY", None)
    with pytest.raises(UserError, match=r"taylor_green.py: has no FAMILY, which must be a Family with parameters"):
        family_of("taylor_green")


# Plans

@pytest.mark.thorough
@pytest.mark.usefixtures("nothing_planned")
def test_study_of_a_thousand_cases_reads_its_scenes_and_code_once(write, monkeypatch):
    write("cases: {injection: {scene: [tamponade, oil_removal], flow: ["
          + ", ".join(f"{0.1 * k:.1f} mL/s" for k in range(1, 26)) + "], drain_gap: ["
          + ", ".join(f"{0.3 + 0.05 * k:.2f} mm" for k in range(20)) + "], duration: 0.1 s, resolutions: [11]}}")
    read = Counter()

    def counted(name, function):
        def call(*arguments):
            read[name] += 1
            return function(*arguments)
        monkeypatch.setattr(plan, name, call)

    for name in ("load_scene", "code_used", "read_yaml"):
        counted(name, getattr(plan, name))
    studies = Studies(Workflow({"scenes": ["tiny"], "accuracy": "draft"}))
    cases = [Path(folder).name for folder in studies.case_folders("small", "draft")]
    assert len(cases) == 1000
    assert len({studies.depends("small", "draft", case) for case in cases}) == 1000
    assert {studies.threads("small", "draft", case, 2) for case in cases} == {1}
    assert not any(studies.inputs("small", "draft", case) for case in cases)
    assert read == {"load_scene": 2, "code_used": 1, "read_yaml": 1}  # the levels are read by their own reader


@pytest.mark.thorough_cases("accuracy-draft", "validation-draft")
@pytest.mark.parametrize("accuracy", ["draft", "standard", "fine"])
@pytest.mark.parametrize("name", study_names(ROOT / "config" / "studies"))
def test_every_study_can_be_laid_out(name, accuracy, monkeypatch):
    monkeypatch.chdir(ROOT)
    study = load_study(name, accuracy)
    assert study.cases and len(set(study.pictures())) == len(study.pictures())
    assert all(case.digest() for case in study.cases.values())


@pytest.mark.usefixtures("nothing_planned")
@pytest.mark.parametrize(("level", "spacing"), [
    thorough("quick", "2 mm"), ("between", "0.6 mm"), thorough("finest", "0.2 mm")])
def test_every_study_can_be_laid_out_at_a_level_that_no_study_knows(project, monkeypatch, level, spacing):
    monkeypatch.chdir(project.folder)
    monkeypatch.setattr(plan, "PROJECT_CONFIG", project.folder / "config")
    with (project.folder / "config" / "accuracy.yaml").open("a") as file:
        file.write(f"{level}: {{particle_spacing: {spacing}}}\n")
    studies = Studies(Workflow({"scenes": ["tiny"], "accuracy": level}))
    for name in study_names():
        cases = studies.study(name, level).cases
        assert cases and all(studies.depends(name, level, case) for case in cases)


def test_a_level_without_a_value_of_its_own_takes_that_of_the_next_coarser_one(write):
    write(SMALL.replace("standard: [10, 12], ", ""))
    given = {level: load_study("small", level).cases["taylor_green-5"].parameters.resolutions
             for level in ("draft", "standard", "fine")}
    assert given == {"draft": (8,), "standard": (8,), "fine": (12, 14)}
    write(SMALL.replace("draft: [8], ", ""))
    assert load_study("small", "draft").cases["taylor_green-5"].parameters.resolutions == (10, 12)


@functools.cache
def effect_files(module, choices):
    """Names of the effects whose files count for the outcome of cases."""
    used = modules_used(module, choices)
    return {path.stem for path in used if path.parent == digest.ROOT / "sim" / "effects"} & {*REGISTRY}


@pytest.mark.parametrize("name", ["ink_drop_study", "oil_shape_study", "coupling_study", "collision_study"])
def test_what_only_reads_runs_depends_on_no_effect(name, monkeypatch):
    monkeypatch.chdir(ROOT)
    case = next(case for case in load_study(name).cases.values() if case.folders())
    assert not case.choices() and not effect_files(case.family.module, case.choices())


@pytest.mark.parametrize("family", family_names())
def test_the_effects_that_a_family_names_count_for_its_cases(family, monkeypatch):
    """Of what is solved, in its file and in that of the hard cases, every name of an effect is one that counts."""
    monkeypatch.chdir(ROOT)
    cases = [case for study in study_names() for case in plan.cached_study(study, "draft").cases.values()
             if case.family.name == family]
    assert cases
    if all(case.folders() for case in cases):
        return
    read = {path: ast.parse(path.read_text()) for path in modules_used(cases[0].family.module)
            if path.stem in (family, "hard_cases")}
    names = {node.value for tree in read.values() for node in ast.walk(tree) if isinstance(node, ast.Constant)}
    fields = {field.name for field in dataclasses.fields(cases[0].parameters)}
    counted = {case.name: effect_files(case.family.module, case.choices()) for case in cases}
    assert names & {*REGISTRY} - fields <= set().union(*counted.values())
    for case in cases:
        assert {name for scene in case.solved() for name in scene.effects} <= counted[case.name]


@pytest.mark.parametrize("name", ["cannula_flow", "exchanged_oil", "moved_oil", "shed_droplets"])
def test_liquids_that_a_case_reads_count_for_its_outcome(name, monkeypatch):
    monkeypatch.chdir(ROOT)
    case = next(case for study in ("injection_study", "oil_study", "emulsion_study")
                for case in load_study(study).cases.values() if case.family.name == name)
    before, known = case.digest(), plan.project_materials()
    oil = known[case.family.liquids(case.parameters)[0]]
    for change in ({"dynamic_viscosity": 7.0}, {"density": 1.07 * oil.density}):
        other = known | {oil.name: dataclasses.replace(oil, **change)}
        monkeypatch.setattr(plan, "project_materials", lambda other=other: other)
        assert case.digest() != before


def test_a_case_is_run_again_when_a_value_of_it_changes_that_its_name_does_not_tell(write):
    told = []
    for text in (SMALL, SMALL.replace("decay: 0.02", "decay: 0.03"), SMALL.replace("draft: [8]", "draft: [16]")):
        write(text)
        told.append(load_study("small").case("taylor_green-5").digest())
    assert len(set(told)) == 3


def test_a_case_that_solves_a_scene_is_run_again_when_the_scene_changes_and_is_another_at_each_level(monkeypatch):
    monkeypatch.chdir(ROOT)
    case = next(iter(load_study("injection_size_study").cases.values()))
    told = {level: dataclasses.replace(case, accuracy=level).digest() for level in ("draft", "standard")}
    scene = plan.cached_scene(case.family.solves(case.parameters), "draft")
    gravity = dataclasses.replace(scene.effects["gravity"], posture="prone")
    monkeypatch.setattr(plan, "cached_scene", lambda *_: dataclasses.replace(
        scene, effects=scene.effects | {"gravity": gravity}))
    plan._scene_text.cache_clear()
    told["changed"] = case.digest()
    plan._scene_text.cache_clear()
    assert len(set(told.values())) == 3


def test_the_code_of_the_scheme_counts_for_a_case_that_chooses_it(write):
    write(SMALL.replace("start:", "scheme: [dfsph, wcsph]\n    start:"))
    for scheme, other in (("dfsph", "wcsph"), ("wcsph", "dfsph")):
        case = load_study("small").case(f"taylor_green-{scheme}-5")
        used = {path.stem for path in modules_used(case.family.module, case.choices())}
        assert scheme in used and other not in used


@pytest.mark.usefixtures("nothing_planned")
def test_the_page_of_a_study_is_made_again_when_its_words_change(write):
    studies, told = Studies(Workflow({"scenes": ["tiny"], "accuracy": "draft"})), []
    for text in (SMALL, SMALL.replace("title: Small", "title: Tiny"), f"{SMALL}description: why\n"):
        write(text)
        plan.cached_study.cache_clear()
        told.append(studies.report_depends("small", "draft"))
    assert len(set(told)) == 3


def test_families_that_read_liquids_say_which():
    reading = [family for family in map(family_of, family_names())
               if hasattr(importlib.import_module(family.module), "project_materials")]
    assert reading and all(family.liquids is importlib.import_module(family.module).liquids for family in reading)


def test_case_reads_its_scenes_at_the_level_of_the_study(monkeypatch):
    monkeypatch.chdir(ROOT)
    case, = load_study("ink_drop_study", "standard").cases.values()
    assert {str(folder) for folder in case.folders().values()} == {
        f"outputs/{name}/standard" for name in ("ink_drop", "ink_drop_0003", "ink_drop_0005")}


@pytest.mark.parametrize(("name", "level"), [("hard_eye_study", "standard"), ("step_size_study", "fine"),
                                             ("injection_size_study", "draft")])
def test_case_solves_its_scene_at_the_level_of_the_study(name, level, monkeypatch):
    monkeypatch.chdir(ROOT)
    expected = load_accuracy_levels(ROOT / "config" / "accuracy.yaml")[level]
    scenes = [scene for case in load_study(name, level).cases.values() for scene in case.solved()]
    assert scenes
    assert {(scene.numerics.particle_spacing, scene.numerics.pressure_tolerance) for scene in scenes} == {
        (expected.particle_spacing, expected.pressure_tolerance)}


def test_cases_are_all_combinations_named_by_what_differs(write):
    write(SMALL)
    study = load_study("small", "standard")
    assert list(study.cases) == ["taylor_green-5", "taylor_green-10"]
    assert study.cases["taylor_green-5"].parameters.resolutions == (10, 12)


def test_how_long_a_case_runs_is_not_in_its_name(write):
    write("cases: {channel: [{support_ratio: 3.0}, {support_ratio: 2.5, times: 16, steps: 160}]}")
    assert list(load_study("small").cases) == ["channel-3", "channel-2.5"]
    write("cases: {channel: [{}, {times: 16}]}")
    with pytest.raises(UserError, match="declares the case channel twice"):
        load_study("small")


@pytest.mark.parametrize(("text", "sentence"), [
    ("cases: {}", "cases is empty, but must name at least one of"),
    ("cases: {taylor_gren: {}}", "did you mean taylor_green"),
    ("cases: {taylor_green: {reynolds: -1}}", "cases.taylor_green.reynolds is -1, but must be above 0"),
    ("cases: {taylor_green: {raynolds: 1}}", "did you mean reynolds"),
    ("cases: {taylor_green: {scheme: sph}}", "scheme is \"sph\", but must be one of"),
    ("cases: {taylor_green: [{reynolds: 1}, {reynolds: 1}]}", "declares the case taylor_green twice"),
    ("cases: {taylor_green: 1}", "must be a mapping"),
    ("cases: {taylor_green: {reynolds: {draft: 1, standart: 2}}}", "did you mean standard"),
    ("caes: {}", "did you mean cases"),
    ("{report: tradeoff, cases: {still_tank: {}}}", "cases.still_tank has no headline, whose error"),
])
def test_study_with_errors_is_refused_in_a_sentence(write, text, sentence):
    write(text)
    with pytest.raises(UserError) as caught:
        load_study("small")
    assert sentence in str(caught.value)


def test_unknown_study_case_and_level_list_what_is_allowed(write):
    write(SMALL)
    with pytest.raises(UserError, match=r"did you mean small"):
        load_study("smal")
    with pytest.raises(UserError, match="must be one of draft, standard, fine"):
        load_study("small", "finest")
    with pytest.raises(UserError, match="its cases are taylor_green-5, taylor_green-10"):
        load_study("small").case("taylor_green-6")
    write(SMALL.replace("5, 10", ", ".join(map(str, range(5, 40)))))
    with pytest.raises(UserError, match=r"its 35 cases are listed by: python -m pipeline.study small .*--list"):
        load_study("small").case("taylor_green-4")


# A whole run

@pytest.mark.thorough
def test_study_writes_its_table_and_repeats_only_what_changed(project, write):
    write(SMALL)
    code, output = project.snakemake("small")
    assert code == 0 and TRACE not in output, output
    folder = project.folder / "outputs" / "studies" / "small" / "draft"
    with (folder / "table.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == (*COLUMNS, *MADE)
    assert {row["holds"] for row in rows} <= {"true", "false", ""}
    assert {row["case"] for row in rows if row["quantity"] == "decay rate of the energy"} == {
        "taylor_green-5 n=8", "taylor_green-10 n=8"}
    assert all(float(row["wall_s"]) > 0.0 for row in rows if row["quantity"] == "time reached")
    assert (folder / "taylor_green_decay.png").is_file() and "Small" in (folder / "table.html").read_text()
    assert "rows hold" in output

    code, output = project.snakemake("-n", "small")
    assert "Nothing to be done" in output, output
    write(SMALL.replace("[5, 10]", "[5, 20]"))
    code, output = project.snakemake("-n", "small")
    assert planned(output)["study_case"] == 1, output


@pytest.mark.thorough
def test_broken_study_stops_only_those_who_ask_for_it(project, write):
    write("cases: {}")
    code, output = project.snakemake("-n", "small")
    assert code == 2 and "error: config/studies/small.yaml: cases is empty" in output and TRACE not in output
    code, output = project.snakemake("-n", "outputs/tiny/draft/scene.json")
    assert code == 0, output
