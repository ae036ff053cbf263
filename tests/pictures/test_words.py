"""Every word of a picture against the numbers: sides, halves, percentages, legends, for both eyes and four postures.

Words are read where they are drawn, with their places; what they should say is counted from the geometry of the frame.
"""
import dataclasses
import re
import types

import numpy as np
import pytest
import pyvista
from conftest import ROOT
from helpers.synthetic_frames import RADIUS, ball, frame_of, lattice
from PIL import Image, ImageDraw

from pipeline import compare, metrics
from pipeline.base.frame_files import frame_path, write_frame
from pipeline.measures.frame_view import Measured
from pipeline.pictures.fundus_map import Coverage, FundusMap
from pipeline.pictures.paint import OF_OIL
from pipeline.reconstruct import Wall, write_surfaces
from pipeline.render import Renderer
from pipeline.scenes.load import load_scene
from pipeline.studies.model import Outcome, compared
from pipeline.studies.plan import Study
from pipeline.studies.report import write_study
from pipeline.surfaces.liquid_surface import Reconstructor
from pipeline.surfaces.surface_files import read_section, read_wall
from sim.effects.injection import InjectionParameters

SIZE = (640, 360)
# Gravity in the frame of the eye: x to the patient's left, y superior, z anterior.
POSTURES = {"upright": (0.0, -9.81, 0.0), "supine": (0.0, 0.0, -9.81), "prone": (0.0, 0.0, 9.81),
            "lying on the left side": (9.81, 0.0, 0.0)}
ASKEW = np.array([0.5, 0.25, 0.1])      # so that no two quadrants are alike
HEIGHT = 1.5e-3                         # of the oil's lower face over the center, m
WORDS = {"silicone_oil_1000": "silicone oil", "aqueous": "aqueous"}


class Drawn:
    """Words that were drawn: text, place as shares of its picture, and the pen, one for a picture."""

    def __init__(self, monkeypatch):
        self.texts = []
        plain = ImageDraw.ImageDraw.text

        def text(pen, xy, text, *arguments, **options):
            width, height = pen.im.size
            self.texts.append((text, xy[0] / width, xy[1] / height, pen))
            return plain(pen, xy, text, *arguments, **options)

        monkeypatch.setattr(ImageDraw.ImageDraw, "text", text)

    def __contains__(self, words):
        return any(words == text for text, *_ in self.texts)

    def one(self, pattern):
        """Return the only text that a pattern matches."""
        found = [text for text, *_ in self.texts if re.search(pattern, text)]
        assert len(found) == 1, (pattern, self.texts)
        return found[0]

    def pen(self, text):
        """Return the pen of the picture that has a text."""
        return next(pen for words, *_, pen in self.texts if words == text)

    def place(self, text, pen):
        """Return where in its picture the only such text stands."""
        found = [(x, y) for words, x, y, of in self.texts if words == text and of is pen]
        assert len(found) == 1, (text, self.texts)
        return found[0]


def toward(gravity):
    """Direction (3,) to which the oil of a frame has gone."""
    up = -np.array(gravity) / 9.81 + ASKEW
    return up / np.linalg.norm(up)


def on_wall():
    """Even points on the wall."""
    count = 40_000
    height = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn, across = np.pi * (1.0 + 5.0**0.5) * np.arange(count), np.sqrt(1.0 - height**2)
    return RADIUS * np.stack([across * np.cos(turn), height, across * np.sin(turn)], axis=-1)


def expected(gravity):
    """Percent under oil: of the retina, its halves, macula, and quadrants by where the patient's right is, and up."""
    points = on_wall()
    x, y, z = points.T
    covered = points @ toward(gravity) > HEIGHT
    retina = np.arccos(-z / RADIUS) <= np.radians(115.0)
    masks = {"retina": retina, "inferior half": retina & (y < 0.0), "macula": (z < 0.0) & (np.hypot(x, y) < 2.75e-3)}
    masks |= {(hand, up): retina & (x * across > 0.0) & (y * along > 0.0)
              for hand, across in (("right", -1), ("left", 1)) for up, along in (("superior", 1), ("inferior", -1))}
    return {name: 100.0 * covered[mask].mean() for name, mask in masks.items()}


