"""Pictures show the right colors, translucency is right, and missing OpenGL ends in one sentence."""
import dataclasses
import itertools
import os
import re
import subprocess
import sys
import time

import imageio_ffmpeg
import numpy as np
import pytest
from conftest import ROOT
from helpers import color_vision, forked
from helpers.cases import thorough
from helpers.synthetic_frames import RADIUS, ball, frame_of, lattice, oil_fraction
from PIL import Image

from pipeline import movie, render
from pipeline.base import cli, palette
from pipeline.base.errors import UserError
from pipeline.base.frame_files import frame_path, read_frame, write_frame
from pipeline.base.vtk_files import write_vtk
from pipeline.cavity.initial_state import save_initial
from pipeline.measures.film_course import FilmCourse
from pipeline.measures.frame_view import Measured
from pipeline.measures.wall_map import WallMapper
from pipeline.pictures import opengl
from pipeline.pictures.anterior_segment import anterior_segment
from pipeline.pictures.container_view import peel
from pipeline.pictures.eye_layout import columns_of
from pipeline.pictures.eye_view import NERVE_COLOR, EyeView, painted
from pipeline.pictures.fundus_map import Coverage, FundusMap
from pipeline.pictures.marks import INK, clock
from pipeline.pictures.paint import OF_GAS, OF_OIL
from pipeline.pictures.section_panel import (
    CAPSULE,
    CHAMBER,
    CILIARY,
    CORNEA,
    IRIS,
    LENS,
    ZONULE,
    SectionPanel,
    posture,
)
from pipeline.pictures.slice_panel import CHOROID, RETINA, SCLERA, WALL, Fields
from pipeline.reconstruct import Wall, write_surfaces
from pipeline.scenes.load import load_resolved, load_scene
from pipeline.scenes.model import Eye
from pipeline.scenes.yaml_files import read_yaml
from pipeline.surfaces.liquid_surface import Reconstructor
from pipeline.surfaces.surface_files import read_retina, read_surface, read_wall, write_wall

SIZE = (640, 360)
BARE, COVERED, FILM = OF_OIL.bare, OF_OIL.covered, OF_OIL.film
AXIS = 0.25e-3 * np.arange(-56, 57)
BALL = Fields(np.hypot(*np.meshgrid(AXIS, AXIS)) - RADIUS, AXIS[[0, 0]], 0.25e-3, np.zeros((113, 113)))
CONTENTS = {                    # fraction of oil of the particles, and its fraction above and below the middle
    "water": ({"height": 1.0}, (0.0, 0.0)),
    "tamponade": ({"height": 0.0}, (1.0, 0.0)),
    "emulsion": ({"height": 0.0, "layer": 40e-3}, (0.625, 0.375)),
}


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory, request, taichi):
    """Return a folder with scene, eye, frames and surfaces of every entry of ``CONTENTS``."""
    import pyvista

    folder = tmp_path_factory.mktemp("render")
    root = request.config.rootpath
    scene = load_scene(root / "config" / "scenes" / "tiny.yaml", accuracy="draft")
    scene = dataclasses.replace(scene, output=dataclasses.replace(scene.output, image_size=SIZE), label="not to scale",
                                eye=dataclasses.replace(scene.eye, lens="aphakic"))
    (folder / "scene.json").write_text(scene.to_json())
    save_initial(folder / "initial.npz", ball())
    eye = pyvista.Icosphere(radius=RADIUS, nsub=4)
    write_vtk(eye, folder / "eye.vtp")
    position = lattice()
    reconstructor = Reconstructor(ball(), 2)
    (folder / "surfaces").mkdir()
    for index, (options, _) in enumerate(CONTENTS.values()):
        frame = frame_of(position, oil_fraction(position, **options), time=0.1 * index)
        path = frame_path(folder / "frames", index)
        write_frame(path, frame)
        wall = Wall(scene, ball(), eye)  # no frame follows from another one: where oil is it touches
        write_surfaces(folder / "surfaces", path, frame, reconstructor, wall=wall)
    return folder


