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
from pipeline.explorer.cases import AZIMUTHS, FILLS, HALF, LATITUDES, TABLES, TILTS, eyes, tamponades
from pipeline.explorer.chart import Chart
from pipeline.explorer.errors import HEADS, Errors, down_of
from pipeline.explorer.interface import SIZE, Interface, Lattice, across
from pipeline.explorer.lookup import look_up
from pipeline.explorer.page import HERE, MOST_BYTES, known_of, page_of
from pipeline.explorer.shapes import Shape
from pipeline.explorer.table import FOLDER, NODES, Table, make, path_of
from pipeline.planning.plan import plan_fill
from pipeline.scenes.model import Eye
from pipeline.scenes.retina import direction
from pipeline.web.scripts import library

NODE, BROWSER = shutil.which("node"), headless_browser.find_browser()
WIDTHS = (1400, 390)
# Length of the eye, mm, fill, how far the face is raised and how far the right ear is lowered, degrees.
SETTINGS = ((24.0, 0.85, 0.0, 0.0), (26.0, 0.9, 60.0, 0.0), (21.5, 0.72, -33.0, 140.0), (24.0, 0.955, 12.5, -101.0),
            (29.0, 0.4, -90.0, 0.0), (22.0, 0.07, 31.0, 77.0))


def tables_of(name):
    """Return the tables of a tamponade, by the length of the eye."""
    return {length: Table.read(path_of(length, name)) for length, one in TABLES if one == name}


@pytest.fixture(scope="module")
def light():
    """Return the tables of light oil."""
    return tables_of("light")


@pytest.fixture(scope="module")
def chart():
    """Return the retina of the eye that is shown first."""
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
            f"const {{eyeSurfaces}} = require('{HERE}/surfaces.js');"
            f"const given = require('{folder}/given.json');"
            f"(async () => {{ console.log(JSON.stringify(await (async () => {{ {script} }})())); }})();")
    done = subprocess.run([NODE, "-e", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_the_tables_are_there_and_whole():
    for case in TABLES:
        one = Table.read(path_of(*case))
        assert one.margin.shape == (*NODES, len(LATITUDES), HALF) and one.depth.shape == (*NODES, *SIZE)
        assert one.shares.shape == (*NODES, 4)
        assert one.margin.min() > 0 and one.depth.min() > 0, case  # every shape was found
    assert sum(path.stat().st_size for path in FOLDER.iterdir()) < 8e6


def test_at_a_node_is_the_shape_of_the_table(light, chart):
    for tilt, azimuth, fill in ((6, 0, 9), (3, 1, 5), (9, 1, 12), (0, 0, 7), (16, 0, 10), (6, 0, 0)):
        toward = direction(AZIMUTHS[azimuth:azimuth + 1], TILTS[tilt:tilt + 1])[0]
        shown = chart.shares(look_up(light, 24.0, toward, FILLS[fill]).margin)
        assert np.abs(shown - light["24"].shares[tilt, azimuth, fill])[:3].max() < 0.01
        for mirror in ([-1, 1, 1], [1, -1, 1], [-1, -1, 1]):
            other = chart.shares(look_up(light, 24.0, toward * mirror, FILLS[fill]).margin)
            assert other == pytest.approx(shown if mirror[1] > 0 else shown[[0, 2, 1, 3]], abs=2e-3)


@pytest.mark.parametrize(("fill", "least"), [(0.3, 0.08), (0.4, 0.12), (0.5, 0.17), (0.6, 0.22)])
def test_light_oil_of_a_supine_patient_leans_on_the_wall(light, chart, fill, least):
    """It touched nothing when it was looked for from one point only: a shape with 1 to 2 % more energy."""
    looked = look_up(light, 24.0, tamponades()["light"].toward(down_of(90.0, 0.0)), fill)
    retina, superior, inferior, _ = chart.shares(looked.margin)
    assert retina > least and superior > 0.15 and inferior < 0.01


def test_a_bubble_of_gas_that_shrinks_keeps_to_the_top(chart):
    shares = [chart.shares(look_up(tables_of("gas"), 24.0, np.array([0.0, 1.0, 0.0]), fill).margin)
              for fill in (0.05, 0.1, 0.2, 0.3)]
    whole = [one[0] for one in shares]
    assert whole == pytest.approx([0.07, 0.12, 0.21, 0.29], abs=0.02) and np.diff(whole).min() > 0.03
    assert all(one[2] < 0.01 for one in shares) and all(one[3] < 0.01 for one in shares[:3])


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "fill", "posture", "pitch", "roll", "length"), (
    ("light", 0.85, "upright", 0.0, 0.0, 24.0), ("heavy", 0.75, "left_side", 0.0, -90.0, 24.0),
    ("gas", 0.35, "upright", 0.0, 0.0, 22.5), ("light", 0.93, "prone", -90.0, 0.0, 27.0)))
