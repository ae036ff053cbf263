"""Interface tension: pressure jump of drops, currents that die away, and the contact angle at the wall."""
import numpy as np
import pytest
from helpers import cavities

from sim.effects import REGISTRY
from sim.effects.parts.level_set import SPLAT_RADIUS
from sim.settings import Liquid, Numerics, Settings

pytestmark = pytest.mark.usefixtures("taichi")
SPACING = cavities.SPACING
TENSION = 0.04
# Equal liquids of a hundred times the viscosity of water: what moves does so by tension alone and comes to rest.
LIQUIDS = (Liquid("aqueous", 1000.0, 0.1), Liquid("oil", 1000.0, 0.1))
CIRCLE_DROP, SPHERE_DROP = 6.0 * SPACING, 4.5 * SPACING
BOX = (16.0 * SPACING, 10.0 * SPACING)


def with_tension(arrays, contact_angle, phase):
    effects = (cavities.parameters("interface_tension", coefficient=TENSION, contact_angle=np.radians(contact_angle)),
               cavities.parameters("viscosity_implicit"))
    return cavities.build(arrays, effects=effects, liquids=LIQUIDS, phase=phase, pressure_tolerance=1e-4)


def pressure_jump(state) -> tuple[float, float]:
    """Return the mean pressure inside the drop less that outside, well away from the interface, and its radius."""
    inside = state["phase"] == 1
    volume, dimension = state["volume"][inside].sum(), state["position"].shape[1]
    radius = (volume / (np.pi if dimension == 2 else 4.0 / 3.0 * np.pi)) ** (1.0 / dimension)
    distance = np.linalg.norm(state["position"] - state["position"][inside].mean(axis=0), axis=1)
    outside = distance > min(1.4 * radius, radius + 2.0 * SPACING)
    return state["pressure"][distance < 0.6 * radius].mean() - state["pressure"][outside].mean(), radius


@pytest.fixture(scope="module", params=[(2, 11.0, CIRCLE_DROP, 0.15),
                                        pytest.param((3, 8.0, SPHERE_DROP, 0.05), marks=pytest.mark.slow)],
                ids=["2D", "3D"])
def drop(request):
    """Return dimension, snapshot at the end of a run, and the speeds in every step of it."""
    dimension, cavity, radius, until = request.param
    solver = with_tension(cavities.cavity("circle", cavity * SPACING, dimension), 90.0,
                          lambda x: np.linalg.norm(x, axis=1) < radius)
    speed = np.array(cavities.run(solver, until, cavities.root_mean_square_speed))
    return dimension, solver.snapshot(), speed


def test_pressure_jump_of_a_drop(drop):
    dimension, state, _ = drop
    jump, radius = pressure_jump(state)
    # Laplace. A trial had 0.6 % at eight spacings per radius in 2D and 2.8 % at 6.6 in 3D; here
    # there are six and four and a half, and what is left of the rough start adds half a percent.
    expected = TENSION * (dimension - 1) / radius
    assert jump == pytest.approx(expected, rel={2: 0.03, 3: 0.05}[dimension])


def test_currents_around_a_drop_die_away(drop):
    dimension, _, speed = drop
    capillary_number = LIQUIDS[0].dynamic_viscosity * speed / TENSION
    # Ironing out the rough labels starts at some 5e-3; forms that do not balance stay there.
    # Measured at the end: 8e-4 in 2D and 1.2e-3 in 3D, after a third of the time, both falling.
    assert capillary_number[-1] < {2: 1.2e-3, 3: 2e-3}[dimension]
    assert capillary_number[-1] < 0.45 * capillary_number.max()
    assert speed[-5:].mean() < 0.95 * speed[-15:-10].mean()


def test_drop_stays_round_and_where_it_is(drop):
    _, state, _ = drop
    inside = state["position"][state["phase"] == 1]
    assert np.abs(inside.mean(axis=0)).max() < 0.1 * SPACING
    spread = np.linalg.eigvalsh(np.cov(inside.T))
    assert spread[-1] / spread[0] < 1.05


def meniscus(solver, half_width):
    """Return how far the first liquid has risen at the side walls above the middle, in spacings."""
    position, phase = cavities.read(solver, "position", "phase")
    lower = position[phase == 0]
    edge, middle = np.abs(lower[:, 0]) > half_width - 2.0 * SPACING, np.abs(lower[:, 0]) < 3.0 * SPACING
    return (lower[edge, 1].max() - lower[middle, 1].max()) / SPACING


