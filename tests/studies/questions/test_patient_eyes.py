"""The study of eyes: one case of it, its page, the judge's formula, and what the simulations beside it change."""
import dataclasses
import sys

import numpy as np
import pytest
from conftest import ROOT

from pipeline.scenes.model import Buckle, Eye
from pipeline.studies.model import Outcome
from pipeline.studies.plan import load_study
from pipeline.studies.report import write_study
from studies.questions.kit.words import PARTS
from studies.questions.patient_eyes import patient_eye
from studies.questions.patient_eyes.patient_eyes_page import Eyes, write_page
from studies.validation import rest_by_simulation

sys.path.insert(0, str(ROOT / "tests" / "judges"))
import surface_evolver


@pytest.fixture(scope="module")
def study():
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        return load_study("eye_study")


@pytest.fixture(scope="module")
def outcomes(study) -> list[Outcome]:
    """Reduced cases: one fill and posture, one other contact angle."""
    found = []
    for name in ("length_24", "buckle"):
        case = study.case(f"patient_eye-{name}")
        found.append(patient_eye.run(dataclasses.replace(case.parameters, fills=(0.85,), postures=("upright",),
                                                         other_angles=(25.0,))))
        found[-1].case = case.name
    return found


@pytest.mark.thorough
def test_ranges_hold_the_values_and_quadrants_make_up_halves(outcomes):
    eyes = Eyes.of(outcomes)
    for key, share in eyes.found.items():
        assert 0.0 <= share.low <= share.value <= share.high <= 100.0, key
    for name in eyes.groups:
        assert {part for eye, _, _, part in eyes.found if eye == name} >= set(PARTS)
        sides = [eyes.at(name, "upright", f"inferior_{side}").value for side in ("temporal", "nasal")]
        assert np.mean(sides) == pytest.approx(eyes.at(name, "upright", "inferior").value, abs=0.3)


@pytest.mark.thorough
def test_the_average_eye_is_that_of_the_study_of_fills(outcomes):
    """The retina and its lower half at 85 %, upright, by an independent minimizer: 67.5 and 36.0 %."""
    eyes = Eyes.of(outcomes)
    assert eyes.at("24 mm", "upright", "retina").value == pytest.approx(67.5, abs=1.0)
    assert eyes.at("24 mm", "upright", "inferior").value == pytest.approx(36.0, abs=1.0)
    assert eyes.volumes["24 mm"].value == pytest.approx(eyes.volumes["24 mm"].reference, rel=0.01)
    assert eyes.volumes["24 mm, buckle of 3 mm, at 4 to 8 h"].value < 4.9


@pytest.mark.thorough
def test_the_page_says_what_was_assumed_and_what_was_not_validated(study, outcomes, tmp_path):
    text = "".join(write_page(study.description, outcomes, tmp_path))
    for words in ("not for decisions on a patient", "85 % of the cavity is oil",
                  "144 eyes, de Santana et al.", "Not validated:", "against patients", "(ST, SN, IT, IN)"):
        assert words in text
    assert (tmp_path / "shares.csv").read_text().startswith("eye,posture,fill [%],part")
    assert (tmp_path / "eye_maps.png").stat().st_size > 10_000


@pytest.mark.thorough
def test_a_study_writes_no_pictures_but_its_own(study, outcomes, tmp_path):
    cases = {one.case: study.case(one.case) for one in outcomes}
    write_study(dataclasses.replace(study, cases=cases), outcomes, tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"table.csv", "table.html", "eye_maps.png", "shares.csv"}


@pytest.mark.thorough
def test_every_eye_of_the_study_can_be_filled(study):
    """A band, a staphyloma, an open chamber and a mesh are seen whole from one point; 642 directions are enough."""
    from pipeline.equilibrium.star_cavity import COARSE, cavity_of

    volumes = {name: cavity_of(case.parameters.eye if case.parameters.eye.path is None else dataclasses.replace(
        case.parameters.eye, path=str(ROOT / case.parameters.eye.path)), COARSE).volume
        for name, case in study.cases.items()}
    assert volumes["patient_eye-band"] < volumes["patient_eye-length_24"] < volumes["patient_eye-chamber"]
    assert 3e-6 < volumes["patient_eye-mean_head"] < 3.6e-6


def test_simulations_have_the_liquids_of_the_shape_and_thin_them():
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        study = load_study("rest_by_simulation")
        case = study.case("rest_by_simulation-staphyloma_band-0.85-upright-level-1")
        scene = rest_by_simulation.changed(case.parameters, case.solved()[0])
    oil, gas = ([one.parameters for one in study.cases.values() if one.parameters.scene == name]
                for name in rest_by_simulation.SCENES)
    assert len(oil) == 30 and len({one.eye for one in oil}) == 4 and Eye() not in {one.eye for one in oil}
    assert len(gas) == 8
    assert scene.eye.staphyloma is not None and scene.eye.buckle == Buckle(0.002)
    assert [liquid.density for liquid in scene.liquids] == [liquid.density for liquid in case.solved()[0].liquids]
    assert {liquid.dynamic_viscosity for liquid in scene.liquids} == {0.1}


@pytest.mark.parametrize("name", surface_evolver.CASES)
def test_the_judge_has_the_wall_of_the_eye(name):
    """The formula that Surface Evolver gets is the level of the cavity, at points around the wall."""
    case = surface_evolver.CASES[name]
    turn = surface_evolver.turned(case.down)
    assert np.linalg.det(turn) == pytest.approx(1.0) and turn @ case.down == pytest.approx([0.0, 0.0, -1.0])
    points = np.random.default_rng(1).uniform(-12e-3, 12e-3, (200, 3))
    x, y, z = 1e3 * turn @ points.T
    words = surface_evolver.formula(case, turn).replace("^", "**")
    value = eval(words, {"sqrt": np.sqrt, "abs": np.abs, "maximum": np.maximum, "x": x, "y": y, "z": z})
    assert value == pytest.approx(1e3 * case.level(points), abs=1e-5)


@pytest.mark.thorough
def test_the_judge_starts_level_with_the_volume_asked_for():
    case = surface_evolver.CASES["eye_upright"]
    points, faces, on_wall, wall_faces, volume = surface_evolver.level_start(case)
    corners = points[faces]
    held = (corners[:, 0] * np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0
    assert held == pytest.approx(volume, rel=1e-6) and volume == pytest.approx(0.85 * 5.054e-6, rel=2e-3)
    assert np.ptp(points[~on_wall, 1]) < 1e-9 and wall_faces.sum() > 300


def test_the_judge_says_why_it_does_not_judge(monkeypatch, capsys):
    monkeypatch.setattr(surface_evolver.shutil, "which", lambda program: None)
    monkeypatch.setattr(sys, "argv", ["surface_evolver.py"])
    surface_evolver.main()
    assert "not judged: there is no program evolver" in capsys.readouterr().out