def draw(folder, output, *options):
    names = ("scene.json", "initial.npz", "eye.vtp", "frames", "surfaces")
    render.main([*(str(folder / name) for name in names), "--output", str(output), *options])
    return [np.asarray(Image.open(path).convert("RGB")).astype(int) for path in sorted(output.iterdir())]


def count(pixels, color, tolerance=12):
    return int((np.abs(pixels - np.array(color)).max(axis=-1) <= tolerance).sum())


def rgb(text):
    return [int(text[k:k + 2], 16) for k in (1, 3, 5)]


def assert_section(pixels, fractions):
    """The halves of the cavity above and below its middle have the colors of their fractions."""
    height = pixels.shape[0]
    center = round(0.27 * height)
    for row, fraction in zip((0.40, 0.58), fractions, strict=True):
        found = pixels[round(row * height), center]
        shades = [k for k in range(256) if np.abs(OF_OIL.colors[k].astype(int) - found).max() <= 3]
        assert shades and abs(np.mean(shades) / 255 - fraction) < 0.06


def test_sections_need_no_opengl(run_folder, tmp_path, monkeypatch):
    monkeypatch.setattr(opengl, "works", lambda window: pytest.fail("OpenGL was asked for"))
    pictures = draw(run_folder, tmp_path / "images", "--section-only")
    for pixels, (_, fractions) in zip(pictures, CONTENTS.values(), strict=True):
        assert pixels.shape == (SIZE[1], SIZE[0], 3)
        assert_section(pixels[:, :SIZE[0] // 2], fractions)
    middle = slice(round(0.27 * SIZE[1]) - 40, round(0.27 * SIZE[1]) + 40)
    ink = [count(pixels[120:220, middle], INK, 50) for pixels in pictures]
    assert ink[0] == 0 and ink[1] > 30 and ink[2] > 30          # the interface is drawn where there is one
    assert count(pictures[0], (176, 52, 24), 40) > 20           # the scene's label


@pytest.mark.thorough
def test_pictures_show_section_opened_eye_and_fundus(run_folder, tmp_path, opengl):
    pictures = draw(run_folder, tmp_path / "images")
    assert all(pixels.shape == (SIZE[1], SIZE[0], 3) for pixels in pictures)
    water, tamponade, _ = pictures
    ends = columns_of(SIZE[0])
    section, halves, fundus = (slice(left, right) for left, right in itertools.pairwise(ends))
    assert_section(tamponade[:, section], (1.0, 0.0))
    body = slice(80, 310)
    ivory = [count(pixels[body, halves], COVERED, 40) for pixels in (water, tamponade)]
    assert ivory[1] > 5 * ivory[0]      # the nerve is nearly ivory too
    for pixels, least in ((water, 0), (tamponade, 3000)):
        assert least <= count(pixels[body, fundus], COVERED, 4) <= 4 * least
        assert count(pixels[body, fundus], BARE, 4) > 3000
    half = round(0.5 * (fundus.start + fundus.stop))
    upper, lower = tamponade[110:170, half], tamponade[230:280, half]
    assert count(upper, COVERED, 4) > 40 and count(lower, BARE, 4) > 30
    for color in (COVERED, BARE):
        assert count(tamponade[315:], color) > 20       # the legend


def wall_of(folder, initial, position, fraction, contact_angle=False):
    """Write the wall of a frame of oil in the ball; return it (pyvista.PolyData), its contact, and its map."""
    import pyvista

    scene = load_resolved(folder / "scene.json")
    if not contact_angle:
        scene = dataclasses.replace(scene, effects={})
    contact = Measured(scene, initial, frame_of(position, fraction)).wall
    eye = pyvista.Icosphere(radius=RADIUS, nsub=5)
    found = WallMapper(eye.points, eye.regular_faces).map(contact)
    write_wall(folder / "wall.vtp", eye, found.contact_distance, found.oil_fraction, time=0.0)
    return read_wall(folder / "wall.vtp"), contact, found


@pytest.mark.thorough
@pytest.mark.parametrize("height", [-6e-3, 0.0, 5e-3])
@pytest.mark.parametrize("tilt", [0.0, 1.0])
@pytest.mark.parametrize("contact_angle", [False, True])
def test_fundus_map_shows_the_share_that_is_measured(run_folder, tmp_path, height, tilt, contact_angle):
    """And does so by itself: what is left for the even shift of its edge is less than half a particle.

    Without a contact angle both are the share of the plane, to the ring of half a particle that labels leave open.
    """
    (tmp_path / "scene.json").write_text((run_folder / "scene.json").read_text())
    position = lattice(seed=3)
    wall, contact, found = wall_of(tmp_path, ball(), position, oil_fraction(position, height=height, tilt=tilt),
                                   contact_angle)
    assert abs(found.moved) < 0.5 * contact.particle_spacing
    chart = FundusMap(np.asarray(wall.points), (400, 400))
    drawn, measured = chart.share(wall["contact_distance"]), contact.covered_share(contact.retina_masks()["whole"])
    # With an angle the strip that is taken off is wider than a spacing, and so is the rounding of the edge.
    assert abs(drawn - measured) < (0.015 if contact_angle else 0.01)
    directions = np.asarray(wall.points) / RADIUS
    retina = np.arccos(np.clip(-directions[:, 2], -1.0, 1.0)) < np.radians(115.0)
    above = oil_fraction(np.asarray(wall.points), height=height, tilt=tilt) > 0.5
    exact = (above & retina).sum() / retina.sum()
    assert drawn < exact - 0.05 if contact_angle else drawn == pytest.approx(exact, abs=0.03)


@pytest.fixture(scope="module")
def film_folder(tmp_path_factory, run_folder):
    """Return a folder whose frames show oil that comes down the wall at 15 mm/s, and surfaces of the last of them."""
    folder = tmp_path_factory.mktemp("film")
    position = lattice(seed=3)
    for index in range(8):
        fraction = oil_fraction(position, height=8e-3 - 1.5e-3 * index)
        path = frame_path(folder / f"part_{index // 7:03d}", index)
        write_frame(path, frame_of(position, fraction, time=0.1 * index))
    done = forked.run("pipeline.reconstruct", run_folder / "scene.json", run_folder / "initial.npz",
                      folder / "part_001", "--before", folder / "part_000", "--output", folder / "surfaces",
                      "--eye", run_folder / "eye.vtp", "--threads", 1)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.thorough
def test_films_are_drawn_where_they_are_measured(run_folder, film_folder, tmp_path):
    """In the map, whose stripes there are a third as wide as apart, and in words that add up."""
    scene, initial = load_resolved(run_folder / "scene.json"), ball()
    films = FilmCourse.of(scene, float(initial["cavity_volume"]))
    for path in sorted(film_folder.glob("part_*/*.vtu")):
        state = Measured(scene, initial, read_frame(path)).after(films)
    retina = read_retina(film_folder / "surfaces" / "frame_00007.json")["whole"]
    mask = state.wall.retina_masks()["whole"]
    assert retina["film"] == state.film.film_share(mask) > 0.2
    wall = read_wall(film_folder / "surfaces" / "frame_00007_wall.vtp")
    chart = FundusMap(np.asarray(wall.points), (600, 600), captions=False)
    contact, film = (np.asarray(wall.point_data[f"{name}_distance"]) for name in ("contact", "film"))
    assert chart.share(np.minimum(contact, film)) == pytest.approx(retina["film"], abs=0.03)
    pixels = np.asarray(chart.draw(wall, uncertain=0.0)).astype(int)
    light = count(pixels, FILM, 2)
    assert light > 5000
    touched = wall.copy()
    touched["film_distance"] = np.full(wall.n_points, -1.0)
    without = np.asarray(chart.draw(touched, uncertain=0.0)).astype(int)
    assert count(without, FILM, 2) < 0.01 * light
    # Pixels at the edges of stripes are blended: on the average half of each is film.
    lost = (without == COVERED).all(axis=-1) & (np.abs(pixels - COVERED).max(axis=-1) > 2)
    way = FILM.astype(float) - COVERED
    share = np.clip((pixels[lost] - COVERED) @ way / (way @ way), 0.0, 1.0)
    assert share.sum() == pytest.approx(light + 0.5 * (lost.sum() - light), rel=0.1)
    assert str(Coverage(0.519, 0.134, 0.374)) == "52 ± 13 %"
    assert Coverage(0.519, 0.134, 0.374).parts == "touches 14.5 %, on a thin film 37.4 %"


@pytest.mark.thorough
def test_pictures_of_films_have_a_legend_and_lighter_walls(run_folder, film_folder, tmp_path, opengl):
    names = [str(run_folder / name) for name in ("scene.json", "initial.npz", "eye.vtp")]
    frames, surfaces, images = film_folder / "part_001", film_folder / "surfaces", tmp_path / "images"
    render.main([*names, str(frames), str(surfaces), "--output", str(images)])
    pixels = np.asarray(Image.open(images / "frame_00007.png").convert("RGB")).astype(int)
    halves, fundus = (slice(left, right) for left, right in itertools.pairwise(columns_of(SIZE[0])[1:]))
    body = slice(80, 310)
    assert count(pixels[body, fundus], FILM, 6) > 500
    assert count(pixels[315:], FILM, 6) > 20  # the legend
    lit = pixels[body, halves].reshape(-1, 3)
    hue = lit / np.maximum(lit.max(axis=1, keepdims=True), 1)
    assert (np.abs(hue - FILM / FILM.max()).max(axis=1) < 0.04).sum() > 300


@pytest.mark.parametrize("kind", [*color_vision.KINDS, "gray"])
def test_liquids_are_told_apart_and_from_the_tissue_beside_them(kind):
    """By 20 in CIE Lab, and in gray oil from aqueous by 30, films from both by 12."""
    from skimage.color import deltaE_cie76

    colors = {"aqueous": BARE, "oil": COVERED, "film": FILM, "gas": OF_GAS.covered, "film of gas": OF_GAS.film,
              "lens": LENS, "capsule": CAPSULE, "implant": CAPSULE, "retina": RETINA, "ciliary body": CILIARY,
              "mesh": WALL}
    lab = dict(zip(colors, color_vision.seen(np.array(list(colors.values())) / 255.0,
                                             "none" if kind == "gray" else kind), strict=True))

    def apart(one, other):
        return float(deltaE_cie76(lab[one], lab[other]) if kind != "gray" else abs(lab[one][0] - lab[other][0]))

    assert min(apart(liquid, "aqueous") for liquid in ("oil", "gas")) > (30.0 if kind == "gray" else 50.0)
    assert min(apart("film", other) for other in ("oil", "aqueous")) > (12.0 if kind == "gray" else 20.0)
    if kind != "gray":
        assert apart("film of gas", "gas") > 18.0
        for tissue in ("lens", "capsule", "retina", "ciliary body", "mesh"):
            for liquid in ("oil", "aqueous"):
                assert apart(liquid, tissue) > 20.0, (liquid, tissue)
        assert apart("gas", "capsule") > 20.0


def test_colors_of_mixtures_are_at_equal_steps_and_lighter_with_more_oil():
    lab = color_vision.seen(OF_OIL.colors[::15] / 255.0, "none")
    steps = np.linalg.norm(np.diff(lab, axis=0), axis=1)
    assert np.ptp(steps) < 0.2 * steps.mean() and (np.diff(lab[:, 0]) > 0.0).all()
    assert (OF_OIL.of(np.array([0.0, 1.0])) == [palette.rgb(palette.AQUEOUS), palette.rgb(palette.OIL)]).all()


def test_liquids_have_the_colors_of_pictures_elsewhere_too():
    """What other programs show of oil, aqueous and gas has the colors that pictures of an eye have."""
    colors = {name: one["color"] for name, one in read_yaml(ROOT / "config" / "materials.yaml").items()}
    droplets = {name for name in colors if name.endswith("droplets")}
    assert {colors[name] for name in colors if "oil" in name and name not in droplets} == {palette.OIL}
    assert {colors[name] for name in ("aqueous", "s1_water")} == {palette.AQUEOUS} and colors["air"] == palette.GAS


@pytest.mark.thorough
def test_oil_on_the_left_is_right_in_the_fundus_and_in_the_lower_half_of_the_opened_eye(run_folder, tmp_path, opengl):
    """An examiner who faces the patient sees the patient's left on the right; a pocket there is in that half only."""
    import pyvista

    (tmp_path / "scene.json").write_text((run_folder / "scene.json").read_text())
    position = lattice()
    pocket = (np.linalg.norm(position - [0.8 * RADIUS, 0.0, 0.0], axis=1) < 4e-3).astype(float)
    wall, *_ = wall_of(tmp_path, ball(), position, pocket)
    pixels = np.asarray(FundusMap(np.asarray(wall.points), (400, 400), captions=False).draw(wall, uncertain=0.0))
    assert count(pixels[:, :200], COVERED, 4) == 0 < 500 < count(pixels[:, 200:], COVERED, 4)

    (tmp_path / "surfaces").mkdir()
    frame = frame_of(position, pocket)
    path = frame_path(tmp_path / "frames", 0)
    write_frame(path, frame)
    write_surfaces(tmp_path / "surfaces", path, frame, Reconstructor(ball(), 2))
    surface = read_surface(tmp_path / "surfaces" / f"{path.stem}_silicone_oil_1000.vtp")
    view = EyeView(pyvista.read(run_folder / "eye.vtp"), (300, 500))
    picture = view.draw(wall, [(surface, palette.OIL)]).astype(int)
    view.close()
    oil = (picture[..., 0] > picture[..., 2] + 25) & (picture.sum(axis=-1) > 250)       # neither aqueous nor shell
    assert oil[:250].sum() == 0 < 300 < oil[250:].sum()


@pytest.mark.thorough
@pytest.mark.parametrize("kind", color_vision.KINDS)
def test_colors_are_those_of_the_legend_and_told_apart(run_folder, tmp_path, opengl, kind):
    """In every kind of color vision: what is colored is within 15 of a color of the legend or of the drawn tissue."""
    from skimage.color import deltaE_ciede2000

    marked = np.array([BARE, COVERED, *render.MARK_COLORS.values()]) / 255.0
    lab = color_vision.seen(marked, kind)
    assert min(deltaE_ciede2000(one, other) for one, other in itertools.combinations(lab, 2)) > 15.0
    tissue = (SCLERA, CHOROID, RETINA, IRIS, CILIARY, CORNEA, LENS, CAPSULE, CHAMBER, ZONULE)
    lines = [0.5 * (np.array(INK) + color) for color in (BARE, COVERED)]     # dark ones, half over a pixel
    legend = np.vstack([color_vision.seen(OF_OIL.colors[::8] / 255.0, kind), lab, color_vision.seen(
        np.array([FILM, *tissue, rgb(NERVE_COLOR), *lines]) / 255.0, kind)])
    for pixels in draw(run_folder, tmp_path / "images"):
        colors = np.unique(pixels[70:320].reshape(-1, 3), axis=0, return_counts=True)
        chroma = np.hypot(*color_vision.seen(colors[0] / 255.0, "none")[:, 1:].T)
        colored = chroma > 20.0
        place = color_vision.seen(colors[0][colored] / 255.0, kind)
        far = np.min([deltaE_ciede2000(place, one[None]) for one in legend], axis=0) > 15.0
        assert colors[1][colored][far].sum() < 0.01 * colors[1][colored].sum()      # lines are blended at their edges


@pytest.mark.thorough
def test_fundus_of_a_left_eye_has_its_disc_on_the_other_side():
    import pyvista

    vertices = np.asarray(pyvista.Icosphere(radius=RADIUS, nsub=4).points)
    nasal = {right: FundusMap(vertices, (300, 300), right_eye=right).place(np.array([1.0, 0.0, -1.0]))
             for right in (True, False)}
    assert nasal[True][0] == nasal[False][0] > 150      # the patient's left is on the right in both
    right, left = (np.asarray(FundusMap(vertices, (300, 300), right_eye=one, captions=False).draw(
        bare_wall(vertices), uncertain=0.0)).astype(int) for one in (True, False))
    dark = [(pixels[:, columns] < 90).all(axis=-1).sum() for pixels in (right, left)
            for columns in (slice(155, 200), slice(100, 145))]
    assert dark[0] > dark[1] + 10 and dark[3] > dark[2] + 10


def bare_wall(vertices):
    """Return a wall that no oil touches."""
    import pyvista

    wall = pyvista.PolyData(vertices)
    wall["contact_distance"] = np.full(len(vertices), -1.0)
    wall["oil_fraction_covered"], wall["oil_fraction_bare"] = np.ones(len(vertices)), np.zeros(len(vertices))
    return wall


@pytest.mark.parametrize(("time", "means", "words"), [
    (1.5, None, "t = 1.50 s"), (1.5, 2419200.0, "week 6.0"), (2.0, 86400.0, "day 2.0"), (2.0, 10.0, "t = 20.00 s")])
def test_clock_shows_what_a_second_stands_for(time, means, words):
    assert clock(time, means) == words


@pytest.mark.thorough
@pytest.mark.parametrize("order", [("red", "blue"), ("blue", "red")])
def test_translucent_colors_do_not_depend_on_the_order_of_drawing(opengl, order):
    import pyvista

    from pipeline.pictures.opengl import use_working_opengl

    use_working_opengl()
    plotter = pyvista.Plotter(off_screen=True, window_size=(64, 64))
    plotter.set_background("white")
    distance = {"red": 1.0, "blue": 0.0}
    for color in order:
        plotter.add_mesh(pyvista.Plane(center=(0, 0, distance[color])), color=color, opacity=0.5, lighting=False)
    plotter.view_xy()
    peel(plotter)
    pixel = plotter.screenshot(None, return_img=True)[32, 32].astype(int)
    plotter.close()
    assert np.abs(pixel - [191, 64, 127]).max() <= 3     # half red over half blue over white


def test_missing_surfaces_are_named(run_folder, tmp_path):
    (tmp_path / "surfaces").mkdir()
    arguments = [str(run_folder / name) for name in ("scene.json", "initial.npz", "eye.vtp", "frames")]
    with pytest.raises(UserError, match="run the reconstruct stage"):
        render.main([*arguments, str(tmp_path / "surfaces"), "--output", str(tmp_path / "images"), "--section-only"])
    assert not (tmp_path / "images").exists()


def test_posture_is_named_by_gravity():
    assert posture(np.array([0, -9.81, 0])) == "upright"
    assert posture(np.array([0, 0, -9.81])) == "supine"
    assert posture(np.array([0, 0, 9.81])) == "prone"
    assert posture(np.array([9.81, 0, 0])) == "lying on the left side"
    assert posture(np.array([0, -1.0, -1.0])) == "between postures"
    assert posture(np.zeros(3)) == ""


@pytest.mark.parametrize("probe", ["import os; os.abort()", "raise SystemExit(3)"])
def test_missing_opengl_ends_in_one_sentence(monkeypatch, capsys, probe):
    monkeypatch.setattr(opengl, "PROBE", probe)
    with pytest.raises(SystemExit) as stop:
        cli.run(lambda: opengl.main([]))
    printed = capsys.readouterr()
    assert stop.value.code != 0 and printed.out == ""
    line, = printed.err.splitlines()
    assert "apt-get install --no-install-recommends libosmesa6" in line


def test_preflight_takes_the_first_that_works(monkeypatch):
    monkeypatch.setattr(opengl, "works", lambda window: window == "vtkOSOpenGLRenderWindow")
    monkeypatch.setenv(opengl.VARIABLE, "vtkEGLRenderWindow")
    assert opengl.use_working_opengl() == "OSMesa"
    assert opengl.os.environ[opengl.VARIABLE] == "vtkOSOpenGLRenderWindow"
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(opengl, "works", lambda window: True)
    assert opengl.find_working_opengl() == "OSMesa"      # a choice of the environment comes first
    monkeypatch.delenv(opengl.VARIABLE)
    assert opengl.use_working_opengl() == "EGL" and "DISPLAY" not in opengl.os.environ


def test_a_window_in_place_of_another_does_not_count():
    assert not opengl.works("vtkNoRenderWindow")
    assert opengl.works(opengl.WINDOWS[opengl.find_working_opengl()])


@pytest.mark.parametrize("display", ["10.255.255.1:0", thorough(":99"), thorough("nonsense")])
def test_no_display_is_asked_for(tmp_path, opengl, display):
    """One of an old session, which does not answer, costs no time and no word."""
    code = ("import numpy as np\nfrom pipeline.pictures.opengl import off_screen\n"
            "window = off_screen(window_size=(16, 16))\nwindow.set_background('red')\n"
            "assert (window.screenshot(None, return_img=True)[8, 8] == [255, 0, 0]).all()\nwindow.close()")
    begin = time.monotonic()
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=120,
                          env={**os.environ, "DISPLAY": display, "WAYLAND_DISPLAY": "wayland-9"})
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "") and time.monotonic() - begin < 60.0


