"""XSPH viscosity: momentum, energy, the viscosity that a coefficient stands for, walls, and what it costs in steps."""
import dataclasses

import numpy as np
import pytest
from helpers import cavities

from pipeline.base.errors import UserError
from pipeline.scenes.load import load_scene
from sim.effects.xsph import Xsph, kinematic_viscosity
from sim.settings import Liquid
from studies.validation import shear_wave

pytestmark = pytest.mark.usefixtures("anew")
SPACING = cavities.SPACING
WATER, LIGHT = Liquid("water", 1000.0, 0.05), Liquid("light", 500.0, 0.2)
MODES = pytest.mark.parametrize("values", [{"coefficient": 0.3}, {}], ids=["coefficient", "own viscosity"])


def drop(values, **more):
    """Return a free drop of two liquids 1:2 with disordered velocities."""
    rng = np.random.default_rng(1)
    return cavities.build(
        cavities.cavity("box", (40e-3, 40e-3)), liquids=(WATER, LIGHT), scheme="position_based",
        effects=(cavities.parameters("xsph", **values),), filled=lambda x: np.linalg.norm(x, axis=1) < 6e-3,
        phase=lambda x: x[:, 0] > 0.0, velocity=lambda x: 0.2 * rng.normal(size=x.shape), **more)


@pytest.mark.thorough_cases("own viscosity")
@MODES
def test_momentum_stays_and_energy_falls(values):
    """Unequal volumes and masses: k_ij = k_ji, so that sum m_i v_i changes by rounding alone."""
    solver = drop(values)
    rng = np.random.default_rng(2)
    for name in ("volume", "mass"):
        solver.particles.from_numpy(name, cavities.read(solver, name)[0] * rng.uniform(0.8, 1.2, solver.count[None]))
    mass, before = cavities.read(solver, "mass", "velocity")
    (effect,) = solver.effects
    effect.finish(1e-3 if values else effect.stable_time_step())
    (after,) = cavities.read(solver, "velocity")
    assert np.abs(after - before).max() > 0.02
    assert np.abs(mass @ (after - before)).max() < 1e-14 * (mass @ np.abs(before)).max()
    assert mass @ (after**2).sum(axis=1) < mass @ (before**2).sum(axis=1)


@pytest.mark.thorough
@MODES
def test_free_drop_keeps_its_momentum(values):
    solver = drop(values)
    start, mass = cavities.momentum(solver), cavities.read(solver, "mass")[0].sum()
    cavities.run(solver, 0.01)
    assert solver.wall_pairs.count.to_numpy()[: solver.count[None]].sum() == 0
    assert np.abs(cavities.momentum(solver) - start).max() < 1e-12 * mass


@pytest.mark.thorough
@pytest.mark.parametrize(("kernel", "viscosity"), [("wendland_c2", "coefficient"), ("cubic_spline", "coefficient"),
                                                   ("wendland_c2", "own")])
def test_shear_wave_decays_as_the_viscosity_has_it(kernel, viscosity):
    """exp(-nu k^2 t) with nu = c M/(2 dt), and with the liquid's own nu: 2 to 5 % at 16 particles per period."""
    outcome = shear_wave.run(shear_wave.Parameters(scheme="position_based", kernel=kernel, viscosity=viscosity,
                                                   coefficient=0.5, decay=0.5, resolutions=(16,)))
    (row,) = [row for row in outcome.rows if row.quantity.startswith("viscosity of")]
    assert row.value == pytest.approx(1.0, abs=0.06)


@pytest.mark.thorough
def test_liquid_that_moves_as_a_whole_is_not_braked():
    solver = drop({"coefficient": 0.5})
    solver.particles.from_numpy("velocity", np.full((solver.count[None], 2), 0.3))
    solver.effects[0].finish(1e-3)
    assert (cavities.read(solver, "velocity")[0] == 0.3).all()


@pytest.mark.thorough
@pytest.mark.parametrize("values", [{"coefficient": 0.2}, pytest.param({}, marks=pytest.mark.slow)])
def test_wall_holds_the_liquid_where_it_does_not_slip(values):
    speed = {}
    for wall in ("no_slip", "free_slip"):
        solver = cavities.anew(
            cavities.build, cavities.cavity("box", (12e-3, 12e-3), periodic=(0,)), liquids=(WATER,),
            scheme="position_based", effects=(cavities.parameters("xsph", wall=wall, **values),),
            phase=lambda x: np.zeros(len(x)), velocity=lambda x: np.ones_like(x) * [0.1, 0.0])
        cavities.run(solver, 0.05)
        position, velocity = cavities.read(solver, "position", "velocity")
        edge = np.abs(position[:, 1]) > 5e-3
        speed[wall] = velocity[edge, 0].mean()
        assert np.abs(velocity).max() < 0.1 * (1.0 + 1e-6)
    assert speed["free_slip"] == pytest.approx(0.1, rel=0.01)  # wall particles are rough
    assert 0.0 < speed["no_slip"] < 0.05


@pytest.mark.thorough
def test_own_viscosity_limits_the_step_and_a_coefficient_does_not():
    """At the limit the viscosity of the stiffest liquid is a coefficient of 0.5."""
    solver = drop({})
    limit = Xsph.time_step_limit(solver.effects[0].parameters, solver.settings)
    nu = LIGHT.dynamic_viscosity / LIGHT.density
    assert kinematic_viscosity(0.5, limit, solver.settings.numerics, 2) == pytest.approx(nu)
    assert solver.stable_time_step() <= limit
    with_coefficient = dataclasses.replace(solver.effects[0].parameters, coefficient=0.5)
    assert Xsph.time_step_limit(with_coefficient, solver.settings) == np.inf


@pytest.mark.parametrize(("effects", "message"), [
    ("{viscosity: {}, xsph: {}}", "xsph cannot be used together with viscosity: both apply the shear stress"),
    ("{viscosity_implicit: {}, xsph: {}}", "xsph cannot be used together with viscosity_implicit: both apply"),
    ("{xsph: {coefficient: 0.6}}", "effects.xsph.coefficient is 0.6, but must be at least 0 and at most 0.5"),
])
def test_scene_is_refused_in_one_sentence(tmp_path, effects, message):
    path = tmp_path / "honey.yaml"
    path.write_text("container: {size: [1, 1, 1]}\nliquids: [water]\nblocks: [{liquid: water, lower: [0, 0, 0], "
                    f"upper: [1, 0.5, 1]}}]\nnumerics: {{particle_spacing: 0.1}}\neffects: {effects}\n"
                    "output: {duration: 1}\n")
    with pytest.raises(UserError) as caught:
        load_scene(path)
    assert len(caught.value.messages) == 1 and message in caught.value.messages[0]
