"""What `snakemake results` runs: all that numbers of docs/results come from, and what is long has a smaller twin."""
import csv
import dataclasses
import shutil
import types
from pathlib import Path

import pytest
from helpers import forked

from pipeline.base.errors import UserError
from pipeline.scenes.folders import scene_paths
from pipeline.scenes.load import load_accuracy_levels
from pipeline.studies.plan import cached_study, study_names
from pipeline.workflow.studies import Studies
from studies.results.plan import LONG, PLAN, Run, made_by, not_made, read_plan, time_taken
from studies.results.tables import FOLDER, Row, read_layout, read_rows
from studies.results.workflow import Results

ROOT = Path(__file__).resolve().parents[2]
LAYOUT = read_layout(ROOT / FOLDER)
ROWS = {page.name: read_rows(ROOT / FOLDER, page) for page in LAYOUT.pages}
ALL = read_plan(ROOT / PLAN)


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "results.yaml"
    path.write_text(text)
    return path


def test_every_number_of_the_results_is_made_by_a_run_or_set_aside():
    assert list(not_made(ALL, ROWS)) == []


def test_a_table_that_no_run_makes_is_told_in_one_sentence():
    fewer = dataclasses.replace(ALL, runs=tuple(run for run in ALL.runs if run.name != "effects_study"))
    assert list(not_made(fewer, ROWS)) == [
        "docs/results/effects.csv: the table off has numbers of `snakemake -j2 effects_study` at draft, which no run "
        "of config/results.yaml makes"]