def test_windows_have_one_owner():
    """Nothing below pipeline/ and studies/ makes a window of pyvista or VTK, but pipeline/pictures/opengl.py."""
    found = [path.name for room in ("pipeline", "studies") for path in (ROOT / room).rglob("*.py")
             if re.search(r"\bPlotter\(|RenderWindow\(|off_screen=True", path.read_text())]
    assert found == ["opengl.py"]


def test_movie_joins_folders_and_cuts_odd_sizes(tmp_path):
    for index in range(5):
        folder = tmp_path / f"segment_{index // 3}"
        folder.mkdir(exist_ok=True)
        Image.new("RGB", (65, 47), (40 * index, 0, 0)).save(folder / f"frame_{index:05d}.png")
    output = tmp_path / "movie.mp4"
    movie.main([str(tmp_path / "segment_1"), str(tmp_path / "segment_0"), "--output", str(output), "--fps", "5"])
    frames = imageio_ffmpeg.read_frames(output)
    about = next(frames)
    assert about["size"] == (64, 46) and about["codec"] == "h264" and about["pix_fmt"].startswith("yuv420p")
    reds = [np.frombuffer(frame, np.uint8)[0::3].mean() for frame in frames]
    assert len(reds) == 5 and np.all(np.diff(reds) > 20)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["movie.mp4", "segment_0", "segment_1"]