@pytest.fixture(scope="module")
def made(tmp_path_factory, taichi):
    """Return a function: what the reconstruct stage makes of a posture and a side, and the scene."""
    folder, eye, kept = tmp_path_factory.mktemp("words"), pyvista.Icosphere(radius=RADIUS, nsub=4), {}
    tiny = load_scene(ROOT / "config" / "scenes" / "tests" / "tiny.yaml", "draft")
    tiny = dataclasses.replace(tiny, output=dataclasses.replace(tiny.output, image_size=SIZE), effects={
        name: one for name, one in tiny.effects.items() if name in ("gravity",)})
    position, reconstructor = lattice(), Reconstructor(ball(), 2)

    def of(posture, side):
        scene = dataclasses.replace(tiny, eye=dataclasses.replace(tiny.eye, side=side))
        if posture not in kept:
            frame = frame_of(position, (position @ toward(POSTURES[posture]) > HEIGHT).astype(float),
                             gravity=POSTURES[posture])
            path = frame_path(folder / "frames", len(kept))
            write_frame(path, frame)
            kept[posture] = frame, path
            (folder / path.stem).mkdir()
            write_surfaces(folder / path.stem, path, frame, reconstructor)
        frame, path = kept[posture]
        sections = [read_section(folder / path.stem / f"{path.stem}_{name}.vti") for name in ("section", "coronal")]
        target = folder / path.stem / f"{side}.vtp"
        shares = Wall(scene, ball(), eye).write(target, frame)
        return scene, frame, sections, read_wall(target), {name: Coverage(**one) for name, one in shares.items()}
    return of


@pytest.fixture
def drawn(monkeypatch):
    return Drawn(monkeypatch)


@pytest.mark.thorough_cases("supine-left", "prone-right", "prone-left", "lying on the left side-left")
@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("posture", POSTURES)
def test_words_of_a_picture_are_its_numbers(made, drawn, posture, side):
    scene, frame, sections, wall, retina = made(posture, side)
    renderer = Renderer(scene, float(ball()["cavity_volume"]))
    picture = np.asarray(renderer.picture(frame, sections, wall, {}, retina)).astype(int)
    exact = expected(POSTURES[posture])
    # The first numbers
    head = drawn.one("of the retina")
    assert head.startswith("oil touches ")
    numbers = dict(zip(("retina", "inferior half", "macula"), map(float, re.findall(r"([\d.]+)(?: ± [\d.]+)? %", head)),
                       strict=True))
    assert re.search("of the retina, .* of its inferior half, .* of the macula", head)
    for name, number in numbers.items():
        assert number == pytest.approx(exact[name], abs=6.0 if name == "macula" else 3.0), name
    assert f"fundus of the {side} eye, as its examiner sees it" in drawn
    halves = [text for text, *_ in drawn.texts if text.endswith(" half of the eye")]
    if halves:      # where halves can be drawn; the camera of the upper one is on the patient's left
        assert halves[0].startswith("temporal" if side == "right" else "nasal") and halves[0] != halves[1]
    share = 100.0 * np.mean(frame.phase == 1)
    assert drawn.one("of the cavity") == (f"silicone oil 1000: {share:.1f} % of the cavity "
                                          f"({1e9 * 4.0 / 3.0 * np.pi * RADIUS**3 * 1e-3:.2f} mL)")
    # What lies beside the plane of the section: the aqueous, away from the oil
    aqueous = frame.position[frame.phase == 0, 0] > 0.0
    if max(aqueous.mean(), 1.0 - aqueous.mean()) >= 0.6:
        other = "left" if aqueous.mean() > 0.5 else "right"
        assert f"most of the aqueous lies on the patient's {other} of this plane" in drawn
    else:
        assert not any("of this plane" in text for text, *_ in drawn.texts)
    # The map: an examiner faces the patient, so that the patient's right is on the left
    chart = drawn.pen("temporal")
    for hand, x in (("right", 0.0), ("left", 1.0)):
        for up in ("superior", "inferior"):
            corner = [(text, y) for text, place, y, of in drawn.texts if of is chart and abs(place - x) < 0.1
                      and (y < 0.5) == (up == "superior")]
            texts = {text for text, _ in corner}
            assert up in texts and ("temporal" if hand == side else "nasal") in texts, (hand, up, texts)
            number = next(float(text[:-2]) for text in texts if text.endswith(" %"))
            assert number == pytest.approx(exact[hand, up], abs=3.0), (hand, up)
    # The section: superior up, anterior on the left; of the coronal one the patient's right on the left
    panel = drawn.pen("anterior")
    assert drawn.place("superior", panel)[1] < 0.3 < 0.6 < drawn.place("inferior", panel)[1]
    assert drawn.place("anterior", panel)[0] < drawn.place("posterior", panel)[0]
    assert drawn.place("R", panel)[0] < drawn.place("L", panel)[0]
    said = " ".join(text for text, *_, of in drawn.texts if of is panel)
    assert posture in said and "gravity" in said
    # And once from the pixels: swatches of the legend, and the wall in the middle of the oil and away from it
    for words, color in (("silicone oil", OF_OIL.covered), ("aqueous", OF_OIL.bare)):
        x, y = drawn.place(words, drawn.pen(words))
        before = picture[round(y * SIZE[1]), round(x * SIZE[0] - 0.03 * SIZE[1])]
        assert np.abs(before - color).max() < 6, words
    pixels = np.asarray(renderer.fundus.draw(wall, uncertain=0.0)).astype(int)
    for way, color in ((1.0, OF_OIL.covered), (-1.0, OF_OIL.bare)):
        point = way * toward(POSTURES[posture]) * [1.0, 1.0, 0.0] - [0.0, 0.0, 0.8]
        if (point / np.linalg.norm(point) @ toward(POSTURES[posture]) * RADIUS > HEIGHT) == (way > 0.0):
            x, y = renderer.fundus.place(point).round().astype(int)
            assert np.abs(np.median(pixels[y - 6:y + 7, x - 6:x + 7].reshape(-1, 3), axis=0) - color).max() < 12


