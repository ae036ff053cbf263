"""Oil at rest in the postures of a scene, and whether the simulation of a plan agrees with it."""
import base64
import dataclasses
import json

import numpy as np
import pytest
from conftest import ROOT

from pipeline import plan
from pipeline.base.errors import UserError
from pipeline.equilibrium.rest import Liquids
from pipeline.planning import confirm, sequence
from pipeline.planning.breaks import read_break
from pipeline.planning.search import Answer, Question
from pipeline.planning.settings import load_settings
from pipeline.scenes.folders import scene_path
from pipeline.scenes.load import load_scene
from pipeline.scenes.model import Eye
from pipeline.workflow.digest import stage_digest
from pipeline.workflow.notes import NOTES


@pytest.fixture
def folder(tmp_path):
    scenes = tmp_path / "scenes"
    scenes.mkdir()
    for name in ("resting_eye", "still_eye", "tamponade", "day_of_postures"):
        (scenes / f"{name}.yaml").write_text(scene_path(name, ROOT / "config" / "scenes").read_text())
    return scenes


def scene_file(folder, text, base="resting_eye"):
    path = folder / "scene.yaml"
    path.write_text(f"extends: {base}\n{text}")
    return path


DAY = """
breaks:
  - {name: above, hour: 12, latitude: 80 deg, width: 1}
  - {name: below, hour: 6, latitude: 80 deg, width: 1}
effects:
  gravity:
    second_means: 1 h
    turns:
      - {start: 1 h, to: prone, head_up: -45 deg, duration: 6 min}
      - {start: 2 h, to: upright, duration: 6 min}
output: {duration: 4 s, second_means: 1 h}
"""


@pytest.mark.thorough
def test_every_posture_that_is_held_has_a_shape(folder):
    found = sequence.sequence_of(scene_file(folder, DAY))
    assert [hold.words for hold in found.holds] == ["upright", "prone, head down 45 deg", "upright"]
    np.testing.assert_allclose([(hold.begin, hold.end) for hold in found.holds],
                               [(0.0, 3600.0), (3960.0, 7200.0), (7560.0, 14400.0)])
    upright, down, again = found.holds
    assert upright.bracket is again.bracket and found.liquids == Liquids(35.0, 0.04, pytest.approx(np.radians(18.2)))
    assert upright.margins["above"][0] > 0.0 > upright.margins["below"][0]
    assert down.margins["below"][0] > 0.0 > down.margins["above"][0]
    for hold in found.holds:
        for name, (margin, low, high) in hold.margins.items():
            assert low < margin < high and np.isnan(hold.pressures[name]) == (margin <= 0.0)
    assert found.covered("below") == (pytest.approx(3240.0 / 13680.0), pytest.approx(6840.0))
    assert found.covered("above")[1] == pytest.approx(3240.0)
    text = sequence.text_of(found)
    assert "Break above: covered 76 % of that time" in text and text.endswith("not for decisions on a patient.\n")


@pytest.mark.thorough
def test_what_a_break_may_be_is_told_once_and_without_signs(folder):
    found = sequence.sequence_of(scene_file(folder, DAY))

    def told(*margins):
        pressures = dict.fromkeys(("above", "below"), 4.0)
        holds = [dataclasses.replace(hold, margins=dict.fromkeys(hold.margins, margins), pressures=pressures)
                 for hold in found.holds]
        changed = dataclasses.replace(found, holds=holds)
        return sequence.rows(changed)[0][-1], sequence.sentences(changed)[2]

    cell, sentence = told(2e-3, 1e-3, 3e-3)
    assert cell == "covered: oil edge 2.0 mm beyond the break (1.0 to 3.0), 4 Pa"
    assert sentence == ("Break above: covered 100 % of that time, longest time not covered 0 s, whatever is uncertain.")
    cell, sentence = told(-0.3e-3, -2e-3, 0.5e-3)
    assert cell == "borderline: oil edge 0.3 mm short of the break (2.0 short to 0.5 beyond)"
    assert sentence == "Break above: covered 0 % of that time (0 to 100 %), longest time not covered 4 h (0 s to 4 h)."
    assert told(-1e-3, -2e-3, -0.5e-3)[0] == "not covered: oil edge 1.0 mm short of the break (2.0 to 0.5)"


