"""Pages of advice, of a plan and on a question in a browser: nothing cut, no request, folded, and printed whole."""
import io

import pytest
from conftest import ROOT
from helpers import headless_browser
from markupsafe import Markup
from PIL import Image

from pipeline.advice import report as advice
from pipeline.base import page
from pipeline.planning import report as plan
from pipeline.planning.plan import plan_fill
from pipeline.scenes.load import load_scene
from pipeline.studies.question_page import WORDS, QuestionPage

WIDTHS = (1400, 800, 390)
SEEN = "[...document.querySelectorAll('details')].map(one => one.lastElementChild.checkVisibility())"


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """Files of pages, by name."""
    folder, picture = tmp_path_factory.mktemp("pages"), io.BytesIO()
    Image.new("RGB", (1400, 500), (40, 120, 190)).save(picture, "PNG")
    found = plan_fill("6h,60deg", "2h")
    table = page.table(("what", *(f"a rather long head {number}" for number in range(12))), [("one", *range(12))])
    question = QuestionPage("What is asked?", ["The answer is <b>42</b> %."], picture.getvalue(), "a picture",
                            ["What it shows."], {"All numbers": table}, ["Nothing."], [Markup("<b>All</b> of it")],
                            "the rest", tuple(WORDS))
    scene = load_scene(ROOT / "config" / "scenes" / "tamponade.yaml", "draft")
    texts = {"advice": advice.html_of(advice.report_of(scene, 5e-6)),
             "plan": plan.html_of(found.question, found.answers, found.eye, []),
             "question": page.page("A question", question.parts())}
    for name, text in texts.items():
        (folder / f"{name}.html").write_text(text)
    return {name: folder / f"{name}.html" for name in texts}


def test_answers_are_text_and_come_before_the_picture(pages):
    text = pages["question"].read_text()
    assert "<li>The answer is &lt;b&gt;42&lt;/b&gt; %.</li>" in text and "<li><b>All</b> of it</li>" in text
    assert text.index("The answer is") < text.index("<img") < text.index("<details")


@pytest.mark.thorough
def test_pages_fit_any_window_and_print_what_is_folded(pages, tmp_path):
    path = headless_browser.find_browser()
    if path is None:
        pytest.skip("no Chromium on this machine")
    browser = headless_browser.Browser(path, tmp_path / "profile")
    try:
        for name, file in pages.items():
            browser.call("Emulation.setEmulatedMedia", media="", features=[
                {"name": "prefers-color-scheme", "value": "dark"}])
            for width in WIDTHS:
                browser.open(file, width, phone=width == WIDTHS[-1])
                assert browser.run("document.documentElement.scrollWidth") <= width, (name, width)
            assert browser.run("getComputedStyle(document.body).backgroundColor") == "rgb(20, 24, 30)"
            assert not any(browser.run(SEEN)), f"{name}: folded at first"
            browser.run("document.querySelector('summary').click()")
            assert browser.run(SEEN)[0], f"{name}: opens on a click"
            browser.call("Emulation.setEmulatedMedia", media="print", features=[
                {"name": "prefers-color-scheme", "value": "dark"}])
            browser.open(file, 720)
            assert browser.run("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
            assert all(browser.run(SEEN)), f"{name}: paper cannot be clicked"
        assert browser.requests() == [] and browser.errors() == []
    finally:
        browser.close()