def test_an_eye_with_one_liquid_names_that_alone(made, drawn):
    scene, frame, sections, wall, retina = made("upright", "right")
    scene = dataclasses.replace(scene, liquids=scene.liquids[1:])
    full = frame_of(frame.position, np.ones((len(frame.position), 1)), liquids=("silicone_oil_1000",))
    for image in sections:
        image.point_data["fraction"] = np.asarray(image.point_data["fraction"]).reshape(-1, 2)[:, 1:]
    retina = dict.fromkeys(retina, Coverage(1.0, 0.0))
    Renderer(scene, float(ball()["cavity_volume"])).picture(full, sections, wall, {}, retina)
    assert drawn.one("of the retina") == ("oil touches 100.0 % of the retina, 100.0 % of its inferior half, 100.0 % of "
                                          "the macula")
    assert drawn.one("of the cavity").startswith("silicone oil 1000: 100.0 % of the cavity")
    assert "silicone oil" in drawn and not any("aqueous" in text for text, *_ in drawn.texts)


@pytest.mark.parametrize("oil_on_the_left", [True, False])
def test_the_sample_of_an_uncertain_edge_is_a_piece_of_the_map(oil_on_the_left):
    """Stripes are aqueous where oil is, and oil where aqueous is: at the same stripes in legend and map."""
    vertices = np.asarray(pyvista.Icosphere(radius=RADIUS, nsub=5).points)
    chart = FundusMap(vertices, (600, 600), captions=False)
    sample = np.asarray(chart.hatch_sample((120, 60))).astype(int)
    wall = pyvista.PolyData(vertices)
    wall.point_data["contact_distance"] = (-1.0 if oil_on_the_left else 1.0) * vertices[:, 0]
    for name, value in (("oil_fraction_covered", 1.0), ("oil_fraction_bare", 0.0)):
        wall.point_data[name] = np.full(len(vertices), value)
    drawn = np.asarray(chart.draw(wall, uncertain=1.0)).astype(int)
    period = 2.0 * chart.unit
    for left in (True, False):
        for phase in (0.5, 1.5):                                            # the middle of a stripe, and between two
            rows, columns = np.mgrid[:60, :120]
            there = (np.abs((rows + columns + 0.5) / (0.5 * period) % 2.0 - phase) < 0.2) & (
                (columns < 50) if left else (columns > 70))
            of_sample = np.median(sample[there], axis=0)
            rows, columns = np.mgrid[200:400, 200:400]
            there = (np.abs((rows + columns + 0.5) / (0.5 * period) % 2.0 - phase) < 0.2) & (
                (columns < 280) if left == oil_on_the_left else (columns > 320))
            of_map = np.median(drawn[200:400, 200:400][there], axis=0)
            assert np.abs(of_sample - of_map).max() < 12, (left, phase)


