"""The study of fills: what oil and gas at rest touch, and the page that a surgeon reads."""
import csv
import dataclasses
import re

import numpy as np
import pytest
from conftest import ROOT
from PIL import Image

from pipeline.equilibrium.least import Resting
from pipeline.equilibrium.rest import Liquids
from pipeline.pictures.paint import OF_OIL
from pipeline.scenes.materials import load_materials
from pipeline.scenes.model import Eye
from pipeline.studies.model import Outcome
from pipeline.studies.plan import load_study
from pipeline.studies.report import write_study
from studies.questions.filled_eye import filled_eye
from studies.questions.filled_eye._words import SPHERE
from studies.questions.filled_eye.filled_eye_page import Shares
from studies.questions.kit import eye_pictures
from studies.questions.kit.fills_at_rest import MAP_SIZE, Course, course_of, fundus_maps
from studies.questions.kit.words import PARTS

FILLS = (0.7, 0.8, 0.9)


@pytest.fixture(scope="module")
def study():
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        return load_study("fill_study")


@pytest.fixture(scope="module")
def outcomes(study) -> dict[str, Outcome]:
    """Reduced cases: one other contact angle, a few fills, the patient upright."""
    found = {}
    for name in ("light_oil", "gas"):
        case = study.case(f"filled_eye-{name}-0.024")
        found[name] = case.family.run(dataclasses.replace(
            case.parameters, fills=FILLS, postures=("upright",), other_angles=case.parameters.other_angles[:1]))
        found[name].case = case.name
    return found


@pytest.fixture(scope="module")
def shares(outcomes) -> Shares:
    return Shares.of([line for outcome in outcomes.values() for line in outcome.tables["shares"][1:]])


@pytest.mark.thorough
def test_gas_touches_more_than_oil_and_a_larger_fill_more_than_a_smaller_one(shares):
    for part in ("retina", "inferior", "superior", "before_equator"):
        oil, gas = ([shares.at(name, "upright", fill, part).value for fill in shares.fills]
                    for name in ("light_oil", "gas"))
        assert (np.diff(oil) > 0.0).all() and (np.diff(gas) >= 0.0).all(), part
    for fill in (70.0, 80.0):
        assert shares.at("gas", "upright", fill, "retina").low > shares.at("light_oil", "upright", fill, "retina").value


@pytest.mark.thorough
def test_ranges_hold_the_values_and_quadrants_make_up_halves(shares):
    for key, share in shares.found.items():
        assert 0.0 <= share.low <= share.value <= share.high <= 100.0, key
    for name in shares.tamponades:
        for half in ("superior", "inferior"):
            sides = [shares.at(name, "upright", 80.0, f"{half}_{side}").value for side in ("temporal", "nasal")]
            assert np.mean(sides) == pytest.approx(shares.at(name, "upright", 80.0, half).value, abs=0.3)
            assert sides[0] == pytest.approx(sides[1], abs=1.5)  # the eye is its own mirror image


@pytest.mark.thorough
def test_gas_in_a_sphere_is_that_of_young_and_laplace(outcomes, shares):
    """Arc and wall of a gas with a Bond number of 16 in 11 mm, from a table that was computed apart from this code."""
    rows = {(row.at, row.quantity): row for row in outcomes["gas"].rows}
    for fill, arc, wall in ((80, 219.0, 67.0), (90, 248.0, 78.0)):
        at = f"sphere, fill {fill} %"
        assert rows[at, "arc of contact"].reference == pytest.approx(arc, abs=0.6)
        assert rows[at, "covered wall"].reference == pytest.approx(wall, abs=0.6)
    assert all(row.holds is not False for outcome in outcomes.values() for row in outcome.rows)
    assert shares.at("light_oil", SPHERE, 80.0, "retina").value == pytest.approx(51.6, abs=0.6)


def test_postures_turn_gravity(study):
    assert filled_eye.down_of("head_up_45") == pytest.approx([0.0, -np.sqrt(0.5), -np.sqrt(0.5)])
    assert set(filled_eye.POSTURES) == set(study.case("filled_eye-gas-0.024").parameters.postures)


