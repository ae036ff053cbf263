"""The page of a run holds what it shows, asks no network for anything, and works in a browser."""
import base64
import dataclasses
import io
import json
import re
import shutil

import numpy as np
import pytest
from conftest import ROOT
from helpers import headless_browser
from helpers.synthetic_frames import RADIUS, SPACING, ball, frame_of, lattice, oil_fraction
from PIL import Image

from pipeline import metrics, movie, page
from pipeline.base.errors import UserError
from pipeline.base.frame_files import frame_path, write_frame
from pipeline.base.page import RUN_PAGES
from pipeline.base.vtk_files import write_vtk
from pipeline.cavity.initial_state import save_initial
from pipeline.forecast.expected_error import ExpectedError
from pipeline.measures.least_energy import LeastEnergy
from pipeline.measures.metric import Metric
from pipeline.measures.shown import shown_metrics
from pipeline.pages.headlines import headlines, headlines_of
from pipeline.pages.movie_copy import movie_within
from pipeline.pages.turning_view import break_bands, turning_view
from pipeline.pictures.fundus_map import BREAK_COLOR
from pipeline.reconstruct import Wall, write_surfaces
from pipeline.runs.run_folder import RunFolder
from pipeline.scenes.effects import illustration_in_words
from pipeline.scenes.load import load_scene
from pipeline.scenes.model import Break
from pipeline.scenes.retina import Patch
from pipeline.surfaces.liquid_surface import Reconstructor

FRAMES = 5
TITLE = 'Oil <b>& "water"</b></script>'
HOSTILE = "<script>alert(1)</script> $x_{ {{ 7 * 7 }} 😀"
WIDTHS = (1400, 390)
CANVAS = "document.querySelector('.turning canvas').toDataURL()"
PAPER = "getComputedStyle(document.body).backgroundColor"
TEAR = Break("tear", hour=6.0, latitude=np.radians(60.0), width=2.0)


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory, taichi):
    """Return the folder of a run whose oil floats, made without a simulation."""
    import pyvista

    folder = tmp_path_factory.mktemp("outputs") / "tiny" / "draft"
    scene = load_scene(ROOT / "config" / "scenes" / "tiny.yaml", "draft")
    scene = dataclasses.replace(
        scene, title=TITLE, label=HOSTILE, description=HOSTILE, breaks=(TEAR,),
        numerics=dataclasses.replace(scene.numerics, particle_spacing=SPACING),
        output=dataclasses.replace(scene.output, frames_per_segment=FRAMES))
    folder.mkdir(parents=True)
    (folder / "scene.json").write_text(scene.to_json())
    save_initial(folder / "initial.npz", ball())
    eye = pyvista.Icosphere(radius=RADIUS, nsub=3)
    write_vtk(eye, folder / "eye.vtp")
    frames, images, surfaces = (folder / name / "segment_000" for name in ("frames", "images", "surfaces"))
    images.mkdir(parents=True)
    surfaces.mkdir(parents=True)
    position, reconstructor, wall = lattice(), Reconstructor(ball(), 2), Wall(scene, ball(), eye)
    for index in range(FRAMES):
        time = index * scene.output.frame_interval
        frame = frame_of(position, oil_fraction(position, height=5e-3 - 1e-3 * index), time=time)
        frame = dataclasses.replace(frame, statistics={"time_step": 1e-3, "pressure_iterations": 7.0 + index})
        path = frame_path(frames, index)
        write_frame(path, frame)
        write_surfaces(surfaces, path, frame, reconstructor, wall=wall)
        Image.new("RGB", (320, 180), (50 * index, 100, 200)).save(images / f"frame_{index:05d}.png")
    metrics.main([str(folder / "scene.json"), str(folder / "initial.npz"), str(frames), "--output",
                  str(folder / "metrics.csv"), "--meanings", str(folder / "metrics.json"), "--eye",
                  str(folder / "eye.vtp")])
    movie.main([str(images), "--scene", str(folder / "scene.json"), "--output", str(folder / "movie.mp4"), "--poster",
                str(folder / "poster.png")])
    Image.new("RGB", (320, 180), (240, 230, 190)).save(folder / "still.png")
    write_costs(folder)
    return folder


def write_costs(folder):
    """Write what the simulation and the stages say of a run."""
    for name in ("costs", "logs"):
        (folder / name).mkdir()
    (folder / "costs" / "segment_000.json").write_text(
        json.dumps({"steps": 200, "particles": 3216, "device": "cpu", "frames": []}))
    (folder / "logs" / "simulate_000.log.json").write_text(json.dumps({"wall": 10.0, "cpu": 20.0, "memory": 3e8}))


