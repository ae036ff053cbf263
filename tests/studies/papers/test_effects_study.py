"""The study that switches the effects of the eye off in turn: its scenes, and how two scenes are compared."""
import dataclasses

import numpy as np
import pytest
from conftest import ROOT
from helpers.synthetic_frames import RADIUS, SPACING, ball, frame_of, lattice, oil_fraction

from pipeline.scenes.load import load_scene
from pipeline.studies.plan import load_study
from studies.papers.effects_off import OFF, Result, compared, elsewhere, judgment

OIL = 1


@pytest.fixture
def parameters(monkeypatch):
    monkeypatch.chdir(ROOT)
    return load_study("effects_study").cases["effects_off"].parameters


def test_every_effect_is_off_in_one_scene_that_differs_in_nothing_else(parameters):
    """The emulsion goes on from the tamponade, where the effects that do not mix were off already."""
    missing = {}
    for name in parameters.off:
        base, effect = name.split(OFF)
        whole, off = (load_scene(ROOT / "config" / "scenes" / f"{one}.yaml", "draft") for one in (base, name))
        assert off.effects == {key: value for key, value in whole.effects.items() if key != effect}
        words = {"name": base, "title": whole.title, "description": whole.description}
        assert dataclasses.replace(off, **words, effects=whole.effects) == whole
        missing.setdefault(base, set()).add(effect)
    tamponade, emulsion = (set(load_scene(ROOT / "config" / "scenes" / f"{one}.yaml", "draft").effects)
                           for one in parameters.scenes)
    assert missing == {"effects_eye": tamponade, "effects_emulsion": emulsion - tamponade}


def test_oil_elsewhere_is_the_volume_between_two_levels():
    """Levels two spacings apart in a ball: the layer between them is 2 pi (R^2 h - h^3/3) of the oil."""
    first, second = (lattice(seed=seed) for seed in (1, 2))
    low, high = -SPACING, SPACING  # between the planes of the lattice
    whole = frame_of(first, oil_fraction(first, height=low))
    expected = 2.0 * (RADIUS**2 * high - high**3 / 3.0) / (2.0 / 3.0 * RADIUS**3 + RADIUS**2 * high - high**3 / 3.0)
    found = elsewhere(whole, frame_of(second, oil_fraction(second, height=high)), OIL)
    assert found == pytest.approx(expected, abs=0.04)     # two packings: a tenth of a spacing of the interface
    assert elsewhere(whole, frame_of(second, np.zeros(len(second))), OIL) == pytest.approx(1.0)
    assert elsewhere(whole, whole, OIL) == 0.0


def test_advisor_is_asked_about_the_scene_with_all_effects():
    volume = float(ball()["cavity_volume"])
    scene = load_scene(ROOT / "config" / "scenes" / "effects_emulsion.yaml", "draft")
    assert judgment(scene, volume, "interface_tension")[0]
    matters, sentence = judgment(scene, volume, "drift")
    assert not matters and sentence.startswith("cannot be seen")


def test_cost_and_change_of_an_effect():
    scene = load_scene(ROOT / "config" / "scenes" / "effects_emulsion.yaml", "draft")
    position, volume = lattice(), float(ball()["cavity_volume"])

    def made(name, seconds, height):
        costs = {"drift": {"cpu_seconds": "1", "cpu_share": "0.1", "bytes": str(2**20), "kernels": "3",
                           "launches_per_step": "4"},
                 "solver": {"cpu_seconds": str(seconds - 1.0), "launches_per_step": "5"}}
        frame = frame_of(position, oil_fraction(position, height=height))
        numbers = {"fill": (50.0 + seconds, "%")}
        return Result(dataclasses.replace(scene, name=name), volume, frame, None, {}, costs, numbers)

    rows, remark, caption = compared(made(scene.name, 10.0, 0.0), made(f"{scene.name}{OFF}drift", 8.0, 0.0), "drift",
                                     "silicone_oil_1000")
    values = {row.quantity: row for row in rows}
    assert values["computing time saved without it / all"].value == pytest.approx(0.2)
    assert values["oil that is elsewhere at the end / oil"].value == 0.0
    assert values["kernel launches per step"].reference == 9.0
    assert values["fill"].error == pytest.approx(2.0) and values["memory of its own"].value == 1.0
    assert "20 % less computing time" in remark and "cannot be seen" in remark
    assert caption == "time -20 %, oil elsewhere 0 %"
