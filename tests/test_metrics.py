"""Metrics agree with closed forms, and each becomes a column, a plot and a row of the report."""
import numpy as np
import pytest

from pipeline import metrics
from pipeline.coverage import WallContact
from pipeline.errors import UserError
from pipeline.frames import FrameData, frame_path, write_frame
from pipeline.measured import Measured
from pipeline.metrics_table import columns_by_metric, read_table
from pipeline.scene_model import Material, Output, Scene
from pipeline.shapes import shape_arrays
from sim.settings import Numerics

RADIUS = 0.011
SPACING = 8e-4
AQUEOUS = Material("aqueous", density=1005.0, dynamic_viscosity=7e-4)
OIL = Material("oil", density=970.0, dynamic_viscosity=1.0)
GRAVITY = np.array([0.0, -9.81, 0.0])


@pytest.fixture(scope="module")
def sphere():
    return shape_arrays("sphere", RADIUS, SPACING, dimension=3)


def make_scene(dimension=3):
    return Scene(name="demo", accuracy="draft", liquids=(AQUEOUS, OIL), numerics=Numerics(SPACING),
                 output=Output(duration=1.0), dimension=dimension, title="Demonstration", description="Oil & water.")


def make_state(initial, oil, *, velocity=0.0, position=None, statistics=None, time=0.0):
    """Return the state of a cavity in which ``oil`` (n,) is the volume fraction of the oil."""
    position = initial["fluid_position"] if position is None else position
    count, dimension = position.shape
    fraction = np.stack([1.0 - oil, oil], axis=-1).astype(float)
    frame = FrameData(
        position=position, id=np.arange(count), phase=fraction.argmax(axis=1),
        velocity=np.tile([velocity, 0.0, 0.0], (count, 1)), pressure=np.zeros(count),
        volume=initial["fluid_volume"][:count], volume_fraction=fraction, compression_rate=np.zeros(count), time=time,
        step=3, gravity=GRAVITY, particle_spacing=SPACING, scene="demo", liquids=("aqueous", "oil"),
        statistics={"time_step": 1e-3} if statistics is None else statistics)
    return Measured(make_scene(dimension), initial, frame)


def values(state):
    return {column: number for one in metrics.METRICS for column, number in one.columns(state).items()}


def level_of_fill(fill):
    """Return the height y / R of the plane below a share ``fill`` of a sphere."""
    height = np.linspace(-1, 1, 20001)
    return np.interp(fill, ((1 - height) ** 2 * (2 + height) / 4)[::-1], height[::-1])


@pytest.mark.parametrize("fill", [0.5, 0.85, 0.95])
def test_level_oil_in_a_sphere_covers_what_geometry_says(sphere, fill):
    level = level_of_fill(fill)
    found = values(make_state(sphere, sphere["fluid_position"][:, 1] > level * RADIUS))
    band = found["wall_coverage_band [%]"]
    assert found["fill [%]"] == pytest.approx(100 * fill, abs=2)
    assert found["wall_coverage [%]"] == pytest.approx(50 * (1 - level), abs=0.5 * band + 1)
    assert 2 < band < 20
    # One point of the wall is 4 degrees here, and there are two ends.
    assert found["contact_arc [deg]"] == pytest.approx(360 - 2 * np.degrees(np.arccos(-level)), abs=9)
    assert found["retina_coverage_superior [%]"] == 100


@pytest.mark.parametrize(("oil", "covered"), [(0.0, 0.0), (1.0, 100.0)])
def test_full_and_empty_eye(sphere, oil, covered):
    found = values(make_state(sphere, np.full(len(sphere["fluid_position"]), oil)))
    names = ("wall_coverage", "retina_coverage_whole", "retina_coverage_inferior", "retina_coverage_macula", "fill")
    assert all(found[f"{name} [%]"] == pytest.approx(covered) for name in names)
    assert found["contact_arc [deg]"] == pytest.approx(3.6 * covered)
    assert found["wall_coverage_band [%]"] == 0
    assert found["particles_outside [1]"] == 0
    assert found["volume_oil [mL]"] == pytest.approx(covered / 100 * 1e6 * 4 / 3 * np.pi * RADIUS**3)


def test_oil_at_the_back_covers_the_macula(sphere):
    found = values(make_state(sphere, sphere["fluid_position"][:, 2] < -0.9 * RADIUS))
    assert found["retina_coverage_macula [%]"] == 100
    assert found["retina_coverage_superior [%]"] == pytest.approx(found["retina_coverage_inferior [%]"], abs=2)


def test_areas_of_retina_and_macula(sphere):
    state = make_state(sphere, np.zeros(len(sphere["fluid_position"])))
    weight = state.wall.weight
    share = {name: weight[mask].sum() / weight.sum() for name, mask in state.wall.retina_masks().items()}
    assert share["whole"] == pytest.approx((1 - np.cos(np.radians(115))) / 2, abs=0.01)
    # The wall points lie half a spacing behind the surface.
    half_angle = np.arcsin(2.75e-3 / (RADIUS + SPACING / 2))
    assert share["macula"] == pytest.approx((1 - np.cos(half_angle)) / 2, rel=0.15)


def test_wall_far_from_any_fluid_is_not_covered(sphere):
    state = make_state(sphere, np.ones(10), position=1e-4 * np.random.default_rng(0).normal(size=(10, 3)))
    assert values(state)["wall_coverage [%]"] == 0


def test_covered_wall_follows_the_nearest_fluid():
    initial = {"wall_position": np.array([[0.0, 0, 0], [1.0, 0, 0]]), "wall_distance": np.array([0.5, 0.5]),
               "wall_volume": np.array([1.0, 3.0])}
    contact = WallContact.of(initial, np.array([[0.0, 0.6, 0], [0.0, 0.9, 0], [1.0, 0.7, 0]]),
                             np.array([0.6, 0.0, 0.4]), particle_spacing=1.0, support_radius=2.5)
    assert contact.covered.tolist() == [True, False]
    assert contact.covered_share() == 0.25


