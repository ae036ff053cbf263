"""Scales of a scene, from what the solver is told and what fills the cavity: no scene file is needed."""
import math

import pytest

from sim.effects import REGISTRY
from sim.liquid import Liquid
from sim.scales import Scales, Start
from sim.settings import Numerics, Settings

VOLUME = 5.6e-6


def scales(fill, **changed):
    liquids = (Liquid("aqueous", 1005.0, 0.7e-3), Liquid("oil", 970.0, 1.0), Liquid("gas", 1.2, 1.8e-5))
    effects = tuple(REGISTRY[name].Parameters(**values) for name, values in (
        ("viscosity", {}), ("gravity", {}), ("interface_tension", {"coefficient": 0.04})))
    return Scales(Settings(3, liquids, Numerics(particle_spacing=1e-3), effects, **changed), Start(fill), VOLUME, 2.0)


def test_scales_need_only_what_the_solver_is_told():
    found = scales({"aqueous": 0.2, "oil": 0.8})
    assert found.length == pytest.approx((0.75 * VOLUME / math.pi) ** (1 / 3))
    bond = 35.0 * 9.81 * found.length**2 / 0.04
    assert found.bond_number(found.gravity, found.tension) == pytest.approx(bond, rel=1e-3)
    assert found.has("gravity") and not found.has("drift")
    assert {one.name for one in found.speeds} == {"buoyant", "capillary"}
    assert all(one.value > 0.0 for effect, parameters in found.effects for one in effect.time_scales(parameters, found))


def test_liquids_count_that_are_ever_in_the_cavity():
    assert [one.name for one in scales({"aqueous": 0.2, "oil": 0.8}).liquids] == ["aqueous", "oil"]
    assert scales({"oil": 1.0}).tension == 0.0
    assert len(scales({"oil": 1.0}, continued=True).liquids) == 3