@pytest.fixture(scope="module")
def index(run_folder):
    """Return the page of that run."""
    errors = (ExpectedError("covered retina at rest", 3.0, "points of the retina", "within 3 points of the retina",
                            "measured on tamponade"),
              ExpectedError("laplace: pressure jump", 0.004, "1", "0.4 %", "a table"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pipeline.page.errors_of", lambda scene, volume: errors)
        page.main([str(run_folder), "--source", str(ROOT / "config" / "scenes" / "tests" / "tiny.yaml")])
    return run_folder / "index.html"


@pytest.mark.thorough
def test_page_holds_all_that_it_shows(index):
    text = index.read_text()
    assert len(text.encode()) < 10e6
    shown = re.findall(r'<(?:img|video|script|source|iframe|link)\b[^>]*?\b(?:src|href|poster)="([^"]{0,40})', text)
    assert len(shown) > 5 and all(address.startswith("data:") for address in shown)
    assert "default-src 'none'" in text and not re.search(r'url\(["\']?http', text)
    links = set(re.findall(r'<a href="([^"]*)"', text))
    assert links >= RUN_PAGES.keys() - {"index.html"} and not any(":" in link for link in links)


@pytest.mark.thorough
def test_page_says_first_what_people_ask_for(index):
    text = index.read_text()
    numbers = re.findall(r"<li><b>([^<]*)</b> ([^<]*)<small>calculated resting shape: ([^<]*)</small>", text)
    assert [meaning.partition(":")[0] for _, meaning, _ in numbers] == [
        "of the retina is under oil", "of its inferior half", "of the macula"]
    assert re.search(r": it touches [\d.]+ %, [\d.]+ % are on a film of aqueous of [\d.]+ to \d+ µm$", numbers[0][1])
    assert all(re.fullmatch(r"\d+(\.\d)? ± \d+(\.\d)? %", number) for number, *_ in numbers)
    for number, _, rest in numbers:     # what the run has less or more is the difference of what is shown
        known, apart = re.fullmatch(r"([\d.]+)\u00a0%, (.*) here", rest).groups()
        less = 0.0 if apart == "the same" else float(apart.partition(" percentage points ")[0])
        assert less == pytest.approx(abs(float(number.partition(" ")[0]) - float(known)), abs=1.0)
        assert apart == "the same" or apart.endswith("less") == (float(number.partition(" ")[0]) < float(known))
    places = [text.index(words) for words in (
        "<b>This is an illustration of physics, not for decisions on a patient.</b>", 'class="still"',
        "of the retina is under oil", "<video", "What was done to the eye", "Fundus over time",
        "<canvas", "<h2>Over time", "<h2>Numbers",
        "retina coverage whole</td>", "Numbers of the computation</summary>", "pressure iterations</td>",
        "<h2>Errors to expect", "<b>covered retina at rest: within 3 points", "Errors of simpler flows",
        "laplace: pressure jump", "<h2>Cost", "What was simulated", "left out, and why", "Versions",
        "tiny.yaml</summary>", "extends: tamponade", "tamponade.yaml</summary>")]
    assert places == sorted(places)
    assert "0.05 × real time, 1 picture per second, 5 in all, 5.5 s; the scene saves a frame every 0.05 s." in text
    quote = "At this level the covered retina at rest is within 3 points of the retina (measured on tamponade). That is"
    assert "for its halves and the macula no bound is known" in text
    assert text.index('class="numbers"') < text.index(quote) < text.index("<video")


@pytest.mark.thorough
def test_a_number_is_rounded_once(index):
    text = index.read_text()
    (first, touched, film), = re.findall(
        r"<b>([^<]*) %</b> of the retina is under oil: it touches ([\d.]+) %, ([\d.]+) %", text)
    for name, number in (("coverage", first), ("contact", touched), ("film", film)):
        row = text[text.index(f"retina {name} whole</td>"):].partition("</tr>")[0]
        assert row.split("<td>")[2].startswith(f"{number}</td>"), name
        told = json.dumps(number)
        assert f"{told}]" in text[text.index("showCharts(document"):], name  # what the curve tells at its end


@pytest.mark.thorough
def test_inherited_turns_are_told_with_the_file_that_says_so(index):
    line = r'<div role="listitem"><span>([^<]*)(?: <small>([^<]*)</small>)?</span><span class="when">([^<]*)'
    lines = re.findall(line, index.read_text())
    assert ("supine", "(from tamponade.yaml)", "throughout") in lines
    assert any(words == "silicone oil 1000 flows in" and "tamponade.yaml" in file for words, file, _ in lines)


@pytest.mark.thorough
def test_a_run_that_is_half_there_says_so(run_folder, index, tmp_path):
    half = tmp_path / "tiny" / "draft"
    shutil.copytree(run_folder, half)
    for folder in ("images", "surfaces", "frames"):
        for path in (half / folder / "segment_000").glob("frame_0000[34]*"):
            path.unlink()
    (half / "still.png").unlink()
    scene = json.loads((half / "scene.json").read_text())
    scene["output"]["frames_per_segment"] = 2  # the second segment is not there yet
    (half / "scene.json").write_text(json.dumps(scene))
    page.main([str(half), "--source", str(ROOT / "config" / "scenes" / "tests" / "tiny.yaml")])
    text = (half / "index.html").read_text()
    assert "This run is not finished: 3 of 5 frames are drawn, up to t = 0.10 s of 0.20 s." in text
    assert "not finished" not in index.read_text()


@pytest.mark.thorough
def test_titles_are_text(index):
    text = index.read_text()
    assert text.count("&lt;script&gt;alert(1)&lt;/script&gt; $x_{ {{ 7 * 7 }} 😀") == 2 and "<script>alert" not in text
    assert "<h1>Oil &lt;b&gt;&amp; &#34;water&#34;&lt;/b&gt;&lt;/script&gt;</h1>" in text and "Oil <b>" not in text


def test_what_is_missing_is_a_sentence(run_folder, tmp_path):
    with pytest.raises(UserError, match=r"nowhere.yaml: no such file; name the file of the scene with --source"):
        page.main([str(run_folder), "--source", str(tmp_path / "nowhere.yaml")])
    with pytest.raises(UserError, match="holds no run; run the scene at this level first"):
        page.main([str(tmp_path)])


def test_a_scene_without_an_eye_tells_what_changes():
    known = [Metric("speed", "mm/s", "", None, place=2), Metric("still", "1", "", None, place=1),
             Metric("rate", "1", "", None, place=3, effect="some"), Metric("steps", "1", "", None)]
    table = {"speed_rms [mm/s]": np.array([0.0, 12.34]), "still [1]": np.ones(2), "rate [1]": np.array([1.0, 2.5]),
             "steps [1]": np.array([1.0, 2.0])}
    found = headlines(shown_metrics(table, known), of_eye=False)
    assert [(one.number, one.meaning) for one in found] == [("2.50", "rate"), ("12.3 mm/s", "speed rms")]


def test_a_large_movie_is_made_smaller(tmp_path):
    random = np.random.default_rng(0)
    for number in range(6):
        Image.fromarray(random.integers(0, 255, (180, 320, 3), np.uint8)).save(tmp_path / f"frame_{number:05d}.png")
    output = tmp_path / "movie.mp4"
    movie.main([str(tmp_path), "--output", str(output), "--fps", "2"])
    whole = output.stat().st_size
    assert movie_within(output, whole) == output.read_bytes()
    assert 0 < len(movie_within(output, whole // 2)) <= whole // 2


def turned_by_a_finger(browser):
    """Whether fingers turn the eye, and leave the page where it is; elsewhere they scroll it, upward only."""
    picture, place = CANVAS, "[scrollX, scrollY, visualViewport.pageLeft]"
    browser.middle(".turning canvas")
    before, views = browser.run(place), [browser.run(picture)]
    for right, down in ((120, 0), (0, -90), (-60, 60)):
        browser.touch(".turning canvas", right, down)
        views.append(browser.run(picture))
        assert browser.run(place) == before, "the page moves while the eye is turned"
    browser.touch("h1", -150, 0)
    assert browser.run("scrollX") == 0, "the page scrolls sideways"
    start = browser.run("scrollY")
    browser.touch("h1", 0, -150)
    assert browser.run("scrollY") > start, "fingers do not scroll the page: the rest says nothing"
    return len(set(views)) == len(views)


def curves_tell_values(browser):
    """Whether the curves tell their last values at first, and others where the mouse is, all at the same time."""
    told = "[...document.querySelectorAll('.chart')].map(one => one.querySelector('.u-value').textContent)"
    assert set(browser.run(told)) == {"0.2"}
    x, y = browser.middle(".chart .u-over")
    browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
    browser.wait_for_drawing()
    return set(browser.run(told)) == {"0.1"}


def the_wheel_zooms_only_what_was_clicked(browser):
    """Whether the wheel scrolls the page over the view, and zooms the view once that has been clicked."""
    def wheel():
        x, y = browser.middle(".turning canvas")
        browser.wait_for_drawing()
        before = browser.run("scrollY"), browser.run(CANVAS)
        browser.call("Input.dispatchMouseEvent", type="mouseWheel", x=x, y=y, deltaX=0, deltaY=-120)
        browser.run("new Promise(done => setTimeout(done, 300))")
        return browser.run("scrollY") != before[0], browser.run(CANVAS) != before[1]

    browser.run("document.activeElement.blur()")
    assert wheel() == (True, False)
    browser.run("document.querySelector('.turning canvas').focus()")
    return wheel() == (False, True)


@pytest.mark.parametrize(("patch", "edge"), [
    (Patch(180.0, 60.0, 60.0, 10.0), 2.0 * np.radians(10.0) + np.pi / 3.0 * (np.sin(np.radians([55, 65])).sum())),
    (Patch(0.0, 0.0, 360.0, 20.0), 2.0 * np.pi * np.sin(np.radians(10.0))),  # around the pole
])
def test_break_is_a_band_along_its_edge_on_the_wall(patch, edge):
    import pyvista

    wall = pyvista.Icosphere(radius=RADIUS, nsub=5)
    band = break_bands(wall, [patch])
    assert band.area == pytest.approx(RADIUS * edge * 0.4e-3, rel=0.05)
    distance = np.linalg.norm(band.points, axis=1)
    assert distance.min() > 0.98 * RADIUS and distance.max() < 0.999 * RADIUS
    # It faces as the wall does, so that it is left out with the nearer half of it.
    for surface in (wall, band):
        surface = surface.triangulate()
        outward = surface.compute_normals(auto_orient_normals=False, consistent_normals=False).cell_data["Normals"]
        assert (np.einsum("kx,kx->k", outward, surface.cell_centers().points) >= 0.0).all()


def test_view_that_turns_has_breaks_only_where_there_are_any(run_folder, index):
    run = RunFolder(run_folder)
    view = turning_view(run)
    legends = [[words for _, words in mesh["legend"]] for mesh in view["meshes"]]
    assert [one["time"] for one in view["frames"]] == [f"t = {0.05 * number:.2f} s" for number in range(FRAMES)]
    assert legends[-1] == ["break of the retina"]
    whole = RunFolder(run_folder)
    vars(whole)["scene"] = dataclasses.replace(run.scene, breaks=())
    assert [[words for _, words in mesh["legend"]] for mesh in turning_view(whole)["meshes"]] == legends[:-1]


@pytest.mark.thorough
def test_page_works_in_a_browser(index, tmp_path):
    path = headless_browser.find_browser()
    if path is None:
        pytest.skip("no Chromium on this machine")
    browser = headless_browser.Browser(path, tmp_path / "profile")
    try:
        for width in WIDTHS:
            browser.open(index, width)
            assert browser.run("document.documentElement.scrollWidth") <= width, "it scrolls sideways"
        assert browser.run("document.querySelectorAll('img').length && [...document.images].every(one => "
                           "one.complete && one.naturalWidth > 0)")
        played = """(async () => { const video = document.querySelector("video"); await video.play();
            await new Promise(done => video.addEventListener("timeupdate", done)); return video.duration; })()"""
        assert browser.run(played) > 4.0
        room = ("(one => one.clientHeight - one.clientWidth * one.videoHeight / one.videoWidth)"
                "(document.querySelector('video'))")
        assert browser.run(room) > 50, "the buttons of the browser cover the legend of the movie"
        moved = """(async number => { const slider = document.querySelector("[data-time]");
            slider.value = number; slider.dispatchEvent(new Event("input"));
            await new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)));
            return [document.querySelector(".turning canvas").toDataURL(),
                    document.querySelector(".turning .when").textContent]; })"""
        assert browser.run("new Promise(done => { const ask = () => document.querySelector('.turning[data-ready]')"
                           " ? done(true) : setTimeout(ask, 50); ask(); })")
        (first, start), (last, end) = (browser.run(f"{moved}({number})") for number in (0, FRAMES - 1))
        assert first != last and (start, end) == ("t = 0.00 s", "t = 0.20 s")
        stepped = """(async name => { const video = document.querySelector("video");
            const button = [...document.querySelectorAll("[data-step]")].find(one => one.textContent.includes(name));
            const sought = () => new Promise(done => video.addEventListener("seeked", done, {once: true}));
            video.pause();
            const middle = sought();
            video.currentTime = 2.5;
            await middle;
            const next = sought();
            button.click();
            await next;
            return video.currentTime - 2.5; })"""
        assert browser.run(f"{stepped}('before')") < 0.0 < browser.run(f"{stepped}('next')")
        views = [browser.run(CANVAS)]
        assert "WebGL" not in browser.run("document.querySelector('.hint').textContent")
        for right, down in ((40, 0), (0, 40)):
            browser.drag(".turning canvas", right, down)
            views.append(browser.run(CANVAS))
        assert len(set(views)) == 3 and len(views[0]) > 5000
        press = """(name => { const buttons = [...document.querySelectorAll(".turning button")];
            buttons.find(one => one.textContent == name).click();
            return new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(
                document.querySelector(".turning canvas").toDataURL())))); })"""
        front, behind = (red_pixels(browser.run(f"{press}('from {place}')")) for place in ("the front", "behind"))
        assert front > 100 and behind == 0, "the break is behind, and seen through the opened front alone"
        browser.run("[...document.querySelectorAll('.turning input[type=checkbox]')].pop().click()")
        assert red_pixels(browser.run(f"{press}('from the front')")) == 0
        assert curves_tell_values(browser)
        assert the_wheel_zooms_only_what_was_clicked(browser)
        light = browser.run(PAPER)
        browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark"}])
        assert (light, browser.run(PAPER)) == ("rgb(255, 255, 255)", "rgb(20, 24, 30)")
        browser.call("Emulation.setEmulatedMedia", media="print")
        assert browser.run(PAPER) == light, "paper is white"
        browser.call("Emulation.setEmulatedMedia", media="", features=[])
        browser.open(index, WIDTHS[-1], phone=True)
        assert turned_by_a_finger(browser)
        assert browser.requests() == [] and browser.errors() == []
    finally:
        browser.close()


def red_pixels(address):
    """Count the pixels of a picture, a data URL, in the color of breaks, lit or shaded."""
    pixels = np.asarray(Image.open(io.BytesIO(base64.b64decode(address.split(",")[1]))).convert("RGB"), float)
    shade = pixels.max(axis=2)
    alike = np.abs(pixels / np.maximum(shade, 1.0)[..., None] - np.array(BREAK_COLOR) / max(BREAK_COLOR)).max(axis=2)
    return int(((alike < 0.05) & (shade > 80.0)).sum())


def test_a_picture_of_an_emulsion_has_no_numbers_in_its_head():
    """Only mixing is sped up there; in a day of postures the turns are, and numbers mean what they say."""
    scenes = ROOT / "config" / "scenes"
    table = {"time [s]": np.array([0.0, 1.0]), "retina_coverage_whole [%]": np.array([40.0, 50.0])}
    shown = shown_metrics(table, [Metric("retina_coverage", "%", "", None)])
    for name, illustrates in (("emulsification", True), ("s1_emulsification", True), ("day_of_postures", False),
                              ("emulsification_contact_line", False), ("tamponade", False)):
        scene = load_scene(scenes / f"{name}.yaml", "draft")
        assert bool(illustration_in_words(scene)) == illustrates == (not headlines_of(scene, shown))


@pytest.mark.parametrize(("density", "word"), [(970.0, "oil"), (1.2, "gas")])
def test_headlines_name_what_covers_the_retina(density, word):
    scene = load_scene(ROOT / "config" / "scenes" / "still_eye.yaml", "draft")
    oil = dataclasses.replace(scene.liquids[1], density=density)
    scene = dataclasses.replace(scene, liquids=(scene.liquids[0], oil))
    table = {"time [s]": np.array([0.0, 1.0]), "retina_coverage_whole [%]": np.array([40.0, 50.0])}
    found = headlines_of(scene, shown_metrics(table, [Metric("retina_coverage", "%", "", None)]))
    assert [one.meaning for one in found] == [f"of the retina is under {word}"]
    resting = LeastEnergy(0.85, "upright", {"whole": 67.744})
    found = headlines_of(scene, shown_metrics(table, [Metric("retina_coverage", "%", "", None)]), resting)
    assert [one.at_rest for one in found] == ["68\u00a0%, 18 percentage points less here"]
    table |= {"retina_contact_whole [%]": np.array([40.0, 12.4]), "retina_film_whole [%]": np.array([0.0, 37.6]),
              "retina_film_thickness_smallest [um]": np.array([np.nan, 19.0]),
              "retina_film_thickness_largest [um]": np.array([np.nan, 223.0])}
    meanings = [Metric(name, "%", "", None) for name in ("retina_coverage", "retina_contact", "retina_film")]
    found = headlines_of(scene, shown_metrics(table, [*meanings, Metric("retina_film_thickness", "um", "", None)]))
    assert [(one.number, one.meaning) for one in found] == [
        ("50 %", f"of the retina is under {word}: it touches 12.4 %, 37.6 % are on a film of aqueous of 19 to 223 µm")]
