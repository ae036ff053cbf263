"""What accuracy costs: the Pareto front of known points, changes in words, and the files of the study."""
import csv
import dataclasses
import math

import numpy as np
import pytest
from conftest import ROOT

from pipeline.base.errors import UserError
from pipeline.studies.model import COMPUTING_TIME, WALL_TIME, Curve, Outcome, Row
from pipeline.studies.plan import load_study
from sim.settings import Liquid, Numerics, Settings
from sim.time_step import known_limits
from studies.validation.hydrostatics import Parameters
from studies.validation.kit.tank import Stopwatch, changed
from studies.validation.tradeoff_page import (
    Point,
    base_points,
    change_of,
    in_short,
    levels_of,
    on_front,
    order_of,
    orders_of,
    points_of,
    unasked,
    write_tradeoff,
)


@pytest.fixture
def study(monkeypatch):
    monkeypatch.chdir(ROOT)
    return load_study("accuracy", "draft")


def invented(case) -> Outcome:
    """Runs whose error falls with the square of the spacing and whose time grows with its cube."""
    outcome, headline = Outcome(case=case.name), case.family.headline.quantity
    for n in case.parameters.resolutions:
        at, exact = {"at": f"n={n}"}, 2.0
        outcome.rows += [Row(headline, exact * (1.0 + n**-2.0), "Pa", reference=exact, error=n**-2.0, relative=True,
                             **at),
                         Row("particles", float(n * n), **at), Row(WALL_TIME, 1e-3 * n**3, "s", **at),
                         Row(COMPUTING_TIME, 2e-3 * n**3, "s", **at)]
        time = np.linspace(0.0, 1.0, 11)
        outcome.curves.append(Curve("eye_rest_height", f"n={n}", time, time * (1.0 + n**-2.0), "line"))
    return outcome


def test_front_has_the_points_that_none_betters():
    times, errors = [1, 2, 3, 3, 4, 5], [9, 5, 6, 5, 2, math.nan]
    assert on_front(times, errors) == [True, True, False, False, True, False]
    assert on_front([1, 1], [1, 1]) == [True, True]  # equal ones do not better each other


def test_changes_are_told_in_words(study):
    cases = [case for case in study.cases.values() if case.family.name == "hydrostatics"]
    changes = [change_of(case, cases[0]) for case in cases]
    assert changes[0] == "particle spacing"
    assert {"tolerances x 0.1", "time step x 0.5", "dfsph", "h/dx 3", "f32"} <= set(changes)
    assert len(set(changes)) == len(changes) - 2 and changes[:3] == 3 * ["particle spacing"]  # three starts


def test_every_change_has_a_base_of_its_resolution(study):
    for name in study.family_names():
        base, *changes = [case for case in study.cases.values() if case.family.name == name]
        for case in changes:
            assert set(case.parameters.resolutions) <= set(base.parameters.resolutions), case.name
        starts = [getattr(case.parameters, "seed", 0) for case in (base, *changes)
                  if change_of(case, base) != "particle spacing" or case is base]
        assert set(starts) == {0}  # a change is held against the first start of the base


def test_order_front_and_levels_of_known_runs(study):
    cases = [case for case in study.cases.values() if case.family.name == "hydrostatics"]
    points = points_of(cases, [invented(case) for case in cases])
    assert order_of(points) == pytest.approx(2.0)
    assert all(point.unit == "1" for point in points)  # the error is relative, the quantity is in Pa
    found = levels_of(points, 1.0, {"draft": 0.001, "fine": 0.0001})
    assert found["draft"] == pytest.approx((22.0, 2e-3 * 22**3, 22**-2.0))
    assert found["fine"][2] == pytest.approx(220**-2.0) and math.isnan(found["fine"][1])  # beyond what was run


@pytest.mark.thorough
def test_study_writes_its_figures_tables_and_remarks(study, tmp_path):
    found = write_tradeoff(study, [invented(case) for case in study.cases.values()], tmp_path)
    assert sorted(path.stem for path in tmp_path.glob("*.png")) == sorted(study.pictures())
    assert sorted(path.stem for path in tmp_path.glob("*.csv")) == sorted(study.tables())
    with (tmp_path / "orders.csv").open(newline="") as file:
        orders = list(csv.DictReader(file))
    assert {row["case"] for row in orders} == set(study.family_names())
    assert all(float(row["order"]) == pytest.approx(2.0, abs=0.01) for row in orders)
    # The run that others are compared with has an error of its own, which is counted.
    for row in orders:
        assert float(row["error"]) == pytest.approx(float(row["resolution"]) ** -2.0, rel=0.02), row
        assert row["starts"] == ("1" if row["case"] == "eye_rest" else "3")
    assert all("error to expect: " in outcome.remarks[0] and "order" in outcome.remarks[1] for outcome in found)
    hydrostatics = next(outcome for outcome in found if outcome.case.startswith("hydrostatics"))
    assert "0.21 % at draft (0.21 to 0.21 from 3 starts, at 22 spacings)" in hydrostatics.remarks[0]
    expected = {row.quantity: row.value for row in hydrostatics.rows}
    assert expected["mean error at standard"] == pytest.approx(55**-2.0)


