"""Studies: their plans, what a case returns, the table, and that a rerun repeats only what changed."""
import csv
import math

import pytest
from conftest import ROOT
from snakemake_output import TRACE, planned

from pipeline.base.errors import UserError
from pipeline.scenes.load import load_accuracy_levels
from pipeline.study_kit.model import COLUMNS, Curve, Outcome, Row, bounded, compared, observed_order
from pipeline.study_kit.plan import load_study, study_names
from pipeline.study_report import summary

SMALL = """
title: Small
cases:
  taylor_green:
    reynolds: [5, 10]
    decay: 0.02
    resolutions: {draft: [8, 10], standard: [10, 12], fine: [12, 14]}
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


def test_summary_names_every_row_that_does_not_hold():
    rows = [row.cells("c") for row in (compared("good", 1.0, 1.0, 0.1), compared("bad", 2.0, 1.0, 0.1), Row("c", 1.0))]
    assert "1 of 2 rows hold, these do not:\n  c: bad is 2 1, error 1 above 0.1" in summary("s", rows)


# Plans

@pytest.mark.parametrize("accuracy", ["draft", "standard", "fine"])
@pytest.mark.parametrize("name", study_names(ROOT / "config" / "studies"))
def test_every_study_can_be_laid_out(name, accuracy, monkeypatch):
    monkeypatch.chdir(ROOT)
    study = load_study(name, accuracy)
    assert study.cases and len(set(study.pictures())) == len(study.pictures())
    assert all(case.digest() for case in study.cases.values())


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
    ("caes: {}", "did you mean cases"),
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


# A whole run

def test_study_writes_its_table_and_repeats_only_what_changed(project, write):
    write(SMALL)
    code, output = project.snakemake("small")
    assert code == 0 and TRACE not in output, output
    folder = project.folder / "outputs" / "studies" / "small" / "draft"
    with (folder / "table.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS
    assert {row["holds"] for row in rows} <= {"true", "false", ""}
    assert {row["case"] for row in rows if row["quantity"] == "decay rate of the energy"} == {
        f"taylor_green-{number} n={resolution}" for number in (5, 10) for resolution in (8, 10)}
    assert all(float(row["wall_s"]) > 0.0 for row in rows if row["quantity"] == "time reached")
    assert (folder / "taylor_green_decay.png").is_file() and "Small" in (folder / "table.html").read_text()
    assert "rows hold" in output

    code, output = project.snakemake("-n", "small")
    assert "Nothing to be done" in output, output
    write(SMALL.replace("[5, 10]", "[5, 20]"))
    code, output = project.snakemake("-n", "small")
    assert planned(output)["study_case"] == 1, output


def test_broken_study_stops_only_those_who_ask_for_it(project, write):
    write("cases: {}")
    code, output = project.snakemake("-n", "small")
    assert code == 2 and "error: config/studies/small.yaml: cases is empty" in output and TRACE not in output
    code, output = project.snakemake("-n", "outputs/tiny/draft/scene.json")
    assert code == 0, output