def test_the_tables_say_what_the_library_says(name, fill, posture, pitch, roll, length):
    liquid = {"light": "silicone_oil_1000", "heavy": "heavy_oil_densiron_68", "gas": "air"}[name]
    kind, eye = tamponades()[name], Eye(axial_length=1e-3 * length)
    shares = pipeline.oil_at_rest(liquid, fill, posture, eye={"axial_length": 1e-3 * length},
                                  tension=kind.liquids.tension, contact_angle=kind.liquids.contact_angle).shares
    looked = look_up(tables_of(name), length, kind.toward(down_of(pitch, roll)), fill)
    for value, part in zip(Chart.of(cavity_of(eye)).shares(looked.margin), ("retina", "superior", "inferior"),
                           strict=False):
        assert value == pytest.approx(shares[part], abs=0.01), part


def test_settings_between_the_tables_are_as_far_off_as_is_told():
    errors = Errors.read()
    off, surface = np.abs(errors.off), errors.surface
    near = np.array([abs(float(row[0]) - 24.0) <= 1.0 for row in errors.rows])
    assert len(off) >= 190 and near.sum() > 40
    assert off[near, 0].max() < 0.01 and off[:, 0].max() < 0.03 and np.percentile(off[~near, 0], 95.0) < 0.01
    assert np.percentile(off[:, 1:3], 90.0, axis=0).max() < 0.015 and np.median(off, axis=0).max() < 0.005
    assert np.percentile(surface[:, 0], 95.0) < 0.3 and np.percentile(surface[:, 1], 75.0) < 0.3  # mm


def test_errors_are_read_as_they_were_written_and_told_on_the_page(tmp_path):
    row = ["26.5", "gas", "40", "10", "-20", "40.00", "39.00", "50.00", "50.50", "30.00", "30.00", "0.00", "0.00",
           "0.050", "0.120", "0.410"]
    assert len(row) == len(HEADS)
    Errors([row, [*row[:-3], "0.150", "0.280", "0.610"]]).write(tmp_path)
    read = Errors.read(tmp_path)
    assert read.off[0] == pytest.approx([0.01, -0.005, 0.0, 0.0])
    assert read.surface.tolist() == [[0.05, 0.12, 0.41], [0.15, 0.28, 0.61]]
    said = " ".join(read.parts())
    assert "2 random settings" in said and "<td>0.10</td>" in said and "<td>0.6</td>" in said
    assert "No setting" in " ".join(Errors.read(tmp_path / "none").parts())
    assert read.usual == [0.01, 0.005, 0.005, 0.005]  # no less than half a point is told


def test_the_free_surface_of_a_lattice_is_where_it_is():
    """A plane, aslant in the eye, is found again within 0.05 mm, and so is its distance to another one."""
    wall, meridian, normal = cavity_of(eyes()["24"], DRAFT), 30.0, np.array([0.6, 0.0, -0.8])
    lattice = Lattice.of(wall)
    one, other = (Interface.drawn(lattice.points @ normal - height, lattice, meridian, wall)
                  for height in (1e-3, 1.4e-3))
    assert np.abs(one.point @ (normal @ across(meridian)) - 1e-3).max() < 5e-5
    assert np.linalg.norm(one.point, axis=1).max() < 12e-3 and len(one.point) > 1000
    assert one.apart(other)[:2] == pytest.approx([0.4e-3] * 2, abs=3e-5)


def test_the_page_finds_what_is_found_here(light, known, tmp_path):
    found = in_node("""
      const model = explorerModel(given.known), eyes = await Promise.all(given.known.eyes.map(model.eyeOf));
      return given.settings.map(([length, fill, pitch, roll]) => {
        const eye = model.eyeBetween(eyes, length), toward = gravity(pitch, roll).map(part => -part);
        const looked = model.lookUp(eye, eye.tablesOf("light"), toward, fill), depth = looked.depth();
        return {...looked, margin: [...looked.margin], depth: [...depth], points: eyeSurfaces(model, eye).free(
          depth, looked.meridian).points};
      });""", {"known": known, "settings": SETTINGS}, tmp_path)
    for (length, fill, pitch, roll), one in zip(SETTINGS, found, strict=True):
        here, wall = look_up(light, length, -down_of(pitch, roll), fill), cavity_of(Eye(axial_length=1e-3 * length))
        assert np.array(one["margin"]) == pytest.approx(here.margin.ravel(), abs=2e-6)
        shares = Chart.of(wall).shares(here.margin)  # the page has measures of the eye between those of the tables
        assert one["shares"][:3] == pytest.approx(shares[:3], abs=1e-3)
        assert one["shares"][3] == pytest.approx(shares[3], abs=1e-2)
        depth = np.array(one["depth"]).reshape(SIZE[0], -1, SIZE[2])
        assert depth[:, SIZE[1] - 1:] == pytest.approx(here.depth, abs=2e-6)
        assert depth[:, SIZE[1] - 1::-1] == pytest.approx(here.depth, abs=2e-6)
        for name in ("low", "high", "shift"):
            assert one[name] == pytest.approx(getattr(here, name), abs=1e-6)
        drawn = Interface.drawn(here.depth, Lattice.of(wall), here.meridian, wall)
        points = np.array(one["points"])
        inside = points[np.linalg.norm(points, axis=1) < 0.9 * np.linalg.norm(wall.wall, axis=1).min()]
        assert np.percentile(drawn.distance(inside), 95.0) < 5e-5 if len(inside) else len(points)


