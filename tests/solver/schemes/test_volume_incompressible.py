"""Volume-incompressible SPH in a full cavity: the pressure that moving liquid carries from step to step."""
import numpy as np
import pytest
from helpers import cavities

from sim.schemes.volume_incompressible import SOFTENED

pytestmark = pytest.mark.usefixtures("anew")
STEP = 1e-3


@pytest.mark.thorough
@pytest.mark.parametrize(("travel", "least", "most"), [
    (0.0, 1.0, 1.0),  # at rest nothing is lost: viscous liquid builds its pressure up step by step
    (0.1 * SOFTENED, 0.98, 1.0),  # a share of 0.01 is lost, as it grows with the square of the way
    (SOFTENED, 0.0, 0.5), (2.0 * SOFTENED, 0.0, 0.5)])  # a weighted mean of 20 random values, of which 6 count
def test_uneven_pressure_is_lost_as_particles_travel(travel, least, most):
    solver = cavities.build(cavities.cavity("box", (12e-3, 12e-3)))
    solver.step()  # rows of neighbors
    particles, scheme = solver.particles, solver.scheme
    count = len(cavities.read(solver, "pressure")[0])
    velocity = np.zeros((count, 2))
    velocity[:, 0] = travel * cavities.SPACING / STEP

    def softened(pressure: np.ndarray) -> np.ndarray:
        particles.from_numpy("pressure", pressure)
        particles.from_numpy("velocity_at_start", velocity)
        scheme._soften(STEP)
        return cavities.read(solver, "pressure")[0]

    np.testing.assert_allclose(softened(np.full(count, 7.0)), 7.0, rtol=1e-12)
    noise = np.random.default_rng(1).normal(size=count)
    kept = softened(noise)
    assert least <= np.sqrt((kept**2).mean() / (noise**2).mean()) <= most
    if travel == 0.0:
        np.testing.assert_array_equal(kept, noise)


def test_particles_that_are_too_close_part():
    """The gradient of the kernel, which falls to zero between them, would leave them together."""
    solver = cavities.build(cavities.cavity("box", (12e-3, 12e-3)))
    (position,) = cavities.read(solver, "position")
    one = np.linalg.norm(position, axis=1).argmin()
    away = np.linalg.norm(position - position[one], axis=1)
    other = np.argsort(away)[1]
    position[other] = position[one] + 0.1 * (position[other] - position[one])
    ids = solver.particles.to_numpy("id")[[one, other]]
    solver.particles.from_numpy("position", position)
    for _ in range(20):
        solver.step()
    pair = solver.snapshot()["position"][ids]
    assert np.linalg.norm(pair[0] - pair[1]) > 0.7 * cavities.SPACING
