"""Maxwell liquids against exact solutions, and what their forces keep."""
import numpy as np
import pytest
from helpers import cavities
from scipy.optimize import curve_fit

from sim.backend import ti
from sim.effects.viscoelastic import ElasticLiquid, Viscoelastic, ViscoelasticParameters
from sim.settings import Liquid, Numerics, Settings

pytestmark = pytest.mark.usefixtures("taichi")
GEL, OTHER = Liquid("gel", 1000.0, 0.0), Liquid("other", 2000.0, 0.0)
MODULUS, YIELD = 40.0, 3.0  # Pa
COUNT = 24                  # particles along a period
LENGTH = COUNT * cavities.SPACING
WAVE_NUMBER = 2.0 * np.pi / LENGTH
FREQUENCY = WAVE_NUMBER * np.sqrt(MODULUS / GEL.density)  # of a shear wave, 1/s
RELAXATION = 5.0 / FREQUENCY
NO_STRESS = ti.Matrix([[0.0, 0.0], [0.0, 0.0]])


@pytest.fixture(scope="module")
def periodic(taichi):
    """Return a solver whose gel has no walls, and its state at rest; its shear modulus and yield stress are fields."""
    arrays = cavities.cavity("box", (LENGTH, LENGTH), periodic=(0, 1))
    gel = ElasticLiquid("gel", MODULUS, RELAXATION)
    solver = cavities.build(arrays, effects=(ViscoelasticParameters((gel,)),), liquids=(GEL, OTHER),
                            phase=lambda x: np.zeros(len(x)))
    return solver, solver.state()


@pytest.fixture
def gel(periodic):
    """Return that solver at rest."""
    solver, start = periodic
    solver.restore(start)
    solver.effects[0].yield_stress[0] = 1e30
    return solver


@pytest.mark.thorough
def test_shear_wave_swings_and_decays_as_maxwell_has_it(gel):
    """v'' + v'/lambda + (M/rho) k^2 v = 0: frequency to 3 % (the kernel blunts a wave of 24 spacings by 2 %)."""
    (position,) = cavities.read(gel, "position")
    gel.particles.from_numpy("velocity", 1e-3 * np.c_[np.sin(WAVE_NUMBER * position[:, 1]), np.zeros(len(position))])

    def amplitude(solver):
        y, v = cavities.read(solver, "position", "velocity")
        return solver.time, 2e3 * np.mean(v[:, 0] * np.sin(WAVE_NUMBER * y[:, 1]))

    def exact(t, frequency, relaxation):
        swing = np.sqrt(frequency**2 - 0.25 / relaxation**2)
        return np.exp(-0.5 * t / relaxation) * (np.cos(swing * t) + np.sin(swing * t) / (2.0 * relaxation * swing))

    time, found = np.array(cavities.run(gel, 4.0 * np.pi / FREQUENCY, amplitude)).T
    (frequency, relaxation), _ = curve_fit(exact, time, found, p0=(FREQUENCY, RELAXATION))
    assert found.min() < -0.5
    assert frequency == pytest.approx(FREQUENCY, rel=0.03)
    assert relaxation == pytest.approx(RELAXATION, rel=0.05)
    assert np.abs(found - exact(time, frequency, relaxation)).max() < 0.04  # a step of 1/40 of a period


@pytest.mark.thorough
def test_stress_at_rest_relaxes_exponentially(gel):
    """T = T_0 exp(-t/lambda), exact in every step; an even stress moves nothing."""
    stress = np.array([[0.4, 1.0], [1.0, -0.4]])
    gel.particles.from_numpy("stress", np.broadcast_to(stress, (gel.count[None], 2, 2)))
    cavities.run(gel, 0.7 * RELAXATION)
    expected = np.broadcast_to(stress * np.exp(-0.7), (gel.count[None], 2, 2))
    np.testing.assert_allclose(cavities.read(gel, "stress")[0], expected, rtol=0.0, atol=1e-9)
    assert cavities.root_mean_square_speed(gel) < 1e-9


@ti.kernel
def advance_stress(effect: ti.template(), stress: ti.types.matrix(2, 2, ti.f64),
                   gradient: ti.types.matrix(2, 2, ti.f64), dt: float, steps: int) -> ti.types.matrix(2, 2, ti.f64):
    new = stress
    ti.loop_config(serialize=True)
    for _ in range(steps):
        new = effect._advanced(new, gradient, 0, dt)
    return new


def test_rotation_turns_the_stress_and_makes_none(gel):
    """A whole turn gives back the stress, less what has relaxed; without stress none appears."""
    effect, rate = gel.effects[0], 2.0 * np.pi / RELAXATION
    gradient, stress = ti.Matrix([[0.0, -rate], [rate, 0.0]]), ti.Matrix([[0.4, 1.0], [1.0, -0.4]])
    dt = 2e-3 * RELAXATION
    turned = advance_stress(effect, stress, gradient, dt, 500).to_numpy()
    np.testing.assert_allclose(turned, stress.to_numpy() * np.exp(-1.0), atol=1e-4)
    assert np.abs(advance_stress(effect, NO_STRESS, gradient, dt, 500).to_numpy()).max() == 0.0