# Numbers of tables and pages

def test_fill_and_speed_are_in_the_units_of_their_heads():
    position = lattice()
    oil = position[:, 1] > HEIGHT
    scene = load_scene(ROOT / "config" / "scenes" / "clinic" / "tamponade.yaml", "draft")
    assert isinstance(scene.effects["injection"], InjectionParameters)
    velocity = np.tile([0.0, 3e-3, 4e-3], (len(oil), 1))
    frame = dataclasses.replace(frame_of(position, oil.astype(float)), velocity=velocity)
    state = Measured(scene, ball(), frame)
    table = {name: value for one in metrics.METRICS if one.name in ("fill", "speed", "volume")
             for name, value in one.columns(state).items()}
    assert table["fill [%]"] == pytest.approx(100.0 * oil.mean(), rel=1e-5)
    assert table["speed_rms [mm/s]"] == pytest.approx(5.0) == table["speed_largest [mm/s]"]
    assert table["volume_silicone_oil_1000 [mL]"] == pytest.approx(5.575 * oil.mean(), rel=1e-3)


def test_a_comparison_shows_each_level_under_its_own_name(tmp_path, monkeypatch):
    from matplotlib.axes import Axes

    shown, heads = {}, {}
    monkeypatch.setattr(Axes, "imshow", _noting(Axes.imshow, shown))
    monkeypatch.setattr(Axes, "set_title", _noting(Axes.set_title, heads))
    colors = {"draft": (200, 0, 0), "standard": (0, 0, 200)}
    runs = []
    for level, color in colors.items():
        path = tmp_path / level / "frame_00001.png"
        path.parent.mkdir()
        Image.new("RGB", (64, 36), color).save(path)
        scene = load_scene(ROOT / "config" / "scenes" / "tests" / "tiny.yaml", level)
        runs.append(types.SimpleNamespace(
            level=level, pictures=[path], scene=scene, cost_files=[tmp_path / "none"], folder=path.parent,
            table={"time [s]": np.array([0.0, 0.1]), "frame": np.array([0, 1])}))
    content = compare.picture_of(runs, [np.arange(2)] * 2, [])
    levels = {heads[axes].split(":")[0]: tuple(round(255 * float(one)) for one in image[5, 5][:3])
              for axes, image in shown.items()}
    assert levels == colors
    for run in runs:
        head = next(text for text in heads.values() if text.startswith(f"{run.level}:"))
        assert f"{1e3 * run.scene.numerics.particle_spacing:g} mm" in head and "0.1 s" in head
    (tmp_path / "made.png").write_bytes(content)
    pixels = np.asarray(Image.open(tmp_path / "made.png").convert("RGB")).astype(int)
    places = [np.argwhere(np.abs(pixels - color).max(axis=-1) < 20)[:, 1].mean() for color in colors.values()]
    assert places[0] < 0.5 * pixels.shape[1] < places[1]       # the first of the command is on the left


def _noting(plain, kept):
    """A method of axes that keeps its first argument."""
    def method(axes, first, *arguments, **options):
        kept[axes] = first
        return plain(axes, first, *arguments, **options)
    return method


def test_the_page_of_a_study_holds_every_row(tmp_path, capsys):
    """Those that do not hold are in the table, in the page and in what is printed."""
    rows = [compared("first thing", 1.0, 1.0, 0.1), compared("second thing", 2.0, 1.0, 0.1),
            compared("third thing", 3.0, 1.0, None)]
    study = Study(name="small", title="Small", description="Three things.", accuracy="draft", cases={})
    outcome = Outcome()
    outcome.rows += rows
    write_study(study, [dataclasses.replace(outcome, case="only")], tmp_path)
    page, table = (tmp_path / "table.html").read_text(), (tmp_path / "table.csv").read_text()
    for row in rows:
        assert page.count(row.quantity) == 1 and table.count(row.quantity) == 1
    assert "1 of 2 with a tolerance are within it" in page and page.count('class="marked"') == 1
    marked = re.search(r'<tr class="marked">.*?</tr>', page, re.DOTALL)[0]
    assert "second thing" in marked and ">2<" in marked.replace("</td>", "<")
    assert "second thing is 2" in capsys.readouterr().out
