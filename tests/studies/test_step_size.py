"""The study of large time steps: which steps are taken, and what they are compared with."""
import dataclasses

import numpy as np
import pytest
from conftest import ROOT

from pipeline.scenes.load import load_scene
from pipeline.studies import step_size

pytestmark = pytest.mark.usefixtures("anew")


def test_difference_is_relative_to_the_run_with_the_smallest_steps():
    time = np.linspace(0.0, 1.0, 11)
    same = np.array([time, time])
    curves = {"[2]": np.array([time[::2], 1.1 * time[::2]]), "[1]": same, "[0.5]": same}
    rows = {row.at: row.value for row in step_size.differences(curves)}
    assert rows == pytest.approx({"[2]": 0.1, "[1]": 0.0}, abs=1e-12)
    assert step_size.differences({}) == []


def test_steps_are_counted_in_capillary_limits_of_the_eye():
    """At 2 mm the limit is sqrt(1975 (2 mm)^3 / (4 pi 40 mN/m)) = 5.6 ms; 0.1 and 0.05 of it divide 8.4 ms evenly."""
    scene = load_scene(ROOT / "config" / "scenes" / "resting_eye.yaml", "draft")
    scene = dataclasses.replace(scene, numerics=dataclasses.replace(scene.numerics, particle_spacing=2e-3))
    outcome = step_size.run(step_size.Parameters(capillary_steps=(0.1, 0.05), duration=8.4e-3, support_ratio=2.5),
                            scene)
    values = {(row.at, row.quantity): row.value for row in outcome.rows}
    label = "[0.1 capillary limits]"
    assert values[label, "capillary limit"] == pytest.approx(5.6e-3, rel=0.01)
    assert values[label, "time steps"] == 15 and values["[0.05 capillary limits]", "time steps"] == 30
    assert np.isfinite(values[label, "difference from 0.05 capillary limits"])
    assert [curve.label for curve in outcome.curves] == ["0.1 capillary limits", "0.05 capillary limits"]