def test_movie_errors_are_sentences(tmp_path):
    output = ["--output", str(tmp_path / "movie.mp4")]
    with pytest.raises(UserError, match="no pictures"):
        movie.main([str(tmp_path), *output])
    Image.new("RGB", (64, 48)).save(tmp_path / "frame_00000.png")
    Image.new("RGB", (32, 48)).save(tmp_path / "frame_00001.png")
    with pytest.raises(UserError, match="the first picture is 64 x 48"):
        movie.main([str(tmp_path), *output])
    (tmp_path / "frame_00001.png").write_bytes(b"")
    with pytest.raises(UserError, match=r"frame_00001.png: is no picture"):
        movie.main([str(tmp_path), *output])
    with pytest.raises(UserError, match="--fps"):
        movie.main([str(tmp_path), *output, "--fps", "0"])
    assert not (tmp_path / "movie.mp4").exists()


def test_movie_lasts_as_long_as_its_pictures(tmp_path):
    for index in range(12):
        Image.new("RGB", (64, 48), (20 * index, 0, 0)).save(tmp_path / f"frame_{index:05d}.png")
    movie.main([str(tmp_path), "--output", str(tmp_path / "movie.mp4"), "--fps", "8"])
    about = next(imageio_ffmpeg.read_frames(tmp_path / "movie.mp4"))
    assert about["fps"] == pytest.approx(8.0) and about["duration"] == pytest.approx(1.5)


