"""What of a scene is left out or done cheaper: the rules, one by one, and that the log says so."""
import dataclasses

import pytest
from helpers import cavities
from helpers.effect_cases import ACTIVE, BESIDE, INVISCID, SHEDDING, ZERO

from pipeline.cavity.container import container_arrays
from pipeline.scenes.load import PROJECT_CONFIG, load_scene
from pipeline.simulation.solver_setup import build_solver
from sim.effect_selection import cheapest, without_idle
from sim.effects import REGISTRY
from sim.effects.viscosity import ViscosityParameters
from sim.settings import Liquid, Numerics, Settings

THIN, THICK = Liquid("aqueous", 1005.0, 1e-3), Liquid("oil", 970.0, 1.0)
DROPLETS = Liquid("droplets", 970.0, 1.0)
NUMERICS = Numerics(particle_spacing=1e-3)


def settings_of(name, values, liquids=(THIN, THICK, DROPLETS), **more) -> Settings:
    """Return settings with one effect, the last one, and with what it needs to act."""
    effects = [cavities.parameters(other, **ACTIVE[other]) for other in BESIDE.get(name, ())]
    return Settings(2, tuple(liquids), NUMERICS, (*effects, cavities.parameters(name, **values)), **more)


def kept(settings) -> tuple[bool, str]:
    """Return whether the last effect stays, and what is said if not."""
    left, notes = without_idle(settings)
    return settings.effects[-1] in left.effects, "".join(notes)


@pytest.mark.parametrize("name", REGISTRY)
def test_effect_that_acts_stays(name):
    assert kept(settings_of(name, ACTIVE[name])) == (True, "")


@pytest.mark.parametrize("name", sorted(set(REGISTRY) - {"injection"}))  # which only waits for its start
def test_effect_with_a_zero_coefficient_is_left_out_and_the_reason_said(name):
    liquids = INVISCID if "viscosity" in name else (THIN, THICK, DROPLETS)
    stays, note = kept(settings_of(name, ZERO[name], liquids))
    assert not stays and note.startswith(f"{name} is left out: ") and " 0" in note


@pytest.mark.parametrize(("name", "values", "liquids", "reason"), [
    ("drift", {"droplet_diameter": 1e-4}, [dataclasses.replace(THIN, density=970.0), THICK, DROPLETS],
     "the densities of the liquids do not differ"),
    ("collision", {}, [THIN], "there is one liquid only"),
    ("wall_film", {}, [dataclasses.replace(THIN, density=970.0), THICK], "the liquids weigh the same"),
    ("cohesion", {"tension": 0.0}, [THIN, THICK], "its coefficient is 0"),
    ("contact_line_emulsification", SHEDDING | {"saccade_rate": 0.0}, [THIN, THICK, DROPLETS], "saccade_rate is 0"),
])
def test_effect_without_anything_to_act_on_is_left_out(name, values, liquids, reason):
    stays, note = kept(settings_of(name, values, liquids))
    assert not stays and reason in note


@pytest.mark.parametrize(("name", "values"), [
    ("gravity", {"magnitude": 0.0, "jolts": ("a jolt",)}), ("injection", ZERO["injection"])])
def test_effect_that_acts_later_stays(name, values):
    assert kept(settings_of(name, values))[0]


@pytest.mark.parametrize(("densities", "stays"), [((1000.0, 970.0), True), ((1000.0, 1000.0), False)])
def test_interface_without_tension_stays_where_layers_have_unequal_weight(densities, stays):
    liquids = tuple(Liquid(f"liquid_{n}", density, 1e-3) for n, density in enumerate(densities))
    effects = (cavities.parameters("gravity"), cavities.parameters("interface_tension", coefficient=0.0))
    left, notes = without_idle(Settings(2, liquids, NUMERICS, effects))
    assert (len(left.effects) == 2) == stays and ("weigh the same" in "".join(notes)) != stays


@pytest.mark.parametrize("name", ["drift", "diffusion", "contact_line_emulsification"])
def test_liquids_that_an_earlier_scene_has_mixed_stay_mixed(name):
    """Without the effect their fractions would be forgotten."""
    assert kept(settings_of(name, ZERO[name], continued=True))[0]


# Explicit in place of implicit viscosity: the limit is dx^2 rho / (8 mu) of the stiffest liquid.

@pytest.mark.parametrize(("viscosity", "values", "explicit"), [
    (0.06, {}, True),                       # 2.02 ms, above the largest time step of 2 ms
    (0.062, {}, False),                     # 1.96 ms
    (0.06, {"form": "laplacian", "wall": "free_slip"}, True),
    (0.06, {"form": "strain"}, False),      # explicit viscosity has no such form
    (0.06, {"explicit_if_cheaper": False}, False),
])
def test_viscosity_is_explicit_where_that_costs_no_step(viscosity, values, explicit):
    liquids = (THIN, Liquid("oil", 970.0, viscosity))
    given = settings_of("viscosity_implicit", values, liquids)
    found, notes = cheapest(given)
    if explicit:
        expected = {"form": "central", "wall": "no_slip"} | values
        assert found.effects == (ViscosityParameters(**expected),)
        assert "implicit is advanced explicitly: the limit of that, 2.02 ms, is not below the 2 ms" in notes[0]
    else:
        assert found == given and not notes


def test_other_limits_of_the_time_step_count_for_explicit_viscosity():
    """A fixed step makes a limit of 1.99 ms cost nothing; tension allows 1.98 ms, more beside implicit viscosity."""
    liquids = (THIN, Liquid("oil", 970.0, 0.125e-6 * 970.0 / 1.99e-3))
    implicit, tension = cavities.parameters("viscosity_implicit"), cavities.parameters(
        "interface_tension", coefficient=0.04)
    alone = Settings(2, liquids, NUMERICS, (implicit,))
    assert not cheapest(alone)[1]
    assert not cheapest(dataclasses.replace(alone, effects=(tension, implicit)))[1]
    assert cheapest(dataclasses.replace(alone, numerics=dataclasses.replace(NUMERICS, time_step=1e-3)))[1]


# In a run.

SCENE = """
title: Thin liquids
dimension: 2
container: {size: [20 mm, 20 mm]}
liquids: {aqueous: {density: 970 kg/m3}, silicone_oil_1000: {density: 970 kg/m3, dynamic_viscosity: 2 mPa s}}
blocks:
  - {liquid: aqueous, lower: [0, 0], upper: [20 mm, 10 mm]}
  - {liquid: silicone_oil_1000, lower: [0, 10 mm], upper: [20 mm, 20 mm]}
numerics: {particle_spacing: 1 mm, precision: f64}
effects: {gravity: {}, viscosity_implicit: {}, interface_tension: {coefficient: 0}, diffusion: {coefficient: 0}}
output: {duration: 0.1 s}
"""


@pytest.mark.thorough
def test_run_takes_what_is_left_and_says_so(taichi, project):
    path = project.folder / "config" / "scenes" / "thin.yaml"
    path.write_text(SCENE)
    scene = load_scene(path, "draft", PROJECT_CONFIG)
    solver = build_solver(scene, container_arrays(scene))
    assert [effect.name for effect in solver.effects] == ["gravity", "viscosity"]
    assert "volume_fraction" not in solver.particles.arrays and "color" not in solver.particles.arrays
    assert [note.split(":")[0] for note in solver.notes] == [
        "viscosity_implicit is advanced explicitly", "interface_tension is left out", "diffusion is left out"]
