"""The site of the documents: built without a warning, whole, found by words of users, and without a network."""
import doctest
import importlib
import re
import subprocess
import sys
import time
import urllib.parse
from pathlib import Path

import pytest
from conftest import ROOT
from helpers.headless_browser import Browser, find_browser

SOUGHT = {  # words of users -> a page among the first five
    "tamponade": "results/eye", "cluster": "guide/clusters", "STL": "guide/files",
    "accuracy": "guide/start", "Blender": "guide/files", "out of memory": "guide/trouble", "saccade": "guide/effects",
    "buckle": "guide/scenes", "gas": "guide/scenes",
    "posture": "guide/scenes", "break": "guide/clinic", "powerpoint": "tutorials/slide", "oil_at_rest": "api/library",
}
FIRST = {  # words of users -> the first page
    "retina": "guide/clinic", "slip": "methods/viscosity", "contact angle": "guide/effects", "GPU": "guide/start",
    "own eye": "tutorials/own_eye", "movie": "guide/files", "fill": "guide/clinic", "supine": "guide/scenes",
    "license": "cite", "resume": "guide/trouble", "how long": "guide/trouble", "install": "guide/start",
}


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """Build the site, as `./run docs` does; every warning is an error."""
    pytest.importorskip("sphinx", reason="`./run docs` installs what builds the site")
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run([sys.executable, "-m", "sphinx", "--fail-on-warning", "--keep-going", "--quiet", "-d",
                           folder / "doctrees", "docs", folder / "html"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder / "html"


@pytest.fixture
def browser(tmp_path):
    """Return a browser; without one its tests are skipped."""
    found = find_browser()
    if found is None:
        pytest.skip("no Chromium here")
    opened = Browser(found, tmp_path / "profile")
    yield opened
    opened.close()


def test_equations_break_at_their_wide_spaces(monkeypatch):
    """The examples in the settings of the site."""
    pytest.importorskip("ziamath", reason="`./run docs` installs what builds the site")
    monkeypatch.syspath_prepend(ROOT / "docs")
    tried = doctest.testmod(importlib.import_module("conf"))
    assert tried.attempted and not tried.failed


@pytest.mark.thorough
def test_every_link_leads_to_a_file_and_a_place_in_it(site):
    text = {page: page.read_text(encoding="utf-8") for page in site.rglob("*.html") if "_static" not in page.parts}
    places = {page: set(re.findall(r'\sid="([^"]+)"', words)) for page, words in text.items()}
    wrong = []
    for page, words in text.items():
        for target in re.findall(r'\s(?:href|src)="([^"]+)"', words):
            file, _, place = urllib.parse.unquote(target).partition("#")
            if re.match(r"\w+:", target) or (page.stem == "notebook" and target.startswith("outputs/")):
                continue  # elsewhere; or a file of the run that the notebook shows
            linked = (page.parent / file.partition("?")[0]).resolve() if file else page
            if not linked.exists() or (place and linked in places and place not in places[linked]):
                wrong.append(f"{page.relative_to(site)}: {target}")
    assert len(text) > 60 and wrong == []


@pytest.mark.thorough
def test_nothing_is_loaded_from_elsewhere(site):
    loaded = r'<(?:script|img|iframe|source)[^>]*\ssrc="\w+://|<link[^>]*rel="(?:stylesheet|preload)"[^>]*href="\w+://'
    assert [page.name for page in site.rglob("*.html") if re.search(loaded, page.read_text(encoding="utf-8"))] == []
    assert [page.name for page in site.rglob("*.css") if re.search(r"url\(['\"]?(?:\w+:)?//", page.read_text())] == []


@pytest.mark.thorough
def test_pages_fit_a_phone_and_ask_no_network(site, browser):
    for page in ("index", "guide/clinic", "methods/interface_tension", "results/eye", "api/library", "architecture"):
        browser.open(site / f"{page}.html", 390, phone=True)
        assert browser.run("document.documentElement.scrollWidth") <= 390, page
    assert browser.requests() == []


@pytest.mark.thorough
def test_words_of_users_find_their_page(site, browser):
    wrong = {}
    for words, page in (SOUGHT | FIRST).items():
        first = found(browser, site, words)
        if page not in first[:1 if words in FIRST else 5]:
            wrong[words] = first[:5]
    assert wrong == {} and browser.requests() == []


def found(browser: Browser, site: Path, words: str) -> list[str]:
    """Pages that the search finds, the best first."""
    browser.open(site / "search.html", 1400)
    browser.call("Page.navigate", url=f"{(site / 'search.html').as_uri()}?q={urllib.parse.quote(words)}")
    end = time.monotonic() + 20.0
    while not (links := browser.run("document.querySelector('.search-summary')?.innerText ? "
                                    "[...document.querySelectorAll('ul.search li > a')].map(a => a.href) : null")):
        assert time.monotonic() < end, words
        time.sleep(0.05)
    return [re.sub(r"\.html.*", "", link).removeprefix(f"{site.as_uri()}/") for link in links]
