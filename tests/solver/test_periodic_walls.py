"""A channel whose ends are one: where it is cut does not matter."""
import math

import numpy as np
import pytest
from helpers import cavities
from helpers.cases import thorough

from sim.settings import Liquid

pytestmark = pytest.mark.usefixtures("taichi")
LENGTH, WIDTH = 12e-3, 10e-3  # m


def pressures(shift: float, filled) -> np.ndarray:
    """Pressures of uneven liquid that begins to fall along a channel, by particle, all of them moved by `shift`, m."""
    arrays = dict(cavities.cavity("box", (LENGTH, WIDTH), periodic=(0,)))
    rng = np.random.default_rng(1)
    position = arrays["fluid_position"] + rng.uniform(-0.1, 0.1, arrays["fluid_position"].shape) * cavities.SPACING
    position[:, 0] = (position[:, 0] + shift + 0.5 * LENGTH) % LENGTH - 0.5 * LENGTH
    gravity = cavities.parameters("gravity", posture="left_side")
    solver = cavities.build(arrays | {"fluid_position": position}, effects=(gravity,), liquids=(cavities.AQUEOUS,),
                            phase=lambda x: np.zeros(len(x)), filled=filled, time_step=1e-4,
                            pressure_tolerance=1e-8, maximum_iterations=2000)
    solver.step()
    return solver.snapshot()["pressure"]


@pytest.mark.parametrize("filled", [None, thorough(lambda x: x[:, 1] < 0.1 * WIDTH)],
                         ids=["full", "with a free surface"])
def test_pressure_does_not_depend_on_where_a_channel_is_cut(filled):
    here, elsewhere = pressures(0.0, filled), pressures(5.0 * cavities.SPACING, filled)
    assert np.abs(elsewhere - here).max() < 1e-3 * np.abs(here).max()


@pytest.mark.thorough
def test_layers_between_a_floor_and_a_ceiling_without_end_rest():
    """Nothing falls along the channel, so that its liquids are as much at rest as in a closed box."""
    gravity, height = 9.81, 16.0 * cavities.SPACING
    solver = cavities.build(
        cavities.cavity("box", (0.5 * height, height), periodic=(0,)), phase=lambda x: x[:, 1] > 0.0, support_ratio=3.0,
        effects=(cavities.parameters("gravity", magnitude=gravity), cavities.parameters("viscosity_implicit")),
        liquids=(Liquid("heavy", 1000.0, 1e-3), Liquid("light", 500.0, 5e-4)))
    cavities.run(solver, 5.0 * math.sqrt(height / gravity))
    assert cavities.root_mean_square_speed(solver) < 5e-3 * math.sqrt(gravity * height)
