"""Bodies of liquid: counts, sizes and places of closed surfaces that are known exactly."""
import numpy as np
import pytest

from pipeline import bodies
from pipeline.base.errors import UserError
from pipeline.scenes.model import Material, Output, Scene
from pipeline.surfaces.contour import contour
from pipeline.surfaces.contour_lines import contour_lines
from pipeline.surfaces.surface_files import to_polydata, write_surface
from sim.settings import Numerics

CELL = 0.25e-3
LIQUIDS = (Material("aqueous", density=1005.0, dynamic_viscosity=7e-4),
           Material("oil", density=970.0, dynamic_viscosity=1.0))


def balls(dimension, *given):
    """Grid (nodes...) of the signed distance, positive inside, of balls (center, radius) in m."""
    axis = np.arange(-40, 41) * CELL
    nodes = np.stack(np.meshgrid(*[axis] * dimension, indexing="ij"), axis=-1)
    return np.max([radius - np.linalg.norm(nodes - np.array(center), axis=-1) for center, radius in given], axis=0)


def mesh_of(field):
    draw = contour if field.ndim == 3 else contour_lines
    return draw(field / CELL, np.full(field.ndim, -40 * CELL), CELL)


def measured(field, depth=1.0):
    surface = to_polydata(mesh_of(field))
    surface.point_data["depth"] = np.full(surface.n_points, depth, np.float32)
    return bodies.bodies_of(surface, 1e-3)


@pytest.mark.parametrize("dimension", [2, 3])
def test_two_balls_are_two_bodies(dimension):
    far, near = (6e-3,) + (0.0,) * (dimension - 1), (-3e-3,) + (1e-3,) * (dimension - 1)
    large, small = measured(balls(dimension, (near, 4e-3), (far, 2e-3)))
    # Facets of the grid cut off less than (cell / radius)^2 of a ball.
    assert large.diameter(dimension) == pytest.approx(8e-3, rel=5e-3)
    assert small.diameter(dimension) == pytest.approx(4e-3, rel=1e-2)
    exact = {2: 2.0 * np.pi * 4e-3, 3: 4.0 * np.pi * 4e-3**2}[dimension]
    assert large.area == pytest.approx(exact, rel=1e-2) and large.interface == pytest.approx(large.area)
    assert large.center[:dimension] == pytest.approx(near, abs=0.05 * CELL)
    assert small.center[:dimension] == pytest.approx(far, abs=0.05 * CELL)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_hollow_is_taken_off_its_body(dimension):
    center = (3e-3,) + (0.0,) * (dimension - 1)
    hollow = balls(dimension, (center, 2e-3))
    solid = balls(dimension, ((0.0,) * dimension, 8e-3), ((-9.2e-3,) * dimension, 0.9e-3))
    found = measured(np.minimum(solid, -hollow))
    assert len(found) == 2
    ball = {2: lambda r: np.pi * r**2, 3: lambda r: 4.0 / 3.0 * np.pi * r**3}[dimension]
    assert found[0].volume == pytest.approx(ball(8e-3) - ball(2e-3), rel=5e-3)
    assert found[0].center[0] == pytest.approx(-3e-3 * ball(2e-3) / (ball(8e-3) - ball(2e-3)), rel=0.03)


def test_nothing_is_no_body_and_the_wall_is_no_interface():
    assert measured(np.full((81, 81, 81), -1.0)) == []
    (ball,) = measured(balls(3, ((0.0, 0.0, 0.0), 5e-3)), depth=0.0)
    assert ball.interface == 0.0 < ball.area


@pytest.fixture
def run_folder(tmp_path):
    """Return the surfaces of two frames: one ball of oil, then two, as the reconstruct stage writes them."""
    scene = Scene(name="demo", accuracy="draft", liquids=LIQUIDS, numerics=Numerics(1e-3), output=Output(duration=1.0))
    (tmp_path / "scene.json").write_text(scene.to_json())
    drops = [((-4e-3, 0.0, 0.0), 3e-3), ((5e-3, 0.0, 0.0), 2e-3)]
    for index in range(2):
        folder = tmp_path / f"part_{index:03d}"
        folder.mkdir()
        oil = mesh_of(balls(3, *drops[:index + 1]))
        for name, mesh in (("oil", oil), ("aqueous", mesh_of(np.full((81, 81, 81), -1.0)))):
            write_surface(folder / f"frame_{index:05d}_{name}.vtp", mesh, time=0.1 * index, liquid=name,
                          depth=np.ones(len(mesh.points)))
        (folder / f"frame_{index:05d}.json").write_text(f'{{"time": {0.1 * index}}}')
    return tmp_path


def test_command_line_makes_table_and_plot(run_folder):
    bodies.main([str(run_folder / name) for name in ("scene.json", "part_001", "part_000")]
                + ["--output", str(run_folder / "bodies.csv"), "--plot", str(run_folder / "bodies.png")])
    header, *rows = (run_folder / "bodies.csv").read_text().splitlines()
    assert header == ",".join(bodies.COLUMNS)
    cells = [row.split(",") for row in rows]
    assert [(cell[0], cell[1], cell[2], cell[3]) for cell in cells] == [
        ("0", "0", "oil", "0"), ("1", "0.1", "oil", "0"), ("1", "0.1", "oil", "1")]
    assert [float(cell[5]) for cell in cells] == pytest.approx([6.0, 6.0, 4.0], rel=0.01)
    assert (run_folder / "bodies.png").stat().st_size > 10_000


def test_a_folder_without_surfaces_is_named(tmp_path):
    (tmp_path / "scene.json").write_text(Scene(name="demo", accuracy="draft", liquids=LIQUIDS, numerics=Numerics(1e-3),
                                               output=Output(duration=1.0)).to_json())
    with pytest.raises(UserError, match="no surfaces there"):
        bodies.main([str(tmp_path / "scene.json"), str(tmp_path), "--output", str(tmp_path / "bodies.csv")])


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", '{"time": null}'])
def test_damaged_numbers_of_a_frame_are_named(run_folder, text):
    numbers = run_folder / "part_001" / "frame_00001.json"
    numbers.write_text(text)
    with pytest.raises(UserError, match=f"{numbers}: does not hold the numbers of a frame's surfaces"):
        bodies.main([str(run_folder / name) for name in ("scene.json", "part_000", "part_001")]
                    + ["--output", str(run_folder / "bodies.csv")])


def test_table_is_in_the_units_of_its_heads(run_folder):
    """A ball of 3 mm, all of which lies at the wall, then the same one amid the cavity."""
    oil = mesh_of(balls(3, ((-4e-3, 1e-3, 2e-3), 3e-3)))
    write_surface(run_folder / "part_000" / "frame_00000_oil.vtp", oil, time=0.0, liquid="oil",
                  depth=np.zeros(len(oil.points)))
    bodies.main([str(run_folder / name) for name in ("scene.json", "part_000", "part_001")]
                + ["--output", str(run_folder / "bodies.csv")])
    header, *rows = (run_folder / "bodies.csv").read_text().splitlines()
    at_wall, free = (dict(zip(header.split(","), row.split(","), strict=True)) for row in rows[:2])
    exact = {"volume [mL]": 0.036 * np.pi, "area [cm2]": 0.36 * np.pi}
    for name, value in exact.items():
        assert float(at_wall[name]) == pytest.approx(value, rel=0.01) == float(free[name])
    assert float(at_wall["interface [cm2]"]) == 0.0 and free["interface [cm2]"] == free["area [cm2]"]
    assert [float(at_wall[f"{axis} [mm]"]) for axis in "xyz"] == pytest.approx([-4.0, 1.0, 2.0], abs=0.02)