def test_several_starts_are_one_point_with_its_bar_and_changes_are_held_against_the_first(study):
    cases = [case for case in study.cases.values() if case.family.name == "hydrostatics"]
    factors = iter((1.0, 2.0, 6.0))
    outcomes = []
    for case in cases:
        outcome = invented(case)
        if change_of(case, cases[0]) == "particle spacing":
            factor = next(factors)
            outcome.rows = [dataclasses.replace(row, value=2.0 + factor * row.error, error=factor * row.error)
                            if row.error else row for row in outcome.rows]
        outcomes.append(outcome)
    points = points_of(cases, outcomes)
    assert len({(point.change, point.resolution) for point in points}) == len(points)
    point = next(one for one in points if (one.change, one.resolution) == ("particle spacing", 22))
    assert (point.error, point.least, point.most) == pytest.approx((3.0 / 22**2, 1.0 / 22**2, 6.0 / 22**2))
    assert point.starts == 3 and order_of(points) == pytest.approx(2.0)
    said = {row.quantity: row.value for row in in_short(cases[0].family, points).rows
            if row.quantity.endswith(": error over that of the base")}
    assert said and all(value == pytest.approx(1.0) for value in said.values())  # the changes start as the first did


def test_differences_from_the_finest_run_are_no_errors_without_a_law(study):
    base = next(case for case in study.cases.values() if case.family.name == "eye_rest")
    outcome = invented(base)
    outcome.curves = [dataclasses.replace(curve, y=curve.x * factor) for curve, factor in zip(
        outcome.curves, (1.5, 1.1, 1.3, 1.2, 1.0), strict=True)]
    points = points_of([base], [outcome])
    assert len(base_points(points)) == 4 and orders_of(base.family, points) == []
    told = [row.value for row in in_short(base.family, points).rows if row.quantity == base.family.headline.quantity]
    assert told == pytest.approx([0.5, 0.1, 0.3, 0.2])  # of 14 to 30 spacings from the run with 40


def test_runs_that_do_not_converge_yet_have_no_order():
    """Differences from the finest run that fall faster than those of any law with a positive order."""
    runs = zip((11, 14, 18, 22), (0.53, 0.37, 0.15, math.nan), strict=True)
    points = [Point("particle spacing", n, n**3.0, error, "1", 1.0, 1.0) for n, error in runs]
    assert math.isnan(order_of(points))


@pytest.mark.thorough
def test_error_to_expect_is_the_measured_one_and_its_order_no_more_than_the_last_refinement_gave(study, tmp_path):
    outcomes = []
    for case in study.cases.values():
        outcome = invented(case)
        errors = iter((0.4, 0.011, 0.01))  # at 5, 10 and 14 spacings
        if case.family.name == "laplace" and len(case.parameters.resolutions) == 3:
            headline = case.family.headline.quantity
            outcome.rows = [dataclasses.replace(row, error=next(errors)) if row.quantity == headline else row
                            for row in outcome.rows]
        outcomes.append(outcome)
    write_tradeoff(study, outcomes, tmp_path)
    with (tmp_path / "orders.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["case"] == "laplace"]
    assert [float(row["error"]) for row in rows] == pytest.approx([0.4, 0.011, 0.01])
    assert all(float(row["order"]) == pytest.approx(math.log(1.1) / math.log(14 / 10)) for row in rows)


def test_failed_run_has_no_error_and_is_not_on_the_front(study):
    cases = [case for case in study.cases.values() if case.family.name == "hydrostatics"]
    outcomes = [invented(case) for case in cases]
    for k in (1, 3):  # the second start, and a change
        outcomes[k].rows = [dataclasses.replace(row, error=math.nan) if row.error else row for row in outcomes[k].rows]
    points = [one for one in points_of(cases, outcomes) if one.change in ("tolerances x 0.1", "particle spacing")]
    assert len(points) == 5 and all(math.isnan(point.error) and not point.front for point in points)


def test_inexact_runs_break_no_promise_but_failed_ones_do():
    rows = [Row("pressure jump", 1.0, error=0.5, tolerance=0.1), Row("time reached", 1.0, error=0.5, tolerance=0.0)]
    assert [row.holds for row in unasked(Outcome(rows)).rows] == [None, False]


# What the study changes

def test_factors_change_tolerances_and_time_step_and_nothing_else():
    settings = Settings(2, (Liquid("a", 1000.0, 1.0),), Numerics(particle_spacing=1e-3, maximum_time_step=1e-2), ())
    assert changed(Parameters(), settings) == settings
    tight = changed(Parameters(tolerance_factor=0.1), settings).numerics
    assert tight == dataclasses.replace(settings.numerics, pressure_tolerance=1e-5, viscosity_tolerance=1e-5)
    half = changed(Parameters(time_step_factor=0.5), settings)
    assert half.numerics.maximum_time_step == 0.5 * min(known_limits(settings).values())
    waves = dataclasses.replace(settings, numerics=dataclasses.replace(settings.numerics, scheme="wcsph"))
    assert changed(Parameters(scheme="wcsph", time_step_factor=0.5), waves).scheme.acoustic_courant_number == 0.15


def test_stopwatch_leaves_compilation_and_what_is_done_between_steps_out(monkeypatch):
    clock = [0.0]
    monkeypatch.setattr("studies.validation.kit.tank.time.perf_counter", lambda: clock[0])
    monkeypatch.setattr("studies.validation.kit.tank.time.process_time", lambda: 2.0 * clock[0])

    def steps():
        for k in range(10):
            clock[0] += 5.0 if k < 3 else 0.5
            yield k
    watch = Stopwatch()
    for _ in watch.timed(steps()):
        clock[0] += 100.0
    assert watch.seconds() == pytest.approx((5.0, 10.0))


def test_unknown_kind_of_report_is_refused(project, monkeypatch):
    monkeypatch.chdir(project.folder)
    path = project.folder / "config" / "studies" / "small.yaml"
    path.write_text("title: Small\nreport: colorful\ncases: {diffusion: {resolutions: [8]}}\n")
    with pytest.raises(UserError, match=r'report is "colorful", but must be one of curves, .*, tradeoff'):
        load_study("small", "draft")
