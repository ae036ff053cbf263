"""The benchmark for other codes: its scorer, its references, and the entries beside it."""
import csv
import importlib.util
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pipeline.base.errors import UserError

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "benchmarks" / "tamponade-10"


def loaded(name: str, folder: Path = FOLDER):
    """A script of the benchmarks, as a module."""
    sys.path.insert(0, str(folder))
    try:
        specification = importlib.util.spec_from_file_location(name, folder / f"{name}.py")
        module = importlib.util.module_from_spec(specification)
        sys.modules[name] = module
        specification.loader.exec_module(module)
        return module
    finally:
        sys.path.remove(str(folder))


score, references = loaded("score"), loaded("references")
own = loaded("entry", ROOT / "benchmarks")
TABLES = score.read_references()


def run(*arguments) -> subprocess.CompletedProcess:
    """The scorer as users call it, with Python alone: no package of the environment can be imported."""
    return subprocess.run([sys.executable, "-I", "-S", FOLDER / "score.py", *arguments], capture_output=True, text=True)


def entry(path: Path, *cases: str, change=lambda number, line: line) -> Path:
    """An entry that has every reference itself, changed line by line."""
    lines = [[case, one.quantity, "" if one.time is None else f"{one.time:g}", f"{one.value:g}", one.unit]
             for case in cases for one in TABLES[case]]
    changed = [line for number, one in enumerate(lines) if (line := change(number, one)) is not None]
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([score.COLUMNS, *changed])
    return path


def test_there_are_ten_cases_each_with_words_parameters_and_a_reference():
    assert len(TABLES) == 10
    for case, table in TABLES.items():
        assert table and (FOLDER / case / "README.md").is_file()
        for name, one in json.loads((FOLDER / case / "case.json").read_text()).items():
            assert name in ("title", "codes") or "unit" in one or "meaning" in one, f"{case}: {name}"
        words = (FOLDER / case / "README.md").read_text()
        names = [re.sub("<.*?>", ".+", name) for name in re.findall(r"`(\w[\w.<>]+)`", words)]
        for one in table:
            assert one.tolerance > 0.0 and one.source, f"{case}: {one.name}"
            assert any(re.fullmatch(name, one.quantity) for name in names), f"{case}: {one.name} is not in its README"


def test_the_reference_tables_are_those_of_the_exact_solutions():
    surroundings = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}  # it reads score.py
    done = subprocess.run([sys.executable, FOLDER / "references.py", "--check"], capture_output=True, text=True,
                          env=surroundings)
    assert done.returncode == 0, done.stderr


def test_references_are_those_that_others_have_computed():
    """A sphere without gravity is a cap; the shapes of the pipeline and the known numbers of textbooks."""
    from studies.validation.kit.young_laplace import oil_at_rest

    beta, apex = references.interface_in_sphere(0.011, 0.0, np.radians(60.0), 0.8)
    exact = oil_at_rest(0.8, np.radians(60.0), 0.0, 0.011, 3)
    assert 360.0 - 2.0 * np.degrees(beta) == pytest.approx(exact.arc, abs=0.01)
    assert apex == pytest.approx(exact.apex, rel=1e-4)
    assert references.meniscus_curvature() == pytest.approx(0.6430, abs=2e-4)
    assert next(one.value for one in TABLES["spin_down"]) == pytest.approx(1.542, abs=1e-3)


def test_the_stress_of_a_slow_turn_is_that_of_even_acceleration():
    """A liquid so viscous that it turns with the wall pulls at it by rho R^2 dw/dt/5; sqrt(2/3) of that in the mean."""
    p = references.parameters("saccade") | {"watched": 1.0}
    viscous = references.largest_stress(p, 0.2, points=200, steps=2000)
    share = np.linspace(0.0, 1.0, 20001)
    rate = np.radians(p["amplitude"]) * p["peak_over_mean"] / p["duration"] * (4.0 * share * (1.0 - share)) ** 1.34794
    steepest = np.abs(np.diff(rate)).max() / (p["duration"] / 20000)
    assert viscous == pytest.approx(np.sqrt(2.0 / 3.0) * p["density"] * p["radius"] ** 2 / 5.0 * steepest, rel=0.02)


def test_a_film_that_drains_keeps_its_volume():
    """What has left is the flux at the lower end over time; both from the thickness there."""
    times = np.linspace(0.0, 2.0, 200001)[1:]
    thickness = np.where(times <= 1.0 / 3.0, 1.0, 1.0 / np.sqrt(3.0 * times))
    left = 1.0 - np.cumsum(thickness**3) * (times[1] - times[0])
    at = {line[1]: line[2] for line in references.film_on_plate()}
    for scaled, value in zip((1 / 6, 1 / 3, 1.0, 2.0), at.values(), strict=True):
        assert np.interp(scaled, times, left) == pytest.approx(value, abs=1e-3)


def test_the_reference_itself_scores_ten(tmp_path):
    done = run(entry(tmp_path / "exact.csv", *TABLES))
    assert done.returncode == 0, done.stderr
    assert "**10.0** of 10 entered" in done.stdout
    with (tmp_path / "scores" / "cases.csv").open() as file:
        assert [line["score"] for line in csv.DictReader(file)] == ["1"] * 10