def test_slow_shear_meets_the_viscosity(gel):
    """Shear slow against the relaxation: T_xy = M_s lambda times the shear rate, and no more."""
    rate = 1e-3 / RELAXATION
    stress = advance_stress(gel.effects[0], NO_STRESS, ti.Matrix([[0.0, rate], [0.0, 0.0]]),
                            0.05 * RELAXATION, 400).to_numpy()
    assert stress[0, 1] == pytest.approx(MODULUS * RELAXATION * rate, rel=1e-5)


def test_stress_stays_at_the_yield_stress(gel):
    gel.effects[0].yield_stress[0] = YIELD
    rate = 100.0 / RELAXATION
    stress = advance_stress(gel.effects[0], NO_STRESS, ti.Matrix([[rate, 0.0], [0.0, -rate]]),
                            0.01 * RELAXATION, 50).to_numpy()
    assert np.sqrt(1.5 * (stress**2).sum()) == pytest.approx(YIELD, rel=1e-12)
    assert np.trace(stress) == pytest.approx(0.0, abs=1e-12)


@ti.kernel
def add_forces(solver: ti.template(), effect: ti.template()):
    for i in range(solver.count[None]):
        total = solver.velocity[i] * 0.0
        for slot in range(solver.pairs.count[i]):
            k = solver.pairs.entry(i, slot)
            j = solver.pairs.index[k]
            total += effect.pair_acceleration(i, j, total, solver.pairs.gradient[k], solver.pairs.weight[k])
        solver.acceleration[i] = solver.particles.arrays["mass"][i] * total


def test_forces_take_what_the_stress_stores(gel):
    """Power of the forces = -sum of V T:grad v; they keep momentum and spin, also at the surface of a round piece."""
    rng, effect = np.random.default_rng(5), gel.effects[0]
    (position,) = cavities.read(gel, "position")
    inside = np.linalg.norm(position, axis=1) < 0.3 * LENGTH
    gel.particles.from_numpy("phase", np.where(inside, 0, 1).astype(np.int32))
    stress, velocity = rng.normal(size=(len(position), 2, 2)), rng.normal(size=position.shape)
    stress += stress.transpose(0, 2, 1)
    stress -= 0.5 * stress.trace(axis1=1, axis2=2)[:, None, None] * np.eye(2)
    gel.particles.from_numpy("velocity", velocity)
    gel.particles.from_numpy("stress", stress)
    effect.prepare(0.0)  # keeps the stress, and corrects it for the force
    add_forces(gel, effect)
    force, stress, volume = cavities.read(gel, "acceleration", "stress", "volume")
    assert not force[~inside].any()
    scale = np.abs(force).sum()
    assert np.abs(force.sum(axis=0)).max() < 1e-13 * scale
    torque = position[:, 0] * force[:, 1] - position[:, 1] * force[:, 0]
    assert abs(torque.sum()) < 1e-12 * np.abs(torque).sum()
    before = stress.copy()
    dt = 1e-8
    effect.prepare(dt)  # dT = dt (2 M dev D + turning): its product with T is the power stored
    after = cavities.read(gel, "stress")[0]
    decay = np.exp(-dt / RELAXATION)
    stored = (volume[:, None, None] * before * (after / decay - before)).sum() / (2.0 * MODULUS * dt)
    np.testing.assert_allclose((force * velocity).sum() + stored, 0.0, atol=1e-3 * np.abs(force * velocity).sum())


def test_stiffness_limits_the_time_step():
    numerics = Numerics(particle_spacing=1e-3)
    parameters = ViscoelasticParameters((ElasticLiquid("gel", MODULUS), ElasticLiquid("other", 0.0)))
    limit = Viscoelastic.time_step_limit(parameters, Settings(2, (GEL, OTHER), numerics, (parameters,)))
    assert limit == pytest.approx(0.3e-3 / np.sqrt(MODULUS / GEL.density))


def test_stress_turns_the_way_the_liquid_does(gel):
    """An eighth of a turn to the left takes a pull along x and push along y to a shear that pulls along x = y."""
    rate = 2.0 * np.pi / RELAXATION
    gradient = ti.Matrix([[0.0, -rate], [rate, 0.0]])  # v = rate (-y, x)
    turned = advance_stress(gel.effects[0], ti.Matrix([[1.0, 0.0], [0.0, -1.0]]), gradient, RELAXATION / 800.0, 100)
    expected = np.exp(-0.125) * np.array([[0.0, 1.0], [1.0, 0.0]])
    np.testing.assert_allclose(turned.to_numpy(), expected, atol=1e-4)