@pytest.mark.parametrize("gravity", [(0.0, -9.81, 0.0), (0.0, 0.0, -9.81), (9.81, 0.0, 0.0), (-9.81, 0.0, 0.0),
                                     (0.0, -7.0, -7.0), (0.0, 9.81, 0.0)])
@pytest.mark.parametrize("size", [(240, 300), (500, 500), (920, 1000)])
@pytest.mark.parametrize("lens", [Eye(model="mesh", path="eye.stl"), Eye()], ids=["mesh", "phakic"])
def test_captions_of_all_postures_are_whole(gravity, size, lens):
    pixels = np.asarray(SectionPanel(BALL, anterior_segment(lens), size, BALL).draw(BALL, np.array(gravity), BALL))
    border = np.concatenate([pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]])
    assert (border == 255).all()


def corner_of_gravity(gravity):
    """Return rows and columns of the ink in the corner of a section where gravity is shown, without the words."""
    size = 500
    pixels = np.asarray(SectionPanel(BALL, None, (size, size)).draw(BALL, np.array(gravity)))
    return np.nonzero((pixels[:round(0.125 * size), round(0.85 * size):] < 100).all(axis=-1))


@pytest.mark.parametrize(("gravity", "right", "down"), [
    ((0.0, -9.81, 0.0), 0, 1), ((0.0, 9.81, 0.0), 0, -1), ((0.0, 0.0, -9.81), 1, 0), ((0.0, 0.0, 9.81), -1, 0)],
    ids=["upright", "head down", "supine", "prone"])
