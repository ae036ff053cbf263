"""The study of large time steps: which steps are taken, and what they are compared with."""
import numpy as np
import pytest
from conftest import ROOT

from pipeline.scenes.load import load_scene
from studies.validation import step_size

pytestmark = pytest.mark.usefixtures("anew")


def test_difference_is_relative_to_the_run_with_the_smallest_steps():
    time = np.linspace(0.0, 1.0, 11)
    same = np.array([time, time])
    curves = {"[2]": np.array([time[::2], 1.1 * time[::2]]), "[1]": same, "[0.5]": same}
    rows = {row.at: row.value for row in step_size.differences(curves)}
    assert rows == pytest.approx({"[2]": 0.1, "[1]": 0.0}, abs=1e-12)
    assert step_size.differences({}) == []


@pytest.mark.thorough
def test_steps_are_the_largest_of_each_run_at_a_spacing_of_its_own():
    """At 2 mm steps of 0.56 and 0.28 ms divide 8.4 ms evenly; fewer steps cost less and are further off."""
    scene = load_scene(ROOT / "config" / "scenes" / "resting_eye.yaml", "draft")
    outcome = step_size.run(step_size.Parameters(largest_steps=(0.56e-3, 0.28e-3), duration=8.4e-3, support_ratio=2.5,
                                                 spacing_factor=2.0), scene)
    values = {(row.at, row.quantity): row.value for row in outcome.rows}
    assert values["[0.56 ms]", "particle spacing"] == pytest.approx(2.0)
    assert values["[0.56 ms]", "time steps"] == 15 and values["[0.28 ms]", "time steps"] == 30
    off = values["[0.56 ms]", "difference from 0.28 ms"]
    assert np.isfinite(values["[0.56 ms]", "kinetic energy, difference from 0.28 ms"]) and np.isfinite(off)
    drawn = {curve.figure: curve for curve in outcome.curves if curve.figure != "step_size"}
    assert list(drawn["step_size_error"].x) == [0.56] and drawn["step_size_error"].y == [pytest.approx(100.0 * off)]
    assert drawn["step_size_cost"].y == drawn["step_size_error"].y and drawn["step_size_cost"].x[0] > 0.0