def test_flat_interface_at_ninety_degrees_stays_flat():
    """In a circle, whose wall a diameter meets at a right angle."""
    solver = with_tension(cavities.cavity("circle", 11.0 * SPACING), 90.0, lambda x: x[:, 1] > 0.0)
    cavities.run(solver, 0.1)
    assert abs(meniscus(solver, 11.0 * SPACING)) < 0.35


@pytest.mark.thorough
def test_gas_over_water_rests_under_tension():
    """Level, at ninety degrees, in a circle of sixteen spacings; where gas bears the force it flies at 4 sqrt(g H)."""
    radius, gravity = 8.0 * SPACING, 9.81
    wave = np.sqrt(2.0 * gravity * radius)
    solver = cavities.build(
        cavities.cavity("circle", radius), phase=lambda x: x[:, 1] > 0.0, support_ratio=3.0,
        liquids=(Liquid("water", 1000.0, 1e-3), Liquid("gas", 1.0, 2e-5)),
        effects=(cavities.parameters("gravity", magnitude=gravity), cavities.parameters("viscosity_implicit"),
                 cavities.parameters("interface_tension", coefficient=0.072, contact_angle=0.5 * np.pi)))
    cavities.run(solver, 2.0 * radius / wave)
    weight, velocity, phase = cavities.read(solver, "jump_weight", "velocity", "phase")
    speed = np.linalg.norm(velocity, axis=1)
    assert not weight[phase == 1].any() and (weight[phase == 0] < 0.0).any()
    assert np.sqrt((speed[phase == 0] ** 2).mean()) < 0.05 * wave
    assert speed[phase == 1].max() < 0.5 * wave


@pytest.mark.parametrize("gas_is_first", [False, True])
def test_single_particle_of_gas_rises_through_water(gas_is_first):
    """Six and a half spacings in 0.3 s, and all nine to the gas above in 0.7: the water around it bears its buoyancy.

    Too small for the level set, it would hang where it is: the liquid around it has no gradient of pressure. Higher up
    its path is that of the rolls that it has set going, and depends on round-off.
    """
    size, gravity, spacing = (24.0 * SPACING, 20.0 * SPACING), 9.81, SPACING
    place = np.array([0.5 * spacing, -6.5 * spacing])
    water, gas = Liquid("water", 1000.0, 1e-3), Liquid("gas", 1.0, 2e-5)

    def is_gas(x):
        distance = np.linalg.norm(x - place, axis=1)
        return (x[:, 1] > 3.0 * spacing) | (distance == distance.min())

    solver = cavities.build(
        cavities.cavity("box", size), phase=lambda x: is_gas(x) != gas_is_first,
        liquids=(gas, water) if gas_is_first else (water, gas),
        effects=(cavities.parameters("gravity", magnitude=gravity), cavities.parameters("viscosity_implicit"),
                 cavities.parameters("interface_tension", coefficient=0.072, contact_angle=0.5 * np.pi)))
    light = int(not gas_is_first)
    position, phase, number = cavities.read(solver, "position", "phase", "id")
    single = number[(phase == light) & (position[:, 1] < 0.0)]
    assert len(single) == 1

    solver.step()
    (tension,) = (effect for effect in solver.effects if effect.name == "interface_tension")
    borne = tension.borne.to_numpy()[: len(phase)]
    volume, phase, number = cavities.read(solver, "volume", "phase", "id")
    assert volume @ borne == pytest.approx(volume[number == single][0], rel=1e-12)
    assert not borne[phase == light].any()

    for until, height in ((0.3, 0.0), (0.7, 2.0 * spacing)):
        cavities.run(solver, until)
        position, number = cavities.read(solver, "position", "id")
        assert position[number == single, 1] > height


@pytest.mark.thorough
def test_pressure_in_a_bubble_of_gas_is_that_of_laplace():
    """Five spacings in radius in a circle of eleven, at rest without gravity, from rough start."""
    liquids = (Liquid("water", 1000.0, 0.1), Liquid("gas", 1.0, 2e-3))
    effects = (cavities.parameters("interface_tension", coefficient=TENSION, contact_angle=0.5 * np.pi),
               cavities.parameters("viscosity_implicit"))
    solver = cavities.build(cavities.cavity("circle", 11.0 * SPACING), effects=effects, liquids=liquids,
                            phase=lambda x: np.linalg.norm(x, axis=1) < CIRCLE_DROP, support_ratio=3.0)
    cavities.run(solver, 0.02)
    jump, radius = pressure_jump(solver.snapshot())
    assert jump == pytest.approx(TENSION / radius, rel=0.05)


