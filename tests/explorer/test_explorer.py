"""The explorer: its tables, what lies between them, its page, and links to settings."""
import dataclasses
import json
import re
import shutil
import subprocess
from types import SimpleNamespace

import numpy as np
import pytest
from helpers import headless_browser

import pipeline
from pipeline.base.errors import UserError
from pipeline.equilibrium.star_cavity import DRAFT, cavity_of
from pipeline.explorer import table as tables
from pipeline.explorer.cases import AZIMUTHS, FILLS, LATITUDES, MERIDIANS, TABLES, TILTS, eyes, tamponades
from pipeline.explorer.chart import Chart
from pipeline.explorer.errors import Errors, down_of
from pipeline.explorer.lookup import look_up
from pipeline.explorer.page import HERE, MOST_BYTES, known_of, page_of
from pipeline.explorer.shapes import Shape
from pipeline.explorer.table import FOLDER, NODES, Table, directions, make, path_of
from pipeline.planning.plan import plan_fill
from pipeline.scenes.retina import direction
from pipeline.web.scripts import library

NODE, BROWSER = shutil.which("node"), headless_browser.find_browser()
WIDTHS = (1400, 390)
# Fill, how far the face is raised and how far the right ear is lowered, degrees.
SETTINGS = ((0.85, 0.0, 0.0), (0.9, 60.0, 0.0), (0.72, -33.0, 140.0), (0.955, 12.5, -101.0), (0.4, -90.0, 0.0))


@pytest.fixture(scope="module")
def light():
    """Return the table of light oil in the eye that is shown first."""
    return Table.read(path_of(*TABLES[0]))


@pytest.fixture(scope="module")
def chart():
    """Return the retina of that eye."""
    return Chart.of(cavity_of(eyes()[TABLES[0][0]], DRAFT))


@pytest.fixture(scope="module")
def known():
    """Return what the scripts of the page know."""
    return known_of()


@pytest.fixture(scope="module")
def page_file(tmp_path_factory):
    """Return the page as a file."""
    path = tmp_path_factory.mktemp("explorer") / "explorer.html"
    path.write_text(page_of(), encoding="utf-8")
    return path


