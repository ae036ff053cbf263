"""Gas beside water in a full cavity: pressures shared by density (P13)."""
import math

import numpy as np
import pytest
from helpers import cavities
from helpers.cavities import build, cavity, parameters

from sim.schemes.volume_incompressible import SOFTENED
from sim.settings import Liquid

pytestmark = pytest.mark.usefixtures("anew")
GRAVITY, HEIGHT = 9.81, 0.02
TIME, SPEED = math.sqrt(HEIGHT / GRAVITY), math.sqrt(GRAVITY * HEIGHT)
SPACING = HEIGHT / 16
WATER = Liquid("water", 1000.0, 0.0)


def tank(shape: str, density: float, phase=lambda x: x[:, 1] > 0.0):
    size = (HEIGHT, HEIGHT) if shape == "box" else 0.5 * HEIGHT
    return build(cavity(shape, size, 2, SPACING), effects=(parameters("gravity", magnitude=GRAVITY),), phase=phase,
                 liquids=(WATER, Liquid("gas", density, 0.0)), support_ratio=3.0)


@pytest.mark.thorough
@pytest.mark.parametrize("density", [100.0, 10.0, 1.0])
@pytest.mark.parametrize("shape", ["box", "circle"])
def test_gas_above_water_stays_at_rest(shape, density):
    """Without viscosity and tension; the study `validation` measures 1 % of rho g H at 32 spacings."""
    solver = tank(shape, density)
    cavities.run(solver, 2.0 * TIME)
    state = solver.snapshot()
    y, water = state["position"][:, 1], state["phase"] == 0
    error = state["pressure"] + GRAVITY * np.where(y > 0.0, density, 1000.0) * y
    assert np.std(error) < 0.05 * 1000.0 * GRAVITY * HEIGHT  # known up to a constant
    speed = np.linalg.norm(state["velocity"], axis=1)
    assert speed[water].max() < 0.2 * SPEED and speed[~water].max() < SPEED
    assert y[water].max() < 1.5 * SPACING and y[~water].min() > -1.5 * SPACING


def test_water_does_not_fall_into_gas_that_has_no_way_out():
    """Water above gas is held by the gas, which keeps its volume, until the interface has grown uneven: in free fall it
    would have fallen two spacings.
    """
    solver = tank("circle", 1.0, phase=lambda x: x[:, 1] < 0.0)
    start = solver.snapshot()
    cavities.run(solver, math.sqrt(4.0 * SPACING / GRAVITY))
    state = solver.snapshot()
    water = state["phase"] == 0
    fallen = (start["position"] - state["position"])[water, 1].mean()
    assert abs(fallen) < 0.1 * SPACING
    assert state["compression_rate"].max() < 1.1
    weight = 1000.0 * GRAVITY * HEIGHT
    assert np.abs(state["pressure"][~water]).max() < 0.05 * weight  # gas has about none, and the water hangs from it
    assert state["pressure"][water].min() < -0.3 * weight


def test_softening_leaves_gas_its_pressure():
    """What travels loses the unevenness of its pressure, not the jump between water and gas."""
    solver = tank("box", 1.0)
    solver.step()
    phase = solver.particles.to_numpy("phase")
    solver.particles.from_numpy("pressure", np.where(phase == 0, 1.0, 0.0))
    velocity = np.zeros((len(phase), 2))
    velocity[:, 0] = SOFTENED * SPACING / 1e-3
    solver.particles.from_numpy("velocity_at_start", velocity)
    solver.scheme._soften(1e-3)
    (pressure,) = cavities.read(solver, "pressure")
    assert pressure[phase == 0].min() > 0.98 and pressure[phase == 1].max() < 0.02
