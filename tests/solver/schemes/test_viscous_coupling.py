"""Pressure and viscosity as one step: oil in long steps, and what stands for viscosity in the pressure."""
import numpy as np
import pytest
from helpers import cavities
from helpers.cavities import SPACING

from sim.settings import Liquid

pytestmark = pytest.mark.usefixtures("taichi")

RADIUS = 11.0 * SPACING
LONG, SHORT, UNTIL = 5e-3, 1e-3, 0.3  # s; nu dt/dx^2 is 5 in long steps


def level_oil(form: str):
    """Oil of 1 Pa s above a quarter of aqueous in a circle, which it rounds up in."""
    arrays = cavities.cavity("circle", RADIUS)
    level = np.quantile(arrays["fluid_position"][:, 1], 0.25)
    effects = (cavities.parameters("gravity"), cavities.parameters("viscosity_implicit", form=form),
               cavities.parameters("interface_tension", coefficient=0.04, contact_angle=np.radians(18.2)))
    return cavities.build(arrays, effects=effects, phase=lambda x: x[:, 1] > level, maximum_time_step=LONG,
                          liquids=(Liquid("aqueous", 1005.0, 7e-4), Liquid("oil", 970.0, 1.0)), time_error=0.1,
                          support_ratio=2.5, pressure_tolerance=3e-4, viscosity_tolerance=3e-2)


def rise(solver) -> tuple[float, float]:
    """Time, and height of the aqueous."""
    position, phase = cavities.read(solver, "position", "phase")
    return solver.time, position[phase == 0, 1].mean()


@pytest.fixture(scope="module", params=("central", "strain", "laplacian"))
def oil(request, taichi):
    """A solver that is at its start, with that state."""
    solver = level_oil(request.param)
    return solver, solver.state()


def test_oil_moves_as_far_in_long_steps_as_in_short_ones(oil):
    """The aqueous rises by 0.04 mm, root mean square of the difference 2 to 6 %; with split solves 56 % and more."""
    solver, start = oil
    solver.restore(start)
    _, bottom = rise(solver)
    time, fine = np.transpose(cavities.run_in_steps(solver, SHORT, UNTIL, rise))
    solver.restore(start)
    times, heights = np.transpose(cavities.run_in_steps(solver, LONG, UNTIL, rise))
    assert len(times) < 0.25 * len(time)
    expected = np.interp(times, time, fine) - bottom
    assert np.sqrt(((heights - bottom - expected) ** 2).mean() / (expected**2).mean()) < 0.08


def test_pressure_counts_with_the_viscosity_of_what_is_around(oil):
    """Inside oil with its resistance to compression, and with little of it where aqueous is near."""
    solver, start = oil
    solver.restore(start)
    solver.step()
    form = solver.scheme.viscous.parameters.form
    position, phase = cavities.read(solver, "position", "phase")
    slack = solver.scheme.viscous.coupling.slack.to_numpy()[:len(phase)] / solver.statistics["time_step"]
    is_oil, center = phase == 1, np.linalg.norm(position, axis=1)
    height = position[:, 1] - position[phase == 0, 1].max()
    inside = is_oil & (center < RADIUS - 4.0 * SPACING) & (height > 4.0 * SPACING)
    compression = {"central": 3.0, "strain": 2.0, "laplacian": 1.0}[form]
    assert np.median(slack[inside]) == pytest.approx(compression, rel=0.1)
    assert np.median(slack[is_oil & (height < SPACING)]) < 0.3 * compression
    assert (slack >= 0.0).all()


def test_long_steps_are_the_same_bit_by_bit_after_a_restart(oil):
    solver, start = oil
    solver.restore(start)
    cavities.run(solver, 4 * LONG)
    middle = solver.state()
    cavities.run(solver, 8 * LONG)
    expected = solver.state()
    solver.restore(middle)
    cavities.run(solver, 8 * LONG)
    for name, values in solver.state().items():
        np.testing.assert_array_equal(values, expected[name], err_msg=name)
