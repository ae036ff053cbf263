"""The study of filling and removal: the flow through a cannula, what is left, and the page that a surgeon reads."""
import math

import numpy as np
import pytest
from conftest import ROOT

from pipeline.base.errors import UserError
from pipeline.scenes.load import load_scene
from pipeline.studies.model import Outcome
from pipeline.studies.plan import load_study
from pipeline.studies.report import write_study
from studies.questions.exchanged_oil import cannula_flow, exchanged_oil
from studies.questions.exchanged_oil._words import EXCHANGE_COURSES, EXCHANGES, LARGEST, LEFT, LOST_AT, PIECES


@pytest.fixture
def study(monkeypatch):
    monkeypatch.chdir(ROOT)
    return load_study("injection_study")


def test_flow_is_that_of_a_long_tube_and_of_an_orifice():
    """Hagen and Poiseuille far from the ends, Sampson's orifice without a length."""
    long = cannula_flow.flow(1e4, 1.0, 1e-4, 1.0)
    assert long == pytest.approx(math.pi * 1e-4**4 * 1e4 / (8.0 * 1.0 * 1.0), rel=2e-4)
    assert cannula_flow.flow(1e4, 1.0, 1e-4, 0.0) == pytest.approx(1e4 * 1e-4**3 / 3.0)


def test_times_are_in_proportion_to_viscosity_and_published_ones_are_within_their_spread(study):
    outcomes = {name: case.family.run(case.parameters) for name, case in study.cases.items()
                if name.startswith("cannula_flow")}
    rows = {(name, row.at, row.quantity): row for name, outcome in outcomes.items() for row in outcome.rows}
    passive = {oil: rows["cannula_flow-passive_removal_23_gauge", oil, "time"].value for oil in (
        "silicone_oil_1000", "silicone_oil_5000")}
    assert passive["silicone_oil_5000"] == pytest.approx(5.0 * passive["silicone_oil_1000"])
    published = [row for (*_, quantity), row in rows.items() if quantity == "time of the oil of the publication"]
    assert len(published) == 2 and all(row.holds for row in published)
    assert all(row.value < 0.5 for (*_, quantity), row in rows.items() if quantity.startswith("Reynolds"))


def test_pieces_are_told_apart_by_their_distance():
    position = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [5, 0, 0]])
    assert exchanged_oil.pieces_of(position, np.array([1.0, 1.0, 1.0, 0.5]), 1.5).tolist() == [3.0, 0.5]
    assert not len(exchanged_oil.pieces_of(position[:0], np.zeros(0), 1.5))  # all was drained


def test_removal_drains_the_oil_and_filling_the_aqueous(study):
    for name, drained in (("exchanged_oil-removal-heavy_oil_densiron_68-2e-06", "heavy_oil_densiron_68"),
                          ("exchanged_oil-filling-silicone_oil_1000-2e-06", "aqueous")):
        case = study.case(name)
        scene = load_scene(ROOT / "config" / "scenes" / f"{case.family.solves(case.parameters)}.yaml", "draft")
        injection = exchanged_oil.changed(case.parameters, scene).effects["injection"]
        assert injection.drained_liquid == drained and injection.drain == case.parameters.tip


def test_a_pressure_without_sense_is_refused_with_what_is_allowed(study, tmp_path):
    (tmp_path / "one.yaml").write_text("cases: {cannula_flow: {name: x, direction: out, inner_diameter: 0.65 mm, "
                                       "length: 4 mm, pressure: -40 mmHg}}")
    with pytest.raises(UserError, match=r"cases\.cannula_flow\.pressure is .* but must be above 0"):
        load_study("one", folder=tmp_path)


@pytest.mark.thorough
def test_the_page_tells_times_and_what_stays_behind(study, tmp_path):
    outcomes = [case.family.run(case.parameters) for name, case in study.cases.items()
                if name.startswith("cannula_flow")]
    for flow, left, lost in (("2", "4.6", "1.9"), ("1", "3.4", "")):
        heads = ["removal", "in_front", flow]
        numbers = ((LEFT, left, "%"), (PIECES, "2", ""), (LARGEST, "3.1", "%"), (LOST_AT, lost, "s"))
        outcomes.append(Outcome(tables={
            "exchanges": [list(EXCHANGES), *([*heads, f"0.0{flow}", "1", *one] for one in numbers)],
            "courses": [list(EXCHANGE_COURSES), [*heads, "0.1", "83", "0.5"], [*heads, "4", left, "2.5"]]}))
    write_study(study, outcomes, tmp_path)
    text = (tmp_path / "table.html").read_text(encoding="utf-8")
    assert "illustration of physics, not for decisions on a patient" in text
    assert "leaves oil behind: less than 3.4 % (4.6 % with twice the flow) of the cavity" in text
    assert "Surgeons took 2.0 to 2.4 times as long as is computed" in text
    assert "2.58 ± 2.24 min" in text and "&lt; 3.4" in text
    for name in study.pictures():
        assert (tmp_path / f"{name}.png").stat().st_size > 1000
    assert all((tmp_path / f"{name}.csv").is_file() for name in study.tables())