def test_the_pages_are_refused_where_a_table_has_no_run(tmp_path):
    for name in ("docs/results", "README.md", "benchmarks/dam_break/results.csv", "config/results.yaml"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        copy(ROOT / name, tmp_path / name)
    plan = tmp_path / "config" / "results.yaml"
    plan.write_text("\n".join(line for line in plan.read_text().splitlines() if "effects_study" not in line))
    found = forked.run("studies.results", "--project", tmp_path, "--check")
    assert found.returncode == 2 and found.stderr.count("error: ") == 1
    assert "the table off has numbers of `snakemake -j2 effects_study` at draft" in found.stderr


@pytest.mark.parametrize(("command", "runs"), [
    ("snakemake -j2 validation", {("study", "validation", "draft")}),
    ("snakemake -j2 oil_study --config accuracy=draft", {("study", "oil_study", "draft")}),
    ("python -m pipeline.study validation --accuracy draft", {("study", "validation", "draft")}),
    ("./run outputs/gas_eye/draft/metrics.csv", {("scene", "gas_eye", "draft")}),
    ("./run", {("scene", "tamponade", "draft"), ("scene", "emulsification", "draft")}),
    ("./run all --config accuracy=draft", {("scene", "tamponade", "draft"), ("scene", "emulsification", "draft")}),
    ("pytest tests/stages/test_metrics.py -k wedge", set()),
])
def test_a_command_stands_for_its_runs(command, runs):
    assert made_by(Row("a", "b", "c", level="draft", command=command)) == runs


def test_runs_are_what_there_is_the_cheapest_first_and_every_study_is_among_them():
    levels, scenes = load_accuracy_levels(ROOT / "config" / "accuracy.yaml"), scene_paths(ROOT / "config" / "scenes")
    for run in ALL.runs:
        assert run.level in levels and run.name in (study_names() if run.kind == "study" else scenes), run.key
        assert run.targets(cached_study(run.name, run.level).cases if run.kind == "study" else ()), run.key
    assert [run.minutes for run in ALL.runs] == sorted(run.minutes for run in ALL.runs)
    assert set(study_names()) <= {run.name for run in ALL.runs}


def test_what_is_long_says_so_and_has_a_twin_that_is_run_in_its_place():
    small = {run.key for run in ALL.small}
    long = [run for run in ALL.runs if run.minutes > LONG]
    assert long and all(run.twin in small and f"smaller twin is {run.twin}" in run.words() for run in long)
    assert ALL.priority(ALL.runs[0]) > ALL.priority(ALL.small[-1]) > 0 > ALL.priority(long[0]) > ALL.priority(long[-1])


@pytest.mark.parametrize(("text", "told"), [
    ("runs: [{study: a, level: draft, minutes: 500}]", "a_draft takes more than 120 minutes and so needs a twin"),
    ("runs: [{study: a, level: draft, minutes: 1}, {study: a, level: draft, minutes: 2}]", "a_draft is there twice"),
    ("runs: [{study: a, level: draft}]", "must have a study or a scene, a level and minutes"),
    ("runs: [{study: a, scene: b, level: draft, minutes: 1}]", "must have a study or a scene, a level and minutes"),
    ("runs: [{study: a, level: draft, minutes: 1, twins: b}]", "must have a study or a scene, a level and minutes"),
])
def test_a_wrong_plan_is_told(tmp_path, text, told):
    with pytest.raises(UserError, match=told):
        read_plan(written(tmp_path, text))


def test_what_a_run_took_here_is_told_in_place_of_what_it_may_take(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = Run("study", "a", "draft", 30.0)
    assert run.words() == "a at draft: about 30 min of two cores"
    run.folder.mkdir(parents=True)
    with (run.folder / "table.csv").open("w", newline="") as file:
        csv.writer(file).writerows([("case", "wall_s"), ("one", "60"), ("one", "90"), ("two", "30"), ("two", "")])
    assert time_taken(run.folder) == 120.0
    assert run.words() == "a at draft: 2.0 min here"


def test_commands_take_what_a_table_has_and_gather_cases_before():
    found = {run.key: run.commands(LAYOUT, ROWS) for run in ALL.runs}
    assert found["effects_study_draft"] == [
        "python -m studies.results --take outputs/studies/effects_study/draft"]
    assert found["validation_standard"] == [
        "python -m pipeline.study_report validation --accuracy standard --so-far",
        "python -m studies.results --take outputs/studies/validation/standard/so_far"]
    assert found["tamponade_standard"] == ["python -m studies.results --take outputs/tamponade/standard"]
    assert found["fill_study_draft"] == [] and "benchmarks/entry.py" in found["tamponade_10_draft"][0]
    cases = ALL.runs[[run.key for run in ALL.runs].index("validation_standard")].targets(
        cached_study("validation", "standard").cases)
    assert 10 < len(cases) < 100 and all("/cases/" in case for case in cases)


def rules_of(monkeypatch, target):
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr("sys.argv", ["snakemake", target])
    return Results(Studies.__new__(Studies))


def test_rules_are_there_for_those_alone_who_ask_for_results(monkeypatch):
    nothing = rules_of(monkeypatch, "all")
    assert nothing.runs == () and nothing.rules("study") == nothing.rules("scene") == []
    results = rules_of(monkeypatch, "results_small")
    rules = results.rules("study") + results.rules("scene")
    assert len(rules) == len({name for name, *_ in rules}) == len(ALL.runs)
    assert rules[0][1] == "equilibrium_study" and rules[0][3] == max(rule[3] for rule in rules)


def test_cheap_scenes_and_studies_take_turns_and_numbers_are_taken_before_the_next_run(monkeypatch):
    results = rules_of(monkeypatch, "results")
    rules = [types.SimpleNamespace(name=name, priority=priority)
             for name, *_, priority in results.rules("study") + results.rules("scene")]
    order = [rule.name.split("_", 2)[2] for rule in sorted(rules, key=lambda rule: -rule.priority)]
    assert order == [run.key for run in ALL.runs]
    short = [types.SimpleNamespace(name=name, priority=0) for name in ("metrics", "eye_study_report", "results_of_x")]
    before = [rule.priority for rule in rules]
    results.hasten(rules + short)
    assert [rule.priority for rule in rules] == before and min(one.priority for one in short) > max(before)
    rules_of(monkeypatch, "all").hasten(idle := [types.SimpleNamespace(name="metrics", priority=0)])
    assert idle[0].priority == 0
