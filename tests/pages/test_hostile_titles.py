"""What a scene may say in words survives every stage that draws or writes it, and stays text."""
import ast
import dataclasses

import numpy as np
import pytest
from conftest import ROOT
from PIL import Image, ImageDraw

from pipeline import bodies, cost
from pipeline.advice import report
from pipeline.exchange.paraview_view import view_script
from pipeline.measures import plots
from pipeline.measures.metric import Metric
from pipeline.measures.shown import shown_metrics
from pipeline.measures.summary import write_summary
from pipeline.pictures.marks import font, header
from pipeline.scenes.load import load_scene
from pipeline.studies import report as study_report
from pipeline.studies.model import Curve, Figure, Outcome
from pipeline.studies.plan import load_study

SCRIPT = "<script>alert(1)</script>"
TITLES = (f'{SCRIPT} & "quotes" {{{{ 7 * 7 }}}}',
          "unbalanced $x_{ and \\frac{ $ in $ $ " + "a long $x_{ title " * 8 + "\\$",
          "\U0001f600 e\u0301 \u202e \u0627\u0644 \uffff",
          "@scene@ @folder@ %s {0} \\", "long " * 39)
TABLE = {"time [s]": np.array([0.0, 1.0]), "frame": np.array([0.0, 1.0]), "speed [m/s]": np.array([0.0, 2.0])}


@pytest.fixture(params=TITLES)
def scene(request):
    """A scene with a title that some stage could take for something else."""
    plain = load_scene(ROOT / "config" / "scenes" / "still_eye.yaml", "draft")
    liquids = tuple(dataclasses.replace(one, source=request.param) for one in plain.liquids)
    words = request.param.strip()
    return dataclasses.replace(plain, title=words, label=words, description=words, liquids=liquids)


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore:Glyph")
def test_plots_and_pictures_survive_any_title(scene, tmp_path):
    shown = shown_metrics(TABLE, [Metric("speed", "m/s", "", None, place=1)])
    plots.write_plots(tmp_path / "plots", shown, TABLE, [], scene.title)
    bodies.write_plot(tmp_path / "bodies.png", [], scene)
    study_report._draw(tmp_path / "figure.png", Figure("a", "A", "x", "y", logarithmic=True),
                       [Curve("a", scene.title, [1.0, 2.0], [1.0, 2.0])])
    for path in (tmp_path / "plots" / "speed.png", tmp_path / "plots" / "overview.png", tmp_path / "bodies.png",
                 tmp_path / "figure.png"):
        assert np.ptp(np.asarray(Image.open(path).convert("L"))) > 0


def test_titles_fit_into_pictures(scene):
    """Nothing of the title reaches the clock, and nothing of the label the subtitle."""
    for width, height in ((320, 180), (1280, 720)):
        image = Image.new("RGB", (width, height), "white")
        header(ImageDraw.Draw(image), image.size, title=scene.title, time="", subtitle="", label=scene.label)
        dark = np.asarray(image.convert("L")) < 128
        lines = np.split(dark, [round(0.068 * height)])
        reach = [np.flatnonzero(line.any(axis=0)) for line in lines]
        assert reach[0].max() <= 0.64 * width + 2 and reach[1].min() >= 0.64 * width - 2, (width, font(6).size)


def test_pages_show_titles_as_text(scene, tmp_path):
    shown = shown_metrics(TABLE, [Metric("speed", "m/s", "", None, place=1)])
    write_summary(tmp_path / "metrics.html", shown, TABLE, scene)
    study = dataclasses.replace(load_study("validation"), title=scene.title, description=scene.description)
    study_report._write_page(tmp_path / "table.html", study, [Outcome(remarks=[scene.title])], [])
    pages = [path.read_text() for path in tmp_path.glob("*.html")]
    pages += [report.html_of(report.report_of(scene, 5e-6)),
              cost.page_of(scene, [], [])]
    for page in pages:
        assert SCRIPT not in page and "<h1>" in page and "&lt;script&gt;" * (SCRIPT in scene.title) in page


def test_script_for_paraview_holds_titles_as_text(scene, tmp_path):
    script = view_script(scene, tmp_path, painted=True)
    assert script.encode() and f"{scene.title} (draft)" in [
        node.value for node in ast.walk(ast.parse(script)) if isinstance(node, ast.Constant)]