def test_liquid_of_sixty_degrees_climbs_the_wall():
    """Young: the interface ends as an arc of radius W/(2 cos 60), whose rise is W/2 (1 - sin 60)/cos 60."""
    solver = with_tension(cavities.cavity("box", BOX), 60.0, lambda x: x[:, 1] > 0.0)
    cavities.run(solver, 0.1)
    final = 0.5 * BOX[0] / SPACING * (1.0 - np.sin(np.pi / 3.0)) / np.cos(np.pi / 3.0)
    assert 0.35 * final < meniscus(solver, 0.5 * BOX[0]) < 1.1 * final


@pytest.mark.thorough
@pytest.mark.parametrize("dimension", [2, 3])
def test_the_jump_at_a_particle_is_the_mean_over_all_points_of_the_interface_in_reach(dimension):
    """(I7) with every point: the bins that points are sorted into leave none out."""
    radius, reach, tail = 3.5 * SPACING, 4.0 * SPACING, 1.5 * SPACING
    solver = with_tension(cavities.cavity("circle", 6.0 * SPACING, dimension), 90.0,
                          lambda x: np.linalg.norm(x, axis=1) < radius)
    solver.prepare_output()
    tension = next(effect for effect in solver.effects if effect.name == "interface_tension")
    position, jump, weight = cavities.read(solver, "position", "jump", "jump_weight")
    position, jump = position[weight > 0.5], jump[weight > 0.5]
    points, groups = tension.point_count[None], tension.group_count[None]
    sums = []
    for place, area, value, number in (
            (tension.sorted_point, tension.sorted_area, tension.sorted_jump, points),
            (tension.group_center, tension.group_area, tension.group_jump, groups)):
        place, area, value = (field.to_numpy()[:number] for field in (place, area, value))
        square = ((position[:, None] - place) ** 2).sum(-1)
        near = np.maximum(1.0 - square / reach**2, 0.0)
        share = near**8 if number == points else (1.0 - near**2) * (tail**2 / (tail**2 + square)) ** dimension
        sums.append((area * share, value))
    expected = sum((share * value).sum(1) for share, value in sums) / sum(share.sum(1) for share, _ in sums)
    assert points > 50 and groups > 4 and len(jump) > 20
    np.testing.assert_allclose(jump, expected, rtol=1e-9)