def test_energies_and_centers(sphere):
    above = sphere["fluid_position"][:, 1] > 0
    found = values(make_state(sphere, above, velocity=0.3))
    half = 2 / 3 * np.pi * RADIUS**3
    assert found["kinetic_energy [J]"] == pytest.approx(0.5 * half * (1005 + 970) * 0.09, rel=0.01)
    assert found["center_of_mass_oil_y [mm]"] == pytest.approx(3 / 8 * RADIUS * 1e3, rel=0.05)
    assert found["center_of_mass_aqueous_y [mm]"] == pytest.approx(-3 / 8 * RADIUS * 1e3, rel=0.05)
    weights = {"oil": 970 * 9.81 * found["volume_oil [mL]"], "aqueous": 1005 * 9.81 * found["volume_aqueous [mL]"]}
    lifted = sum(weight * found[f"center_of_mass_{liquid}_y [mm]"] for liquid, weight in weights.items())
    assert found["potential_energy [J]"] == pytest.approx(1e-9 * lifted)


def test_emulsion_and_volume_fractions(sphere):
    oil = np.zeros(len(sphere["fluid_position"]))
    oil[:100], oil[100:150] = 0.5, 0.97
    found = values(make_state(sphere, oil))
    assert found["emulsified_volume [mL]"] == pytest.approx(1e8 * sphere["fluid_volume"][0])
    assert (found["volume_fraction_smallest [1]"], found["volume_fraction_largest [1]"]) == (0, 0.97)


def test_escaped_and_crowded_particles_are_counted(sphere):
    position = sphere["fluid_position"].copy()
    position[0] = 1.02 * RADIUS, 0, 0
    position[2] = position[1] + [0.25 * SPACING, 0, 0]
    found = values(make_state(sphere, np.zeros(len(position)), position=position))
    assert found["particles_outside [1]"] == 1
    assert found["smallest_spacing [1]"] == pytest.approx(0.25)


def test_growing_particles_are_no_crowd(sphere):
    position = sphere["fluid_position"].copy()
    position[2] = position[1] + [0.25 * SPACING, 0, 0]
    state = make_state(sphere, np.zeros(len(position)), position=position)
    state.frame.volume = state.frame.volume.copy()
    state.frame.volume[2] *= 0.1
    assert values(state)["smallest_spacing [1]"] > 0.5


def test_two_dimensions_have_an_arc_but_no_retina():
    circle = shape_arrays("circle", RADIUS, SPACING, dimension=2)
    found = values(make_state(circle, circle["fluid_position"][:, 1] > 0))
    assert found["contact_arc [deg]"] == pytest.approx(180, abs=9)
    assert np.isnan(found["retina_coverage_macula [%]"])
    assert "center_of_mass_oil_z [mm]" not in found


def test_empty_cavity_gives_no_error(sphere):
    found = values(make_state(sphere, np.zeros(0), position=np.zeros((0, 3))))
    assert found["wall_coverage [%]"] == 0 and np.isnan(found["smallest_spacing [1]"])


def test_columns_belong_to_the_longest_name():
    grouped = columns_by_metric(["frame", "time [s]", "time_step [s]", "wall_coverage [%]", "wall_coverage_band [%]"],
                                metrics.METRICS)
    assert list(grouped["time"]) == ["time [s]"]
    assert list(grouped["wall_coverage"]) == ["wall_coverage [%]"]


@pytest.fixture
def run_folder(tmp_path, sphere):
    """Return an output folder with two segments, as the stages before write it."""
    (tmp_path / "scene.json").write_text(make_scene().to_json())
    np.savez(tmp_path / "initial.npz", **sphere)
    for index, segment in [(0, 0), (1, 0), (2, 1)]:
        state = make_state(sphere, sphere["fluid_position"][:, 1] > 1e-3 * index, time=0.1 * index,
                           statistics={"pressure_iterations": 7.0, "time_step": 1e-3} if index else {})
        write_frame(frame_path(tmp_path / f"segment_{segment:03d}", index), state.frame)
    return tmp_path


def test_command_line_makes_table_plots_and_summary(run_folder):
    metrics.main([*(str(run_folder / name) for name in ("scene.json", "initial.npz", "segment_001", "segment_000")),
                  "--output", str(run_folder / "metrics.csv"), "--summary", str(run_folder / "metrics.html"),
                  "--plots", str(run_folder / "plots")])
    assert "nan" not in (run_folder / "metrics.csv").read_text()
    table = read_table(run_folder / "metrics.csv")
    assert table["frame"].tolist() == [0, 1, 2] and table["time [s]"].tolist() == [0.0, 0.1, 0.2]
    assert np.isnan(table["pressure_iterations [1]"][0]) and table["pressure_iterations [1]"][1] == 7
    assert np.all(np.diff(table["wall_coverage [%]"]) < 0)
    names = {one.name for one in metrics.METRICS}
    assert {path.stem for path in (run_folder / "plots").iterdir()} == names - {"time"}
    page = (run_folder / "metrics.html").read_text()
    assert "Oil &amp; water." in page and all(one.meaning.split("'")[0] in page for one in metrics.METRICS)


@pytest.mark.parametrize("text", ["", "frame,fill\n0,x\n", "frame,fill\n0\n", "fill\n0\n"])
def test_damaged_table_is_named(tmp_path, text):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(UserError, match=r"a.csv: is"):
        read_table(tmp_path / "a.csv")