def in_node(script, values, folder):
    """Run a script with the page's own ones, and values as `given`; return what it prints, as JSON."""
    if NODE is None:
        pytest.skip("Node.js is not installed")
    (folder / "given.json").write_text(json.dumps(values))
    code = (f"const {{explorerModel, gravity}} = require('{HERE}/model.js'), page = require('{HERE}/explorer.js');"
            f"const given = require('{folder}/given.json');"
            f"(async () => {{ console.log(JSON.stringify(await (async () => {{ {script} }})())); }})();")
    done = subprocess.run([NODE, "-e", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_the_tables_are_there_and_whole():
    for case in TABLES:
        one = Table.read(path_of(*case))
        size = (len(LATITUDES), len(MERIDIANS))
        assert one.margin.shape == one.gap.shape == (*NODES, *size) and one.shares.shape == (*NODES, 4)
        assert one.margin.any(axis=(-1, -2)).all(), case  # every shape was found
    assert sum(path.stat().st_size for path in FOLDER.iterdir()) < 5e6


def test_at_a_node_is_the_shape_of_the_table(light, chart):
    for tilt, azimuth, fill in ((6, 0, 6), (3, 1, 2), (9, 2, 9), (0, 0, 4), (12, 0, 7)):
        toward = direction(AZIMUTHS[azimuth:azimuth + 1], TILTS[tilt:tilt + 1])[0]
        looked = look_up(light, toward, FILLS[fill])
        shown = chart.shares(looked.margin)
        assert np.abs(shown - light.shares[tilt, azimuth, fill])[:3].max() < 0.01
        for mirror in ([-1, 1, 1], [1, -1, 1], [-1, -1, 1]):
            other = chart.shares(look_up(light, toward * mirror, FILLS[fill]).margin)
            assert other == pytest.approx(shown if mirror[1] > 0 else shown[[0, 2, 1, 3]], abs=2e-3)


@pytest.mark.parametrize(("fill", "least"), [(0.3, 0.08), (0.4, 0.12), (0.5, 0.17), (0.6, 0.22)])
def test_light_oil_of_a_supine_patient_leans_on_the_wall(light, chart, fill, least):
    """It touched nothing when it was looked for from one point only: a shape with 1 to 2 % more energy."""
    retina, superior, inferior, _ = chart.shares(look_up(light, tamponades()["light"].toward(down_of(90.0, 0.0)),
                                                         fill).margin)
    assert retina > least and superior > 0.15 and inferior < 0.01


@pytest.mark.thorough
@pytest.mark.parametrize(("oil", "fill", "posture", "pitch", "roll"), (
    ("silicone_oil_1000", 0.85, "upright", 0.0, 0.0), ("heavy_oil_densiron_68", 0.75, "left_side", 0.0, -90.0)))
def test_the_tables_say_what_a_shape_of_its_own_says(chart, oil, fill, posture, pitch, roll):
    name = "heavy" if "heavy" in oil else "light"
    looked = look_up(Table.read(path_of("24", name)), tamponades()[name].toward(down_of(pitch, roll)), fill)
    shares = pipeline.oil_at_rest(oil, fill, posture).shares
    stated = np.abs(Errors.read().off).max(axis=0)
    for value, part, most in zip(chart.shares(looked.margin), ("retina", "superior", "inferior"), stated, strict=False):
        assert value == pytest.approx(shares[part], abs=max(most, 0.01)), part


def test_settings_between_the_tables_are_as_far_off_as_is_told():
    off = np.abs(Errors.read().off)
    assert len(off) >= 40 and np.sqrt((off[:, 0] ** 2).mean()) < 0.01


def test_the_page_finds_what_is_found_here(light, chart, known, tmp_path):
    found = in_node("""
      const model = explorerModel(given.known);
      const eye = await model.eyeOf(given.known.eyes.find(one => one.name === "24"));
      return given.settings.map(([fill, pitch, roll]) => {
        const down = gravity(pitch, roll), looked = model.lookUp(eye, eye.tables.light, down.map(part => -part), fill);
        return {...looked, margin: [...looked.margin], gap: [...looked.gap()]};
      });""", {"known": known, "settings": SETTINGS}, tmp_path)
    for (fill, pitch, roll), one in zip(SETTINGS, found, strict=True):
        here = look_up(light, -down_of(pitch, roll), fill)
        assert np.array(one["margin"]) == pytest.approx(here.margin.ravel(), abs=2e-6)
        assert one["shares"] == pytest.approx(chart.shares(here.margin), abs=2e-4)
        assert np.array(one["gap"]) == pytest.approx(here.gap.ravel(), abs=2e-6)
        for name in ("low", "high", "shift", "view"):
            assert one[name] == pytest.approx(getattr(here, name), abs=1e-6)


@pytest.mark.thorough
@pytest.mark.parametrize(("place", "posture", "pitch", "roll"), (
    ("6h,60deg", "upright", 0, 0), ("2h,90deg", "left_side", 0, -90), ("9h,40deg", "prone", -90, 0)))
def test_the_page_finds_the_smallest_fill_of_a_plan(known, tmp_path, place, posture, pitch, roll):
    hour, latitude = re.findall(r"\d+", place)
    found = in_node("""
      const model = explorerModel(given.known);
      const eye = await model.eyeOf(given.known.eyes.find(one => one.name === "24"));
      return model.smallestFill(eye.tables.light, gravity(given.pitch, given.roll).map(part => -part),
                                model.pointsOf(given.tear), given.known.wanted);""",
                    {"known": known, "pitch": pitch, "roll": roll,
                     "tear": {"hour": int(hour), "latitude": int(latitude), "width": 1, "height": 10}}, tmp_path)
    plan = plan_fill(place, "1h,10deg", oils=["silicone_oil_1000"], postures=[posture])
    assert max(found[0], 0.5) == pytest.approx(plan.answers[0].fill, abs=0.02)  # a plan begins at 50 %
    assert found[1] <= found[0] <= found[2]


@pytest.mark.thorough
def test_links_carry_the_setting_and_bad_ones_give_words(known, tmp_path):
    links = ["", "#fill=72.5&tamponade=heavy&eye=24&side=left&pitch=-45&roll=10&break=2.5,80,2,12", "#fill=120",
             "#tamponade=water", "#eye=31", "#pitch=x&colour=red", "#break=1,2", "#break=6,114,1,20", "#break=none",
             "#fill=&roll=1e999", "#fill=%E0%A4%A", "#tamponade=constructor"]
    found = in_node("return given.links.map(link => { const read = page.readLink(link, given.known.start, given.known);"
                    "return [read.found, read.said, page.linkOf(read.found)]; });", {"known": known, "links": links},
                    tmp_path)
    plain, good, *bad = found
    assert plain[0] == known["start"] and plain[1] == []
    assert good[1] == [] and good[2] == links[1]
    said = [" ".join(one[1]) for one in bad]
    assert "120" in said[0] and "98.5 % is shown" in said[0] and bad[0][0]["fill"] == 98.5
    assert '"water"' in said[1] and "light oil is shown" in said[1] and "heavy" in said[1]
    assert '"31"' in said[2] and "24" in said[2]
    assert "not a number" in said[3] and '"colour"' in said[3]
    assert "hour, latitude, width and height" in said[4]
    assert "beyond the ora serrata" in said[5] and bad[5][0]["tear"]["latitude"] == 105
    assert said[6] == "" and bad[6][0]["tear"] is None
    assert all(said[7:])
    fewer = known | {"eyes": [{"name": "22", "tables": {"light": "-"}}, {"name": "24", "tables": {"gas": "-"}}]}
    changed, words = in_node("const read = page.readLink('#eye=22&tamponade=gas', given.start, given);"
                             "return [read.found, read.said];", fewer, tmp_path)
    assert changed["eye"] == "24" and "no table of gas for an eye of 22 mm" in " ".join(words)


def test_the_page_asks_no_network_and_can_be_sent(page_file):
    text = page_file.read_text(encoding="utf-8")
    assert len(text.encode()) < MOST_BYTES
    text = text.replace(library("three.min.js"), "")  # which names addresses that it asks for nothing
    assert "default-src 'none'" in text and not re.search(r"https?://|\bfetch\(|XMLHttpRequest|@import|url\(", text)
    assert not re.findall(r'(?:src|href)="(?!data:)', text)


def test_a_folder_without_tables_is_told(tmp_path):
    with pytest.raises(UserError, match="explorer_tables"):
        page_of(tmp_path)
    path_of(*TABLES[0], tmp_path).write_bytes(b"PK damaged")
    with pytest.raises(UserError, match="damaged"):
        page_of(tmp_path)


def test_directions_that_are_there_are_not_computed_again(tmp_path, monkeypatch):
    size, computed = (len(LATITUDES), len(MERIDIANS)), []
    chart = SimpleNamespace(shift=lambda margin, change: 0.0)

    def shape_at(views, tamponade, meridian, tilt, fill):
        computed.append((tilt, meridian))
        field = np.broadcast_to(np.arange(len(MERIDIANS)) * 1e-4, size)
        return None if fill == FILLS[0] else Shape(
            field, field, np.zeros(3), np.zeros(4), np.zeros(4), np.ones(4))

    monkeypatch.setattr(tables, "shape_at", shape_at)
    first = make(None, chart, tamponades()["light"], tmp_path, lambda count: None)
    assert len(computed) == len(list(directions())) * len(FILLS)
    again = make(None, chart, tamponades()["light"], tmp_path, lambda count: None)
    assert len(computed) == len(list(directions())) * len(FILLS)
    for one, other in zip(dataclasses.astuple(first), dataclasses.astuple(again), strict=True):
        assert np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    turned = np.roll(first.margin[0, 0], -round(AZIMUTHS[1] / MERIDIANS[1]), axis=-1)
    assert np.array_equal(first.margin[0, 1], turned)
    assert look_up(first, np.array([0.0, 1.0, 0.0]), FILLS[0]) is None


@pytest.mark.thorough
@pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")
@pytest.mark.parametrize("width", WIDTHS)
def test_the_page_works_in_a_browser(page_file, tmp_path, width):
    browser = headless_browser.Browser(BROWSER, tmp_path / "profile")
    ready = ("new Promise(done => { const ask = () => document.querySelector('.shares b:not(:empty)') ? done(true)"
             " : setTimeout(ask, 50); ask(); })")
    hand = browser.touch if width < 500 else browser.drag

    def comes(condition):
        return browser.run("new Promise(done => { const end = Date.now() + 20000; const ask = () => "
                           f"({condition}) ? done(true) : Date.now() > end ? done(false) : setTimeout(ask, 50); "
                           "ask(); })")

    try:
        browser.open(page_file, width, phone=width < 500)
        assert browser.run(ready)
        assert browser.run("document.documentElement.scrollWidth") <= width, "it scrolls sideways"
        assert comes("location.hash.includes('fill=85&tamponade=light')")
        views = [browser.run("document.querySelector('.fundus canvas').toDataURL()")]
        browser.run("location.hash = '#fill=120&pitch=90'")
        assert comes("location.hash.includes('fill=98.5')")
        assert "98.5 % is shown" in browser.run("document.querySelector('.message').textContent")
        views.append(browser.run("document.querySelector('.fundus canvas').toDataURL()"))
        browser.run("document.querySelector('.head canvas').dispatchEvent(new KeyboardEvent('keydown', "
                    "{key: 'ArrowDown'}))")
        assert comes("!location.hash.includes('pitch=90')")
        browser.run("window.before = location.hash")
        hand(".head canvas", 0, 40)
        assert comes("location.hash !== before"), "the head does not turn"
        browser.run("window.before = location.hash.split('break')[1]")
        hand(".fundus canvas", 20, 20)
        assert comes("location.hash.split('break')[1] !== before"), "the break does not move"
        browser.run("document.querySelector('input[value=heavy]').click()")
        assert comes("location.hash.includes('tamponade=heavy')")
        views.append(browser.run("document.querySelector('.shape canvas').toDataURL()"))
        assert len(set(views)) == len(views)
        assert browser.requests() == [] and browser.errors() == []
    finally:
        browser.close()
