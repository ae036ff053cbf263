"""Pictures show the right colors, translucency is right, and missing OpenGL ends in one sentence."""
import dataclasses

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image
from synthetic_frames import RADIUS, ball, frame_of, lattice, oil_fraction

from pipeline import movie, render
from pipeline.base import cli
from pipeline.base.errors import UserError
from pipeline.base.frame_files import frame_path, write_frame
from pipeline.pictures import opengl
from pipeline.pictures.eye_view import FREE_COLOR, TOUCH_COLOR, peel
from pipeline.pictures.section_panel import COLORS, Eye, SectionPanel, posture
from pipeline.reconstruct import write_surfaces
from pipeline.scenes.load import load_scene
from pipeline.surfaces.liquid_surface import Reconstructor

SIZE = (640, 360)
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
    np.savez(folder / "initial.npz", **ball())
    pyvista.Sphere(radius=RADIUS, theta_resolution=40, phi_resolution=40).save(folder / "eye.vtp")
    position = lattice()
    reconstructor = Reconstructor(ball(), 2)
    (folder / "surfaces").mkdir()
    for index, (options, _) in enumerate(CONTENTS.values()):
        frame = frame_of(position, oil_fraction(position, **options), time=0.1 * index)
        path = frame_path(folder / "frames", index)
        write_frame(path, frame)
        write_surfaces(folder / "surfaces", path, frame, reconstructor)
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
    height, width = pixels.shape[:2]
    center = width // 2
    for row, fraction in zip((0.38, 0.64), fractions, strict=True):
        found = pixels[round(row * height), center]
        shades = [k for k in range(256) if np.abs(COLORS[k].astype(int) - found).max() <= 3]
        assert shades and abs(np.mean(shades) / 255 - fraction) < 0.06


def test_sections_need_no_opengl(run_folder, tmp_path, monkeypatch):
    monkeypatch.setattr(opengl, "works", lambda window: pytest.fail("OpenGL was asked for"))
    pictures = draw(run_folder, tmp_path / "images", "--section-only")
    for pixels, (_, fractions) in zip(pictures, CONTENTS.values(), strict=True):
        assert pixels.shape == (SIZE[1], SIZE[0], 3)
        assert_section(pixels, fractions)
    middle = slice(SIZE[0] // 2 - 40, SIZE[0] // 2 + 40)
    black = [count(pixels[120:240, middle], (0, 0, 0)) for pixels in pictures]
    assert black[0] == 0 and black[1] > 60 and black[2] > 60    # the interface is drawn where there is one
    assert count(pictures[0], (176, 52, 24), 40) > 20           # the scene's label


def test_pictures_show_section_and_body(run_folder, tmp_path, opengl):
    pictures = draw(run_folder, tmp_path / "images")
    assert all(pixels.shape == (SIZE[1], SIZE[0], 3) for pixels in pictures)
    water, tamponade, _ = pictures
    left, right = slice(0, SIZE[0] // 2), slice(SIZE[0] // 2, None)
    assert_section(tamponade[:, left], (1.0, 0.0))
    body = slice(60, 300)
    hue = tamponade[body, right] - tamponade[body, right].mean(axis=-1, keepdims=True)
    empty = water[body, right] - water[body, right].mean(axis=-1, keepdims=True)
    yellow = (hue[..., 2] < -40).sum()
    assert yellow > 3000 and (empty[..., 2] < -40).sum() < 50
    touch = (hue[..., 0] > 60) & (hue[..., 2] < -60)
    assert 1500 < touch.sum() < 0.6 * yellow        # the far wall above the level, neither speckled nor everywhere
    for color in (TOUCH_COLOR, FREE_COLOR):
        assert count(tamponade[300:, right], rgb(color)) > 20       # the legend


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
    assert opengl.find_working_opengl() == "default"


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


def corner_of_gravity(gravity):
    """Return rows and columns of the ink in the corner of a section where gravity is shown, without the words."""
    axis, size = 1e-3 * np.arange(-14, 15), 500
    panel = SectionPanel(np.hypot(*np.meshgrid(axis, axis)) - RADIUS, axis[[0, 0]], 1e-3, Eye(None, "phakic"),
                         (size, size))
    pixels = np.asarray(panel.draw(np.zeros((29, 29)), [], np.array(gravity)))
    return np.nonzero((pixels[:round(0.14 * size), round(0.83 * size):round(0.95 * size)] < 100).all(axis=-1))


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
    """Aqueous, the longer word, stands left of the bar, where its color is dark, and oil on the right."""
    pixels = draw(run_folder, tmp_path / "images", "--section-only")[0]
    row = pixels[round((1.0 - 0.054) * SIZE[1])]  # through the middle of the bar
    ends = [np.flatnonzero(np.abs(row - color).max(axis=-1) < 12) for color in (COLORS[8], COLORS[-8])]
    left, right = (int(np.median(end)) for end in ends)
    assert 0.1 * SIZE[0] < right - left < 0.3 * SIZE[0]
    band = pixels[round((1.0 - 0.066) * SIZE[1]):round((1.0 - 0.042) * SIZE[1])]
    written = np.flatnonzero((band < 160).all(axis=-1).any(axis=0))
    before, after = written[written < left - 8], written[written > right + 8]
    assert np.ptp(before) > 2.0 * np.ptp(after) > 0