def test_densities_are_those_of_the_liquids(study):
    materials = load_materials(ROOT / "config" / "materials.yaml")
    for case in study.cases.values():
        liquid = {"light_oil": "silicone_oil_1000", "heavy_oil": "heavy_oil_densiron_68"}.get(case.parameters.tamponade)
        if liquid is not None:
            assert case.parameters.density == pytest.approx(materials[liquid].density)
        assert case.parameters.aqueous_density == pytest.approx(materials["aqueous"].density)


@pytest.mark.thorough
def test_the_page_is_written_with_its_table_and_pictures(study, outcomes, tmp_path):
    case = study.case("filled_eye-light_oil-0.024")
    drawn = case.family.run(dataclasses.replace(case.parameters, fills=(0.85,), postures=("left_side",),
                                                other_angles=()))
    folders = []
    for name, outcome in outcomes.items():
        outcome.pictures |= drawn.pictures
        folders.append(tmp_path / name)
        folders[-1].mkdir()
        outcome.write(folders[-1])
    write_study(study, [Outcome.read(folder) for folder in folders], tmp_path)
    text = (tmp_path / "table.html").read_text(encoding="utf-8")
    assert "illustration of physics, not for decisions on a patient" in text
    answers, _, rest = text.partition("<figure>")
    assert re.search(r"<li>Light oil, patient upright: \d+ \([^)]*\) % of the retina", answers)
    assert "<li>Gas, patient upright" in answers
    assert "<table" not in re.sub(r"<details.*?</details>", "", rest, flags=re.DOTALL), "a table is not folded"
    assert 'href="../../../../docs/methods/equilibrium.md"' in text and "&lt;" not in text
    for picture in study.pictures():
        assert (tmp_path / f"{picture}.png").stat().st_size > 1000
    with (tmp_path / "shares.csv").open(encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    assert {line["part"] for line in lines} >= set(PARTS)
    assert len({(line["tamponade"], line["posture"], line["fill [%]"], line["part"]) for line in lines}) == len(lines)


@pytest.mark.thorough
def test_gas_in_front_of_the_viewpoint_is_seen_from_another_one():
    gas = Liquids(1003.8, 0.072, np.radians(38.8))
    course = course_of(Resting.of(Eye()), gas, filled_eye.down_of("supine"), (0.5,))
    assert course.best(0).cavity.whole is not None
    found = dict(zip(PARTS, course.least[0], strict=True))
    assert found["macula"] == 0.0 and found["superior"] == pytest.approx(found["inferior"], abs=0.02)


def test_maps_have_a_legend_below_and_tell_nasal_from_temporal(monkeypatch):
    written = []
    monkeypatch.setattr(eye_pictures, "write",
                        lambda pen, place, text, *_, **__: written.append((text, place)) or 100.0)
    one = Image.new("RGB", (168, 168), "white")
    picture = eye_pictures.fundus_picture([[one] * 4] * 2, ["upright", "prone"], [0.6, 0.7, 0.8, 0.9], "light oil")
    places = dict(written)
    assert places["T"][0] < places["N"][0] and places["T"][1] < eye_pictures.MAPS_HEAD + 168
    assert "touched by light oil" in places and places["touched by light oil"][1] > picture.height - 66
    assert {tuple(OF_OIL.covered), tuple(OF_OIL.bare)} <= {color for _, color in picture.getcolors(1 << 20)}


def test_a_fill_without_a_shape_has_no_map():
    unknown = np.full((1, len(PARTS)), np.nan)
    drawn, = fundus_maps(Resting.of(Eye()), [Course([[]], unknown, unknown, unknown)], [0])
    assert drawn.getcolors() == [(MAP_SIZE**2, (255, 255, 255))]


@pytest.mark.thorough
def test_the_shape_of_least_energy_counts_and_the_range_holds_the_others():
    """Half of the eye, supine: oil that hangs on the lens alone has 2 % more energy than oil that leans on the wall."""
    oil = Liquids(35.0, 0.04, np.radians(18.2))
    course = course_of(Resting.of(Eye()), oil, filled_eye.down_of("supine"), (0.5,))
    retina = list(PARTS).index("retina")
    assert course.least[0, retina] > 0.15 and course.low[0, retina] < 0.01
    assert course.high[0, retina] >= course.least[0, retina]