@pytest.mark.thorough
@pytest.mark.parametrize("dimension", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_force_of_the_jump_is_its_gradient_and_no_thin_shell(dimension):
    """grad M by central differences; and M of a heavy drop, whose weight tilts it, changes over the whole drop.

    Were it flat from four spacings off the interface on, the center would not feel the tilt at all, and the shell the
    more; across the drop M then changes by the weight, that is by one over its diameter times |b|.
    """
    radius = 8.0 * SPACING
    solver = cavities.build(
        cavities.cavity("circle", 12.0 * SPACING, dimension), liquids=(LIQUIDS[0], Liquid("heavy", 1200.0, 0.1)),
        phase=lambda x: np.linalg.norm(x, axis=1) < radius,
        effects=(cavities.parameters("interface_tension", coefficient=TENSION), cavities.parameters("gravity")))
    solver.prepare_output()
    tension = next(effect for effect in solver.effects if effect.name == "interface_tension")
    position, jump_force, weight = cavities.read(solver, "position", "jump_force", "jump_weight")
    gradient, step = np.empty_like(position), 1e-6 * SPACING
    for axis in range(dimension):
        ends = []
        for sign in (1.0, -1.0):
            solver.particles.from_numpy("position", position + sign * step * np.eye(dimension)[axis])
            tension._extend()
            ends.append(cavities.read(solver, "jump")[0])
        gradient[:, axis] = (ends[0] - ends[1]) / (2.0 * step)
    body = tension.body_force.to_numpy()
    inside = weight > 0.5
    scale = np.linalg.norm(body)
    np.testing.assert_allclose(gradient[inside], (jump_force - body)[inside], rtol=0.0, atol=1e-4 * scale)
    core = np.linalg.norm(position, axis=1) < 2.0 * SPACING
    assert 0.3 < -(gradient[core] @ body).mean() / scale**2 < 2.0


@pytest.mark.parametrize("dimension", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_tension_leaves_a_small_drop_its_buoyancy(dimension):
    """The sum of the tension over a drop is zero: an interface drawn in, or M flattened, would take from its buoyancy.

    From a drop of four spacings it took 8.9 % in 2D and 11.9 % in 3D; now 0.6 % and 0.4 %. The tension is weak against
    the buoyancy (Bond 10), so that the noise of the curvature does not count.
    """
    radius, difference = 4.0 * SPACING, 35.0
    weak = difference * 9.81 * radius**2 / 10.0
    solver = cavities.build(
        cavities.cavity("circle", 8.0 * SPACING, dimension), phase=lambda x: np.linalg.norm(x, axis=1) < radius,
        liquids=(LIQUIDS[0], Liquid("light", 1000.0 - difference, 0.1)),
        effects=(cavities.parameters("interface_tension", coefficient=weak), cavities.parameters("gravity")))
    solver.prepare_output()
    force, weight, volume, phase = cavities.read(solver, "jump_force", "jump_weight", "volume", "phase")
    buoyancy = difference * 9.81 * volume[phase == 1].sum()
    assert np.linalg.norm(((volume * weight)[:, None] * force).sum(axis=0)) < 0.01 * buoyancy


@pytest.mark.thorough
def test_a_drop_of_one_particle_rises(circle):
    """Smaller than the level set can see: it has its buoyancy, 0.34 m/s2, as without tension (2.4 mm in 0.3 s)."""
    effects = (cavities.parameters("gravity"), cavities.parameters("interface_tension", coefficient=0.04))
    solver = cavities.build(circle, effects=effects, liquids=[Liquid("a", 1005.0, 0.0), Liquid("b", 970.0, 0.0)],
                            phase=lambda x: np.arange(len(x)) == np.argmin((x**2).sum(axis=1)))

    def height() -> float:
        return float(solver.particles.to_numpy("position")[solver.particles.to_numpy("phase") == 1][0, 1])
    start = height()
    cavities.run(solver, 0.3)
    assert 1e-3 < height() - start < 5e-3


@pytest.mark.thorough
def test_nothing_looks_like_an_interface_far_from_it(circle):
    """At first nodes at the wall that no particle is next to have to take the side of the liquid around."""
    height = 0.3 * cavities.RADIUS
    solver = with_tension(circle, 60.0, lambda x: x[:, 1] > height)
    solver.prepare_output()
    effect = next(effect for effect in solver.effects if effect.name == "interface_tension")
    point = effect.point.to_numpy()[: effect.point_count[None]]
    assert len(point) > 20 and np.abs(point[:, 1] - height).max() < SPACING


def test_interface_of_a_mixture_lies_where_its_fractions_are_equal(circle):
    """And nothing else is an interface: the fractions change over the whole cavity, a tenth every two spacings."""
    slope = 0.05 / SPACING
    effects = (cavities.parameters("interface_tension", coefficient=TENSION, contact_angle=0.5 * np.pi),
               cavities.parameters("diffusion", coefficient=1e-12))
    solver = cavities.build(circle, effects=effects, liquids=LIQUIDS)
    (position,) = cavities.read(solver, "position")
    second = np.clip(0.5 + slope * position[:, 1], 0.0, 1.0)
    solver.particles.from_numpy("volume_fraction", np.stack([1.0 - second, second], axis=1))
    solver.prepare_output()
    effect = next(effect for effect in solver.effects if effect.name == "interface_tension")
    point = effect.point.to_numpy()[: effect.point_count[None]]
    across = 1.5 * cavities.RADIUS / solver.distance.cell  # crossings of the edges along one axis
    assert len(point) > across and np.abs(point[:, 1]).max() < 0.5 * SPACING
    node = np.flatnonzero(effect.level_set.weight.to_numpy())
    height = solver.distance.origin_numpy[1] + node % solver.distance.shape[1] * solver.distance.cell
    reach = solver.search.kernel.support_radius + SPLAT_RADIUS * SPACING
    assert reach < 0.5 * cavities.RADIUS and np.abs(height).max() < reach


@pytest.fixture
def level_set():
    """Return the level set of a sphere that is half full of oil after its first step, and the solver."""
    solver = with_tension(cavities.cavity("circle", 6.0 * SPACING, 3), 30.0, lambda x: x[:, 1] > 0.0)
    solver.step()
    return next(effect for effect in solver.effects if effect.name == "interface_tension").level_set, solver


@pytest.mark.thorough
def test_nodes_behind_the_wall_do_not_depend_on_their_order(level_set):
    """Their images lie between each other; with a thread each, what one reads must not depend on who was first."""
    level_set, _ = level_set
    start = np.random.default_rng(0).normal(size=level_set.phi.shape[0])

    def values() -> np.ndarray:
        level_set.phi.from_numpy(start)
        level_set.phi_next.from_numpy(start)
        level_set._smooth(level_set.phi, level_set.phi_next)
        return level_set.phi_next.to_numpy()

    forward = values()
    active = level_set.active_ghost.to_numpy()
    count = level_set.shallow_count[None]
    active[:count] = active[:count][::-1].copy()
    level_set.active_ghost.from_numpy(active)
    assert count > 50 and np.count_nonzero(forward != start) > count
    assert np.array_equal(values(), forward)


@pytest.mark.thorough
def test_sums_at_the_nodes_are_those_of_all_particles_in_reach(level_set):
    """Whatever column of cells they lie in: the weights of a lattice of nodes against a sum over all particles."""
    level_set, solver = level_set
    level_set._mark(0)
    level_set._sum_at_nodes()
    grid = solver.distance
    node = np.stack(np.unravel_index(np.arange(grid.size), grid.shape), axis=-1)
    place = grid.origin_numpy + node * grid.cell
    (position,) = cavities.read(solver, "position")
    mixed = level_set.mixed.to_numpy()[: len(position)] == 1
    wall = level_set.wall_color.to_numpy()[: solver.walls.count] >= 0.0
    expected = np.zeros(grid.size)
    for x in np.concatenate([position[mixed], solver.walls.position.to_numpy()[wall]]):
        q = np.linalg.norm(place - x, axis=1) / (SPLAT_RADIUS * SPACING)
        expected += np.where(q < 1.0, (1.0 - np.minimum(q, 1.0)) ** 4 * (4.0 * q + 1.0), 0.0)
    assert mixed.sum() > 100 and wall.sum() > 10
    np.testing.assert_allclose(level_set.weight.to_numpy(), expected, rtol=0.0, atol=1e-9)


def limit(viscosities=(1e-3, 0.97), effect="viscosity_implicit", spacing=0.4e-3) -> tuple[float, float]:
    """Return the step that tension allows between liquids of these viscosities, and that without viscosity, s."""
    tension = cavities.parameters("interface_tension", coefficient=TENSION)
    settings = Settings(
        3, tuple(Liquid(str(mu), 1000.0, mu) for mu in viscosities), Numerics(particle_spacing=spacing),
        (tension, *([cavities.parameters(effect)] if effect else [])))
    found = REGISTRY["interface_tension"].time_step_limit(tension, settings)
    return found, np.sqrt(2000.0 * spacing**3 / (4.0 * np.pi * TENSION))


def test_implicit_viscosity_allows_larger_steps_of_the_tension():
    """Where it damps the shortest wave, and nowhere else; never beyond the limit of stability of that wave."""
    for effect in (None, "viscosity"):
        found, capillary = limit(effect=effect)
        assert found == pytest.approx(capillary)
    found, capillary = limit((1e-3, 1e-3))  # waves between water-like liquids are hardly damped
    assert capillary < found < 1.02 * capillary
    found, capillary = limit()
    assert 2.0 * capillary < found
    # Damping implicit, force explicit: (omega dt)^2 <= 4 + 4 mu k^2 dt / rho.
    wave_number, density, viscosity = np.pi / 0.4e-3, 2000.0, 0.971
    squared = TENSION * wave_number**3 / density
    assert squared * found**2 < 4.0 + 4.0 * viscosity * wave_number**2 / density * found


@pytest.mark.thorough
def test_a_viscous_drop_comes_to_rest_in_steps_larger_than_those_without_viscosity():
    """As in small steps all the way, and it keeps the pressure jump of Laplace: rough labels of the start smooth out.

    In steps of 5.6, 2 and 0.5 ms the speeds are 4.0e-4, 4.2e-4 and 4.2e-4 m/s after 0.1 s, 1.28e-4, 1.34e-4 and 1.43e-4
    m/s at the end: it comes to rest up to a tenth faster.
    """
    liquids = (Liquid("aqueous", 1000.0, 1e-3), Liquid("oil", 1000.0, 1.0))
    effects = (cavities.parameters("interface_tension", coefficient=TENSION), cavities.parameters("viscosity_implicit"))

    solver = cavities.build(
        cavities.cavity("circle", 11.0 * SPACING), effects=effects, liquids=liquids, pressure_tolerance=5e-5,
        phase=lambda x: np.linalg.norm(x, axis=1) < CIRCLE_DROP, maximum_time_step=8e-3)
    start = solver.state()

    def run(step: float):
        return np.transpose(cavities.run_in_steps(
            solver, step, 0.8, lambda solver: (solver.time, cavities.root_mean_square_speed(solver))))

    time, speed = run(8e-3)
    assert solver.step_count < 0.8 / (1.7 * limit(spacing=SPACING)[1])
    jump, radius = pressure_jump(solver.snapshot())
    assert jump == pytest.approx(TENSION / radius, rel=0.03)
    solver.restore(start)
    fine_time, fine_speed = run(2e-3)
    for at, error in ((0.05, 0.1), (0.1, 0.1), (0.2, 0.05), (0.4, 0.05), (0.8, 0.055)):
        assert np.interp(at, time, speed) == pytest.approx(np.interp(at, fine_time, fine_speed), rel=error)
    assert speed[-1] == pytest.approx(1.43e-4, rel=0.11)
    falling = speed[speed.argmax():]
    assert falling[-1] < 0.4 * falling[0] and (np.diff(speed[-30:]) < 0.0).all()


@pytest.mark.thorough
def test_contact_angle_is_read_when_kernels_run():
    arrays = cavities.cavity("box", BOX)

    def built(angle: float):
        return with_tension(arrays, angle, lambda x: x[:, 0] < 0.0)

    def after_a_step(solver) -> dict:
        solver.step()
        return solver.state()

    changed = built(90.0)
    start = changed.state()
    neutral = after_a_step(changed)
    changed.restore(start)
    next(e for e in changed.effects if e.name == "interface_tension").level_set.set_contact_angle(np.radians(60.0))
    wetting = after_a_step(changed)
    expected = after_a_step(cavities.anew(built, 60.0))
    for name, values in expected.items():
        np.testing.assert_array_equal(wetting[name], values, err_msg=name)
    assert not np.array_equal(neutral["particles.velocity"], wetting["particles.velocity"])


def level_interface(contact_angle):
    """Points, areas and curvatures of an interface that is level when time starts."""
    solver = with_tension(cavities.cavity("box", (24.0 * SPACING, 20.0 * SPACING)), contact_angle,
                          lambda x: x[:, 1] > 0.0)
    solver.prepare_output()
    (tension,) = (effect for effect in solver.effects if effect.name == "interface_tension")
    tension._find_points()  # M as it is read off, before twicing
    number = tension.point_count[None]
    return (tension.point.to_numpy()[:number], tension.point_area.to_numpy()[:number],
            tension.point_jump.to_numpy()[:number] / TENSION)


@pytest.mark.parametrize("contact_angle", [40.0, 120.0])
def test_level_interface_turns_by_all_of_the_contact_angle_at_either_wall(contact_angle):
    """Young: along a level interface the curvature adds up to cos(theta) at each wall, the pull of tension on it."""
    point, area, curvature = level_interface(contact_angle)
    for side in (point[:, 0] < 0.0, point[:, 0] > 0.0):
        # Measured 0.964 and 0.988 of it; with the angle given at the nearest nodes only 0.89 and 0.95.
        assert (area * curvature)[side].sum() == pytest.approx(np.cos(np.radians(contact_angle)), rel=0.04)


def test_a_level_interface_is_as_long_as_the_box_is_wide():
    """Where walls lie on nodes of the grid, an edge for each crossing would be one too many, or too few: 2 % here."""
    _, area, _ = level_interface(90.0)
    assert area.sum() == pytest.approx(24.0 * SPACING, rel=1e-3)


@pytest.mark.parametrize("contact_angle", [40.0, 140.0])
def test_level_set_slopes_at_the_wall_as_the_contact_angle_asks(contact_angle):
    """Where the interface meets the wall it has climbed, or sunk, before anything moves: a wedge is thinner than a
    particle, and its color alone would put the line where the wedge is a spacing thick.
    """
    point, *_ = level_interface(contact_angle)
    at_wall = point[np.argsort(np.abs(point[:, 0]))[-2:], 1] / SPACING
    # Measured 0.45. Level away from the wall, where the color tells.
    assert np.sign(np.cos(np.radians(contact_angle))) * at_wall.mean() > 0.3
    assert np.abs(point[np.abs(point[:, 0]) < 8.0 * SPACING, 1]).max() < 0.05 * SPACING