@pytest.mark.thorough
def test_the_least_covered_macula_is_told_first_and_times_are_those_of_a_clock(folder):
    found = sequence.sequence_of(scene_file(folder, DAY.replace("prone, head_up: -45 deg", "supine, head_up: 30 deg")))
    macula = sequence.sentences(found)[1]
    least = min(hold.shares["macula"] for hold in found.holds)
    assert macula == f"Of the macula it touches {100 * least:.0f} % at least: supine, head up 30 deg, for 54 min."
    assert [row[:2] for row in sequence.rows(found)] == [("0:00", "1:00"), ("1:06", "2:00"), ("2:06", "4:00")]
    alone = dataclasses.replace(found, holds=found.holds[:1])
    assert sequence.sentences(alone)[1] == "It touches all of the macula throughout."


@pytest.mark.thorough
def test_times_bare_go_on_through_a_turn(folder):
    found = sequence.sequence_of(scene_file(folder, DAY.replace("prone, head_up: -45 deg", "supine, head_up: 60 deg")))
    assert found.covered("below") == (0.0, pytest.approx(14400.0))


@pytest.mark.parametrize(("text", "base", "sentence"), [
    ("title: none", "still_eye", "needs two liquids in the cavity, a tension and a contact angle"),
    ("initial: {fill: {silicone_oil_1000: 0.5 %, aqueous: 99.5 %}}", "resting_eye", "are known from 1 to 99.5 %"),
    ("effects: {interface_tension: {contact_angle: 60 deg}}", "resting_eye", "at rest are known from 5 to 45 deg"),
    ("eye: null\ncontainer: {size: [20 mm, 20 mm, 20 mm]}\ninitial: null\nblocks:\n"
     "  - {liquid: aqueous, lower: [0 mm, 0 mm, 0 mm], upper: [20 mm, 20 mm, 20 mm]}", "resting_eye",
     "is no scene of an eye, of which"),
])
def test_a_scene_without_a_shape_at_rest_is_refused(folder, text, base, sentence):
    with pytest.raises(UserError, match=sentence):
        sequence.sequence_of(scene_file(folder, text, base))


@pytest.mark.thorough
def test_the_stage_writes_a_page_with_a_map_of_every_posture(folder, tmp_path):
    plan.main(["--sequence", str(scene_file(folder, DAY)), "--output", str(tmp_path / "day.html")])
    text = (tmp_path / "day.html").read_text()
    assert text.count("data:image/webp") == 2 and "right eye, prone, head down 45 deg" in text
    assert "above: not covered" in text and "not the inverted view of indirect ophthalmoscopy" in text
    assert "not for decisions on a patient" in text
    with pytest.raises(UserError, match="no such file"):
        plan.main(["--sequence", str(folder / "nowhere.yaml")])


# Confirmation

@pytest.fixture
def asked(folder):
    """A question, its answer, the file of the confirming scene, and the folder of its run."""
    settings, materials = load_settings()
    question = Question(read_break("6h,60deg", "2h"), 0.5e-3, {"silicone_oil_1000": materials["silicone_oil_1000"]},
                        materials["aqueous"], ("upright",), settings.tension, settings.contact_angle, (), 0.95)
    answer = Answer(("silicone_oil_1000",), "upright", 0.93, None, None, {})
    path = folder / "my_plan.yaml"
    path.write_text(confirm.confirming_scene(question, answer, Eye(), "resting_eye"))
    run = folder.parent / "outputs" / "my_plan" / "draft"
    run.mkdir(parents=True)
    return question, answer, path, run


def simulated(path, run, margin, rate=0.0):
    scene = load_scene(path, "draft")
    (run / "scene.json").write_text(scene.to_json())
    (run / "metrics.json").write_text(json.dumps({"metrics": [], "breaks": [
        {"name": scene.breaks[0].name, "margin_at_end [mm]": margin, "uncertainty [mm]": 0.5}]}))
    times = np.linspace(0.0, 4.0, 41)
    parts = [f"retina_coverage_{part} [%]" for part in ("whole", "superior", "inferior")]
    lines = [",".join(["frame", "time [s]", *parts]),
             *(f"{frame},{time},60,90,{30 + rate * time}" for frame, time in enumerate(times))]
    (run / "metrics.csv").write_text("\n".join(lines) + "\n")