def test_what_is_off_by_more_than_allowed_does_not_hold(tmp_path):
    off = {1: 0.9, 2: 1.1}  # lines of the sphere, in tolerances

    def shifted(number, line):
        tolerance = TABLES["sphere_at_rest"][number].tolerance
        return [*line[:3], f"{float(line[3]) - off.get(number, 0.0) * tolerance:.9g}", line[4]]

    done = run(entry(tmp_path / "off.csv", "sphere_at_rest", change=shifted), "--output", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    with (tmp_path / "out" / "rows.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["holds"] for row in rows] == ["yes", "yes", "no"] + ["yes"] * (len(rows) - 3)
    assert float(rows[2]["error"]) == pytest.approx(1.1 * TABLES["sphere_at_rest"][2].tolerance, rel=1e-3)
    assert f"{len(rows) - 1} of {len(rows)}" in done.stdout and "| – |" in done.stdout


@pytest.mark.parametrize(("change", "told"), [
    (lambda n, line: [*line[:4], "m"] if n == 1 else line, 'height_on_axis_18.2_deg is in "m", but must be in mm'),
    (lambda n, line: None if n == 0 else line, "sphere_at_rest has no line arc_18.2_deg (deg)"),
    (lambda n, line: ["spere", *line[1:]] if n == 0 else line, 'no case is called "spere"'),
    (lambda n, line: [line[0], "arc", *line[2:]] if n == 0 else line, 'sphere_at_rest has no quantity "arc"'),
    (lambda n, line: [*line[:3], "wide", line[4]] if n == 0 else line, 'arc_18.2_deg is "wide", but must be a number'),
    (lambda n, line: [*line[:3], "nan", line[4]] if n == 0 else line, 'arc_18.2_deg is "nan", but must be a number'),
    (lambda n, line: [*line[:2], "3", *line[3:]] if n == 0 else line, 'nothing is asked at the time "3"'),
    (lambda n, line: line[:4] if n == 0 else line, "has 4 cells, but must have 5"),
])
def test_a_wrong_line_is_told_in_a_sentence_and_does_not_hold(tmp_path, change, told):
    done = run(entry(tmp_path / "wrong.csv", "sphere_at_rest", change=change))
    assert done.returncode == 1
    assert told in done.stderr and "Traceback" not in done.stderr
    assert "**0.9** of 1 entered" in done.stdout


def test_what_is_no_entry_is_told(tmp_path):
    (tmp_path / "mine.csv").write_text("quantity,value\n1,2\n")
    assert "its first line must be case,quantity,time,value,unit" in run(tmp_path).stderr
    assert "no such folder or file" in run(tmp_path / "nowhere").stderr
    (tmp_path / "mine.csv").unlink()
    assert "holds no CSV file" in run(tmp_path).stderr


def test_the_template_asks_for_every_line_once_and_tells_where_it_is_empty(tmp_path):
    template = run("--template").stdout
    assert (FOLDER / "template.csv").read_text() == template
    (tmp_path / "mine.csv").write_text(template)
    done = run(tmp_path)
    assert done.returncode == 1
    assert done.stderr.count('is "", but must be a number') == sum(map(len, TABLES.values()))


def test_the_entries_that_are_there_are_read_without_fault_and_said_to_be_whose():
    about = json.loads((FOLDER / "entries" / "entries.json").read_text())
    paths = sorted((FOLDER / "entries").glob("*.csv"))
    assert paths and {path.stem for path in paths} == set(about)
    for path in paths:
        assert score.score(path, TABLES).faults == []


def test_this_project_names_every_line_of_the_benchmark_as_the_benchmark_does():
    for case, lines in own.LINES.items():
        asked = {(one.quantity, one.unit): one.time for one in TABLES[case]}
        assert {(line.quantity, line.unit) for line in lines} == set(asked)
        for line in lines:
            assert any(line.quantity == one.quantity and score._same(one.time, line.time) for one in TABLES[case])
    filled = {(name, time, unit) for name, unit, _, time, _ in own.FILLED}
    assert filled == {(one.quantity, one.time, one.unit) for one in TABLES[own.FILLING]}
    assert {*own.LINES, own.FILLING} == set(TABLES)


def test_an_entry_is_made_of_the_table_of_a_study(tmp_path):
    table = tmp_path / "study"
    table.mkdir()
    (table / "table.csv").write_text(
        "case,quantity,value,unit,reference,error,tolerance,holds,wall_s\n"
        "spin_down n=16,decay rate of the angular momentum R² / nu,15.5,1,15.42,0.005,0.05,true,3\n"
        'spin_down n=16,"computing time without compilation, all cores",2.5,s,,,,,3\n'
        "deposited_film-0.0001 R/dx=8,mean thickness of the film left behind / spacing,0.1,1,,,,,9\n"
        "deposited_film-0.001 R/dx=8,mean thickness of the film left behind / spacing,0.2,1,,,,,9\n")
    lines, missing = own.entry(own.read_study(table), tmp_path, {})
    assert lines == [("deposited_film", "thickness_Ca_0.0001", "", "62.5", "um"),
                     ("deposited_film", "thickness_Ca_0.001", "", "125", "um"),
                     ("deposited_film", "wall_time", "", "18", "s"), ("spin_down", "decay_rate", "", "1.55", "1/s"),
                     ("spin_down", "processor_time", "", "2.5", "s")]
    assert len(missing) == 8 and missing[0].startswith("sphere_at_rest is left out: no table has arc_18.2_deg")


def test_nothing_to_enter_is_told(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["", "--output", "mine.csv"])
    with pytest.raises(UserError, match="nothing to enter at draft"):
        own.main()


def test_what_is_published_at_a_level_is_entered(tmp_path):
    published = own.read_published(ROOT / "docs" / "results", "standard")
    lines, _ = own.filled(tmp_path, published)
    assert {line[1] for line in lines} >= {"fill", "covered_retina"}
    arc = own.LINES["sphere_at_rest"][0]
    assert own.value_of(arc, {}, published) == pytest.approx(184.0, abs=5.0)