@pytest.mark.thorough
@pytest.mark.parametrize(("place", "posture", "pitch", "roll"), (
    ("6h,60deg", "upright", 0, 0), ("2h,90deg", "left_side", 0, -90), ("9h,40deg", "prone", -90, 0)))
def test_the_page_finds_the_smallest_fill_of_a_plan(known, tmp_path, place, posture, pitch, roll):
    hour, latitude = re.findall(r"\d+", place)
    found = in_node("""
      const model = explorerModel(given.known), eyes = await Promise.all(given.known.eyes.map(model.eyeOf));
      return model.smallestFill(model.eyeBetween(eyes, 24).tablesOf("light"), gravity(given.pitch, given.roll).map(
        part => -part), model.pointsOf(given.tear), given.known.wanted);""",
                    {"known": known, "pitch": pitch, "roll": roll,
                     "tear": {"hour": int(hour), "latitude": int(latitude), "width": 1, "height": 10}}, tmp_path)
    plan = plan_fill(place, "1h,10deg", oils=["silicone_oil_1000"], postures=[posture])
    assert max(found[0], 0.5) == pytest.approx(plan.answers[0].fill, abs=0.02)  # a plan begins at 50 %
    assert found[1] <= found[0] <= found[2]


@pytest.mark.thorough
def test_links_carry_the_setting_and_bad_ones_give_words(known, tmp_path):
    links = ["", "#fill=72.5&tamponade=heavy&eye=24&side=left&pitch=-45&roll=10&break=2.5,80,2,12", "#fill=120",
             "#tamponade=water", "#eye=35", "#pitch=x&colour=red", "#break=1,2", "#break=6,114,1,20", "#break=none",
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
    assert "35 mm" in said[2] and "29 mm is shown" in said[2] and bad[2][0]["eye"] == 29
    assert "not a number" in said[3] and '"colour"' in said[3]
    assert "hour, latitude, width and height" in said[4]
    assert "beyond the ora serrata" in said[5] and bad[5][0]["tear"]["latitude"] == 105
    assert said[6] == "" and bad[6][0]["tear"] is None
    assert all(said[7:])
    fewer = known | {"eyes": [{"name": "22", "tables": {"light": "-"}}, {"name": "24", "tables": {"gas": "-"}}]}
    changed, words = in_node("const read = page.readLink('#eye=22&tamponade=gas', given.start, given);"
                             "return [read.found, read.said];", fewer, tmp_path)
    assert changed["eye"] == 24 and "tables of gas for an eye of 24 mm only" in " ".join(words)


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
    computed = []
    chart = SimpleNamespace(shift=lambda margin, change: 0.0)

    def shape_at(views, tamponade, meridian, tilt, fill):
        computed.append((tilt, meridian))
        field = np.broadcast_to(np.arange(HALF) * 1e-4, (len(LATITUDES), HALF))
        return None if fill == FILLS[0] else Shape(field, np.full(SIZE, 1e-3), np.zeros(4), np.zeros(4), np.ones(4))

    monkeypatch.setattr(tables, "shape_at", shape_at)
    kinds, folders, count = {"gas": tamponades()["gas"]}, {"gas": tmp_path}, tables.count()
    first = make(None, chart, kinds, folders, lambda count: None)["gas"]
    assert len(computed) == count
    again = make(None, chart, kinds, folders, lambda count: None)["gas"]
    assert len(computed) == count
    for one, other in zip(dataclasses.astuple(first), dataclasses.astuple(again), strict=True):
        assert np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    quarter = HALF // 2
    whole = first.margin[0, 0, 1, 0].astype(int)
    assert np.array_equal(first.margin[0, 1, 1, 0], (whole[abs(quarter - np.arange(HALF))]
                          + np.append(whole, whole[-2::-1])[quarter + np.arange(HALF)] + 1) // 2)
    assert look_up({"24": first}, 24.0, np.array([0.0, 1.0, 0.0]), FILLS[0]) is None


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
        alone = "document.querySelector('.several').hidden"
        assert browser.run(alone) is True
        browser.run("location.hash = '#fill=60&pitch=90&eye=22'")  # on the back the oil may lean up or down
        assert comes(f"!{alone}")
        browser.run("location.hash = '#fill=120&pitch=90'")
        assert comes("document.querySelector('.message').textContent.includes('98.5 % is shown')")
        assert comes("location.hash.includes('fill=98.5')")
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
        browser.run("(() => { const one = document.querySelector('input[name=eye]'); one.value = 27; "
                    "one.dispatchEvent(new Event('input')); })()")
        assert comes("location.hash.includes('eye=27')")
        views.append(browser.run("document.querySelector('.shape canvas').toDataURL()"))
        assert len(set(views)) == len(views)
        assert browser.requests() == [] and browser.errors() == []
    finally:
        browser.close()