def test_arrow_points_where_gravity_does(gravity, right, down):
    """Superior is up and posterior is right; the head of the arrow has more ink than its tail."""
    rows, columns = corner_of_gravity(gravity)
    assert len(rows) > 100
    for places, towards in ((columns, right), (rows, down)):
        middle = 0.5 * (places.min() + places.max())
        assert np.sign(round((places.mean() - middle) / 2.0)) == towards


def test_gravity_across_the_section_is_a_dot_toward_the_reader_and_a_cross_away():
    """The reader looks from the patient's left, where a patient on the left side falls to; a cross has more ink."""
    left, right = (len(corner_of_gravity((x, 0.0, 0.0))[0]) for x in (9.81, -9.81))
    assert left > 100 and right > left + 50


def test_color_bar_names_each_liquid_at_the_end_of_its_color(run_folder, tmp_path):
    """Of a mixture: aqueous, the longer word, stands left of the bar, where its color is dark, and oil on the right."""
    pixels = draw(run_folder, tmp_path / "images", "--section-only")[2]
    row = pixels[round((1.0 - 0.054) * SIZE[1])]  # through the middle of the bar
    ends = [np.flatnonzero(np.abs(row - color).max(axis=-1) < 12) for color in (OF_OIL.colors[8], OF_OIL.colors[-8])]
    left, right = (int(np.median(end)) for end in ends)
    assert 0.1 * SIZE[0] < right - left < 0.3 * SIZE[0]
    band = pixels[round((1.0 - 0.066) * SIZE[1]):round((1.0 - 0.042) * SIZE[1])]
    written = np.flatnonzero((band < 160).all(axis=-1).any(axis=0))
    before, after = written[written < left - 8], written[(written > right + 8) & (written < right + 25)]
    assert np.ptp(before) > 2.0 * np.ptp(after) > 0


@pytest.mark.parametrize(("over", "share"), [(-1.0, 0.0), (1.0, 1.0), (None, 0.5)])
def test_the_wall_of_the_opened_eye_has_the_color_of_films_where_films_are(over, share):
    import pyvista

    wall = pyvista.Icosphere(radius=RADIUS, nsub=4)
    x, y, _ = np.asarray(wall.points).T
    wall.point_data["contact_distance"] = y         # oil above
    wall.point_data["film_distance"] = x if over is None else np.full(len(x), over)
    for name in ("oil_fraction_covered", "oil_fraction_bare"):
        wall.point_data[name] = np.full(len(x), float(name.endswith("covered")))
    shown = painted(wall, OF_OIL).triangulate()
    height, across = (np.asarray(shown.cell_centers().points)[:, k] for k in (1, 0))
    film = (np.asarray(shown.point_data["color"])[shown.regular_faces[:, 0]] == FILM).all(axis=1)
    upper = height > 0.03 * RADIUS
    assert not film[~upper & (height < -0.03 * RADIUS)].any()
    assert film[upper].mean() == pytest.approx(share, abs=0.03)
    if over is None:
        assert film[upper & (across > 0.03 * RADIUS)].all()
