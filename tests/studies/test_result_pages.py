"""The pages of results are those of their tables, and fresh runs bring their numbers into the tables."""
import csv
import dataclasses
import math
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from pipeline.base.errors import UserError
from pipeline.scenes.load import load_scene
from pipeline.studies.model import COLUMNS as STUDY_COLUMNS
from pipeline.studies.model import MADE
from studies.questions.moved_oil import moved_oil_page
from studies.questions.shed_droplets import shed_droplets_page
from studies.results.__main__ import BEGIN, END, main
from studies.results.tables import Page, Row, read_layout, read_rows, write_rows

ROOT = Path(__file__).resolve().parents[2]
LAYOUT = read_layout(ROOT / "docs" / "results")


@pytest.fixture
def project(tmp_path) -> Path:
    """A copy of all that the pages are made of."""
    shutil.copytree(ROOT / "docs" / "results", tmp_path / "docs" / "results")
    for name in ("README.md", "benchmarks/dam_break/results.csv"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    return tmp_path


def take(project: Path, folder: Path, *options: str) -> int:
    """Take the numbers of a folder of outputs over; return the exit code."""
    return main(["--take", str(folder), *options, "--project", str(project)])


def page_of(name: str) -> Page:
    return next(page for page in LAYOUT.pages if page.name == name)


def rows_of(project: Path, name: str) -> list[Row]:
    return read_rows(project / "docs" / "results", page_of(name))


def all_rows(project: Path) -> list[Row]:
    return [row for page in LAYOUT.pages for row in rows_of(project, page.name)]


def add_rows(project: Path, name: str, *rows: Row) -> None:
    write_rows(project / "docs" / "results", page_of(name), [*rows_of(project, name), *rows])


def study_table(project: Path, name: str, level: str, *lines: dict) -> Path:
    folder = project / "outputs" / "studies" / name / level
    folder.mkdir(parents=True)
    made = {"machine": "a machine, 4 cores", "code": "0.3 (fed)", "command": f"snakemake -j2 {name}"}
    with (folder / "table.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, [*STUDY_COLUMNS, *MADE], restval="")
        writer.writeheader()
        writer.writerows(made | line for line in lines)
    return folder


def test_the_pages_and_the_readme_are_those_of_their_tables():
    assert main(["--check", "--project", str(ROOT)]) == 0


def typed_numbers(text: str) -> list[tuple[str, str, list[str]]]:
    """Numbers with a unit that somebody has typed beside links to results: number, unit of the tables, linked pages."""
    before, _, rest = text.partition(BEGIN)
    found = []
    for line in (before + rest.partition(END)[2]).splitlines():
        linked = re.findall(r"docs/results/(\w+)\.md", line)
        plain = re.sub(r"\]\([^)]*\)|`[^`]*`", "", line)
        told = re.findall(rf"([\d.]+) ({'|'.join(TYPED)})\b", plain) if linked else []
        found += [(number, TYPED[unit], linked) for number, unit in told]
    return found


def not_of_tables(text: str) -> list[str]:
    """Those of them that no row of the linked pages has, as they are rounded."""
    wrong = []
    for number, unit, linked in typed_numbers(text):
        digits = len(number.partition(".")[2])
        rows = [row for page in linked for row in rows_of(ROOT, page)]
        values = [float(row.value) for row in rows if row.unit == unit and row.value] + [
            float(row.error) for row in rows if row.error_unit == unit and row.error]
        if not any(round(value, digits) == float(number) for value in values):
            wrong.append(f"{number} {unit}")
    return wrong


TYPED = {"minutes": "min", "points": "points"}  # as prose has them, and as tables do


def test_numbers_typed_into_the_readme_beside_results_are_of_the_tables():
    readme = (ROOT / "README.md").read_text()
    assert len(typed_numbers(readme)) >= 2
    assert not_of_tables(readme) == []
    assert not_of_tables(readme.replace("2.0 points", "2.9 points")) == ["2.9 points"]


def test_a_changed_number_makes_its_page_and_the_readme_stale_until_they_are_written(project, capsys):
    table = project / "docs" / "results" / "costs.csv"
    table.write_text(re.sub(r"of the simulation,[\d.]+,", "of the simulation,14.5,", table.read_text(), count=1))
    assert main(["--check", "--project", str(project)]) == 1
    told = capsys.readouterr().err
    assert [line.split()[1].rpartition("/")[2] for line in told.splitlines()] == ["costs.md", "README.md"]
    assert "is older than its tables: python -m studies.results" in told
    assert main(["--project", str(project)]) == 0 == main(["--check", "--project", str(project)])
    assert "**14.5 min**" in (project / "README.md").read_text()


def test_a_number_of_the_readme_has_its_uncertainty_before_its_unit():
    told = next(one for one in LAYOUT.headlines if one.band)
    line = next(line for line in (ROOT / "README.md").read_text(encoding="utf-8").splitlines() if told.words in line)
    width = next(float(row.value) for row in rows_of(ROOT, told.page)
                 if (row.case, row.quantity, row.level) == (told.case, told.band, told.level))
    assert re.search(rf"\| \*\*\S+ ± {round(width / 2)} %\*\* \|", line)


def change_lacked(code: str, commits: list[str]) -> str | None:
    """The first of some commits that a commit does not have, "" for none; None where git does not know one of them."""
    if shutil.which("git") is None:
        return None
    for commit in commits:
        told = subprocess.run(["git", "merge-base", "--is-ancestor", commit, code], cwd=ROOT, capture_output=True,
                              check=False)
        if told.returncode:
            return commit if told.returncode == 1 else None
    return ""


def test_numbers_lack_the_changes_that_git_says_they_lack():
    said = {code: change.commit for change in LAYOUT.changes for code in change.before}
    codes = {re.sub(r".*\((\w+)\)", r"\1", row.code) for page in LAYOUT.pages for row in rows_of(ROOT, page.name)}
    assert said.keys() <= codes
    assert all(code in said for code in codes if not re.fullmatch(r"[0-9a-f]{7,}", code))
    by_git = {code: change_lacked(code, [change.commit for change in LAYOUT.changes]) for code in codes}
    assert {code: one for code, one in by_git.items() if one is not None and one != said.get(code, "")} == {}


def test_a_number_in_no_group_of_a_summary_is_told(project):
    table = project / "docs" / "results" / "validation.csv"
    table.write_text(table.read_text().replace("spin_down-", "spin_up-"))
    with pytest.raises(UserError, match="spin_up-central is in 0 groups of the summary of validation, but must be in"):
        main(["--check", "--project", str(project)])


def test_pages_on_methods_leave_the_numbers_of_a_case_to_its_table():
    families = {row.case.partition("-")[0] for page in LAYOUT.pages for row in rows_of(ROOT, page.name)}
    families |= {table.study for page in LAYOUT.pages for table in page.tables}
    told = []
    for path in sorted((ROOT / "docs" / "methods").glob("*.md")):
        evidence = re.sub(r"\]\([^)]*\)", "]", path.read_text(encoding="utf-8").partition("## Validated by")[2])
        for family, words in re.findall(r"`(\w+)`\s*\(([^()]*)\)", evidence):
            if family in families and re.search(r"\d\s*%|\d\.\d|\de-\d|\d\s+(points|degrees|mm|times)\b", words):
                told.append(f"{path.name}: {family} ({words})")
    assert told == []


def test_a_page_without_a_table_is_told(project):
    (project / "docs" / "results" / "old.md").write_text("# Old\n")
    with pytest.raises(UserError, match=r"old\.md: belongs to no page"):
        main(["--check", "--project", str(project)])


def test_a_study_replaces_the_row_of_the_same_case_quantity_and_level(project):
    """Not those of another level, nor those of another study that call theirs the same."""
    line = {"case": "oil_shape s1_tamponade_gamma3", "quantity": "sphericity of the oil at the end",
            "value": "0.851234", "unit": "1"}
    source = f"{line['case']}: {line['quantity']}"
    with pytest.raises(UserError, match="no row of docs/results has a number of it"):
        take(project, study_table(project, "oil_shape_study", "standard", line))
    own = next(row for row in rows_of(project, "oil_shape") if row.source == source)
    add_rows(project, "oil_shape", dataclasses.replace(own, case="finer", level="fine"))
    add_rows(project, "mixing", dataclasses.replace(own, table="ink"))
    judged = {"case": "spin_down-central R/dx=48", "quantity": "decay rate", "value": "9", "unit": "1/s",
              "tolerance": "0.05", "holds": "false"}  # the table of another study has every number of such cases
    before = all_rows(project)
    assert take(project, study_table(project, "oil_shape_study", "draft", line, judged), "--code", "0.2 (abc)") == 0
    changed = [(old, new) for old, new in zip(before, all_rows(project), strict=True) if old != new]
    assert [(new.table, new.source, new.level, new.value, new.machine, new.code) for _, new in changed] == [
        ("shape", source, "draft", "0.851", "a machine, 4 cores", "0.2 (abc)")]
    assert " | 0.851 |" in (project / "docs" / "results" / "oil_shape.md").read_text()
    assert main(["--check", "--project", str(project)]) == 0


def test_a_study_tells_anew_whether_a_row_holds_in_the_units_of_the_row(project):
    case = "oil_in_sphere-3-0.8-18.2--35-0.1-0 R/dx=11"
    lines = ({"case": case, "quantity": "arc of contact", "value": "190", "unit": "deg", "reference": "184",
              "error": "6", "error_is": "absolute", "tolerance": "5", "holds": "false"},)
    assert take(project, study_table(project, "validation", "standard", *lines)) == 0
    row = next(row for row in rows_of(project, "oil_in_sphere") if row.source == f"{case}: arc of contact")
    assert (row.value, row.expected, row.error, row.error_unit, row.holds) == ("190.0", "184.0", "6", "deg", "no")
    lines = ({"case": "position_based pbf_honey", "quantity": "radius at the end, viscous current (Huppert 1982)",
              "value": "0.14", "unit": "m", "reference": "0.1428571", "error": "0.02", "tolerance": "0.1",
              "error_is": "relative", "holds": "true"},
             {"case": "position_based pbf_equality_corrected", "quantity": "smallest spacing / dx, mean of the frames",
              "value": "0.6543", "unit": "1"})
    assert take(project, study_table(project, "pbf_study", "draft", *lines)) == 0
    row = next(row for row in rows_of(project, "position_based") if "pbf_honey: radius" in row.source)
    assert (row.value, row.unit, row.expected, row.error, row.error_unit) == ("140", "mm", "143", "2", "%")
    assert (row.allowed, row.holds) == ("10", "yes")
    row = next(row for row in rows_of(project, "position_based") if "pbf_equality_corrected: small" in row.source)
    assert (row.value, row.unit) == ("0.65", "spacings")


def test_new_cases_come_only_where_they_are_asked_for(project):
    line = {"case": "spin_down-central n=32", "quantity": "decay rate", "value": "5.8", "unit": "1/s"}
    folder = study_table(project, "validation", "fine", line)
    with pytest.raises(UserError, match="--add brings new ones"):
        take(project, folder)
    assert take(project, folder, "--add", "flow=spin_down*") == 0
    row = rows_of(project, "validation")[-1]
    assert (row.table, row.case, row.value, row.level) == ("flow", line["case"], "5.8", "fine")
    assert (row.machine, row.code, row.command) == ("a machine, 4 cores", "0.3 (fed)", "snakemake -j2 validation")


def test_a_table_of_an_earlier_version_is_told(project):
    folder = study_table(project, "validation", "fine")
    (folder / "table.csv").write_text("case,quantity,value\nspin_down-central,decay rate,5.8\n")
    with pytest.raises(UserError, match="run the study again: snakemake -j2 validation"):
        take(project, folder)


def test_a_relative_error_is_told_in_percent(project):
    line = {"case": "spin_down-central n=32", "quantity": "height", "value": "1.13371", "unit": "m",
            "reference": "1.1335", "error": "0.000183137", "error_is": "relative", "tolerance": "0.02", "holds": "true"}
    folder = study_table(project, "validation", "fine", line)
    assert take(project, folder, "--add", "flow=spin_down*") == 0
    row = rows_of(project, "validation")[-1]
    assert (row.error, row.allowed, row.error_unit) == ("0.01831", "2", "%")


def test_a_table_of_cases_has_the_finest_resolution_and_whatever_does_not_hold(project):
    lines = [{"case": f"spin_down-central R/dx={size}", "quantity": "decay rate", "value": value, "unit": "1/s",
              "reference": "5.783", "error": error, "error_is": "relative", "tolerance": "0.05", "holds": holds}
             for size, value, error, holds in ((12, "6.2", "0.07211", "false"), (18, "5.9", "0.02023", "true"),
                                              (24, "5.8", "0.00294", "true"))]
    lines += [{"case": "spin_down-central", "quantity": "observed order", "value": "2"},
              {"case": "spin_up-central R/dx=24", "quantity": "decay rate", "value": "1", "tolerance": "0.05"}]
    folder = study_table(project, "validation", "fine", *lines)
    before = rows_of(project, "validation")
    assert "spin_down-central" in {row.case for row in before} and "fine" not in {row.level for row in before}
    for _ in range(2):  # a second time they replace themselves
        assert take(project, folder) == 0
        rows = rows_of(project, "validation")
        assert [row for row in rows if row.level != "fine"] == before
        fine = [row for row in rows if row.level == "fine"]
        assert [(row.table, row.case, row.size, row.value, row.expected, row.error, row.allowed, row.holds)
                for row in fine] == [("flow", "spin_down-central", "R/dx=12", "6.2", "5.783", "7.211", "5", "no"),
                                     ("flow", "spin_down-central", "R/dx=24", "5.8", "5.783", "0.294", "5", "yes")]


def test_a_run_replaces_what_its_metrics_and_its_logs_say(project):
    folder = project / "outputs" / "tamponade" / "standard"
    (folder / "logs").mkdir(parents=True)
    scene = load_scene(ROOT / "config" / "scenes" / "clinic" / "tamponade.yaml", "standard")
    (folder / "scene.json").write_text(scene.to_json())
    head = "frame,fill [%],particles_outside [1],speed_rms [mm/s],retina_coverage_inferior [%]"
    (folder / "metrics.csv").write_text(head + "".join(f",retina_coverage_{part} [%]" for part in (
        "whole", "superior", "macula")) + ",retina_coverage_band_whole [%],retina_coverage_band_inferior [%]"
        "\n0,0,0,0,0,0,0,0,0,0\n1,84.9,3,0.5,35.5,50,70,100,6,14\n")
    for segment, wall in (("000", 60.0), ("001", 30.0)):
        (folder / "logs" / f"simulate_{segment}.log.json").write_text(
            f'{{"wall": {wall}, "cpu": {2 * wall}, "memory": 1e9}}')
    before = all_rows(project)
    assert take(project, folder, "--code", "0.2 (abc)") == 0
    changed = [new for old, new in zip(before, all_rows(project), strict=True) if old != new]
    assert {(row.source.partition(": ")[0], row.level, row.code) for row in changed} == {
        ("tamponade", "standard", "0.2 (abc)")}
    eye = {row.quantity: row for row in rows_of(project, "eye") if (row.case, row.level) == ("tamponade", "standard")}
    assert eye["fill at the end"].value == "84.9000"
    inferior = eye["retina under the oil, upright: inferior half"]
    assert (inferior.value, float(inferior.error), inferior.holds) == ("36", 0.5, "yes")
    outside = eye["particles outside the wall, most in any frame"]
    assert (outside.value, outside.holds) == ("3", "no")
    costs = {row.quantity: row.value for row in rows_of(project, "costs") if row.case.startswith("tamponade, 10 s")}
    assert (costs["wall time of the simulation"], costs["time of all cores, simulation"]) == ("1.5", "3")
    assert costs["memory"] == "1.00"
    readme = (project / "README.md").read_text()
    assert "**36 ± 7 %**" in readme and "**1.5 min**" in readme
    asked = [row for path in (project / "docs" / "results").glob("*.csv") for row in rows_of(project, path.stem)
             if row.holds]
    near = sum(row.holds == "yes" for row in asked)
    assert f"Of all [{len(asked)} numbers](docs/results/README.md) that have one, {near} are within" in readme


@pytest.mark.parametrize(("change", "told"), [
    ({"value": "0.1 to 0.2"}, "must be one number"),
    ({"error": "3", "allowed": "2", "holds": "yes"}, "but the error is 3 and 2 is allowed"),
    ({"table": "nowhere"}, "is in the table nowhere"),
    ({"value": "", "error": ""}, "has neither value nor error"),
])
def test_a_wrong_row_is_told_and_not_printed(project, change, told):
    folder = project / "docs" / "results"
    page = next(page for page in read_layout(folder).pages if page.name == "effects")
    rows = read_rows(folder, page)
    for name, value in change.items():
        setattr(rows[0], name, value)
    write_rows(folder, page, rows)
    with pytest.raises(UserError, match=told):
        read_rows(folder, page)


def test_every_number_says_where_it_comes_from():
    folder = ROOT / "docs" / "results"
    for page in read_layout(folder).pages:
        for row in read_rows(folder, page):
            assert row.code, f"{page.name}: {row.case}"
            assert row.command, f"{page.name}: {row.case}"


def test_the_words_on_accuracy_in_the_eye_are_those_of_its_table():
    rows = [row for row in rows_of(ROOT, "accuracy") if row.table == "eye_levels"]
    found = {(row.case, row.quantity): float(row.value) for row in rows}
    draft, standard = "the eye at 1 mm", "the eye at 0.4 mm"
    least, most, fine = found[draft, "off at rest, least"], found[draft, "off at rest, largest"], found[
        standard, "off at rest, largest"]
    times = found[standard, "computing time"] / found[draft, "computing time"]
    text = (ROOT / "docs" / "results" / "accuracy.md").read_text(encoding="utf-8")
    assert (f"by {least:.1f} to {math.ceil(10 * most) / 10:.1f} points at `draft` and by {fine:.1f} at `standard`, "
            f"which takes {times:.0f} times the time by the clock") in text


def test_numbers_that_pages_of_studies_tell_are_those_of_the_tables():
    def found(page: str, case: str, quantity: str, column: str = "value") -> list[float]:
        return [float(getattr(row, column)) for row in rows_of(ROOT, page)
                if case in row.case and row.quantity.startswith(quantity)]

    def span(numbers: list[float], scale: float = 1.0) -> tuple[float, float]:
        return round(scale * min(numbers), 1), round(scale * max(numbers), 1)

    page = moved_oil_page
    sphere = ("validation", "turned_sphere-3")
    assert span(found(*sphere, "error of the stress"), 100.0) == page.RMS_OF_SPHERE
    assert span(found(*sphere, "largest stress at the wall", "error")) == page.HIGH_OF_SPHERE
    assert all(float(row.value) > float(row.expected) for row in rows_of(ROOT, "validation")
               if sphere[1] in row.case and row.quantity == "largest stress at the wall")
    assert tuple(found("turning_eye", "saccades", "shear stress on the retina, largest of")) == page.MEAN_OF_SACCADE
    assert tuple(found("turning_eye", "saccades", "shear stress that 1 %")) == page.HIGH_OF_SACCADE
    assert round(max(found("step_size", ", 4 ms", "rise, off")) / 100.0, 2) == page.STEP_ERROR
    narrow, wide = (found("step_size", case, "rise of the aqueous")[0] for case in (
        "0.4 mm, 1 ms", "support of 3 spacings, 1 ms"))
    assert round(wide / narrow, 2) == page.WIDER_SUPPORT
    assert [1e6 * found("mixing", "emulsification_contact_line", "droplets / cavity")[0]] == pytest.approx(
        [shed_droplets_page.BY_PARTICLES])
