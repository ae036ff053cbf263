"""The shape of least energy beside the numbers of a run: of which scenes it is told, and what it says."""
import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import ROOT

from pipeline.base.errors import UserError
from pipeline.measures.least_energy import has_least_energy, least_energy_of, read_least_energy
from pipeline.measures.metric import write_meanings
from pipeline.scenes.folders import scene_path
from pipeline.scenes.load import load_scene

CAVITY = 5.054e-6  # m3


def loaded(name):
    return load_scene(scene_path(name, ROOT / "config" / "scenes"), "draft")


def test_it_is_told_of_eyes_with_aqueous_and_one_oil_or_gas():
    told = {name: has_least_energy(loaded(name)) for name in (
        "tamponade", "gas_eye", "oil_removal", "emulsification", "coupling_2d", "saccades")}
    assert told == {"tamponade": True, "gas_eye": True, "oil_removal": True, "emulsification": False,
                    "coupling_2d": False, "saccades": True}


def frame(fill):
    """What is read of a frame."""
    return SimpleNamespace(fill=np.array([1.0 - fill, fill]) * CAVITY, gravity=np.array([0.0, -9.81, 0.0]))


@pytest.mark.thorough
def test_fill_and_posture_at_the_end_count(tmp_path):
    scene = loaded("tamponade")
    found, unknown = least_energy_of(scene, frame(0.85), CAVITY)
    assert not unknown and found.posture == "upright" and found.fill == pytest.approx(0.85)
    assert found.shares["whole"] == pytest.approx(67.5, abs=0.7)  # docs/results/eye.md
    assert found.shares["inferior"] == pytest.approx(36.0, abs=1.0) and found.shares["macula"] == 100.0
    assert "at rest, upright, this fill of 85.0 % touches 67.7 % (whole)" in found.sentence()
    write_meanings(tmp_path / "metrics.json", [], at_rest=dataclasses.asdict(found))
    assert read_least_energy(tmp_path / "metrics.json") == found


def test_where_it_is_not_known_a_sentence_says_so(tmp_path):
    assert least_energy_of(loaded("tamponade"), frame(0.0), CAVITY) == (
        None, "no shape at rest is looked for at a fill of 0.0 %")
    assert least_energy_of(loaded("emulsification"), frame(0.85), CAVITY) == (None, "")
    (tmp_path / "metrics.json").write_text("[")
    with pytest.raises(UserError, match="run the metrics stage again"):
        read_least_energy(tmp_path / "metrics.json")