def test_before_the_simulation_its_command_is_told(asked):
    question, answer, path, run = asked
    first, second = confirm.confirmation(path, question, answer, run.parents[1])
    assert f"snakemake -j2 {run / 'metrics.html'}" in first and "the same command" in second
    patch = load_scene(path, "draft").patches(0.0113)["breaks"]["planned"]
    assert (patch.meridian, patch.latitude, patch.width, patch.height) == pytest.approx((180.0, 60.0, 60.0, 10.0))


@pytest.mark.parametrize(("margin", "covers", "words"), [
    (1.2, True, "(draft) agrees: at its end the oil reaches 1.2 ± 0.5 mm beyond the break; planned was that it reaches "
                "0.5 mm beyond"),
    (0.3, True, "cannot tell"),
    (-2.0, True, "does not agree: at its end the oil ends 2.0 ± 0.5 mm short of the far edge of the break"),
    (-2.0, False, "agrees"), (2.0, False, "does not agree")])
def test_after_the_simulation_it_is_told_whether_it_agrees(asked, margin, covers, words):
    question, answer, path, run = asked
    simulated(path, run, margin)
    answer = answer if covers else dataclasses.replace(answer, fill=0.99)
    (sentence,) = confirm.confirmation(path, question, answer, run.parents[1])
    assert words in sentence


def test_a_simulation_that_is_not_at_rest_is_named(asked):
    question, answer, path, run = asked
    simulated(path, run, 1.2, rate=-2.0)
    _, sentence = confirm.confirmation(path, question, answer, run.parents[1])
    assert sentence.startswith("It is not at rest: in the last 3 s the covered share of the retina (inferior) "
                               "changes by -2.00 ± 0.00 percentage points per second")


@pytest.mark.parametrize("name", ["silicone_oil_1000", "heavy_oil_densiron_68"])
def test_confirming_scenes_have_thin_liquids_with_the_densities_of_the_plan(asked, name):
    question, answer, path, _ = asked
    materials = load_settings()[1]
    question = dataclasses.replace(question, oils={name: materials[name]})
    path.write_text(confirm.confirming_scene(question, dataclasses.replace(answer, oils=(name,)), Eye(), "resting_eye"))
    found = {liquid.name: liquid for liquid in load_scene(path, "draft").liquids}
    assert found.keys() == {"aqueous", name}
    for liquid in found.values():
        assert liquid.density == materials[liquid.name].density and liquid.dynamic_viscosity <= 0.1
    assert max(found.values(), key=lambda liquid: liquid.dynamic_viscosity).name == name  # measures take it for the oil
    assert found[name].dynamic_viscosity > found["aqueous"].dynamic_viscosity


def test_the_simulation_of_another_plan_confirms_nothing(asked):
    question, answer, path, run = asked
    simulated(path, run, 1.0)
    path.write_text(confirm.confirming_scene(question, dataclasses.replace(answer, fill=0.9), Eye(), "resting_eye"))
    (sentence,) = confirm.confirmation(path, question, answer, run.parents[1])
    assert "is that of another plan, or of older code; run it again" in sentence
    simulated(path, run, 1.0)
    (run / "metrics.json").write_text("{}")
    with pytest.raises(UserError, match="results are damaged"):
        confirm.confirmation(path, question, answer, run.parents[1])


def test_a_simulation_that_was_begun_for_another_plan_and_stopped_confirms_nothing(asked, monkeypatch):
    """The scene in its folder is the new one from the start of the run on, while the numbers are still the old ones."""
    question, answer, path, run = asked
    monkeypatch.chdir(run.parents[2])
    outputs = run.parents[1].relative_to(run.parents[2])

    def noted(scene):
        """What Snakemake notes of the metrics of a scene."""
        note = NOTES / base64.urlsafe_b64encode(bytes(outputs / "my_plan/draft/metrics.csv")).decode()
        note.parent.mkdir(parents=True, exist_ok=True)
        note.write_text(json.dumps({"rule": "metrics", "shellcmd": "python -m pipeline.metrics", "params": [
            f"'{stage_digest('metrics', scene)}'"]}))

    for posture in ("upright", "prone"):
        answer = dataclasses.replace(answer, posture=posture)
        path.write_text(confirm.confirming_scene(question, answer, Eye(), "resting_eye"))
        simulated(path, run, 1.2)
        if posture == "prone":
            (sentence,) = confirm.confirmation(path, question, answer, outputs)
            assert "is that of another plan, or of older code; run it again" in sentence
        noted(load_scene(path, "draft"))
        (sentence,) = confirm.confirmation(path, question, answer, outputs)
        assert "(draft) agrees" in sentence
