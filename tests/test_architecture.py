"""The page on architecture is that of the code: its drawing, its table of rooms, and every file that it names."""
import re
import sys

import pytest
from conftest import ROOT

sys.path.insert(0, str(ROOT / "docs"))
import draw_architecture

PAGE = draw_architecture.PAGE.read_text(encoding="utf-8")
AGAIN = "run: python docs/draw_architecture.py"


def test_drawing_is_that_of_the_code():
    assert draw_architecture.DRAWING.read_text(encoding="utf-8") == draw_architecture.drawing(), AGAIN


def test_table_of_rooms_is_that_of_the_code():
    assert draw_architecture.with_table(PAGE) == PAGE, AGAIN


def test_every_room_says_what_it_is_for():
    rooms = draw_architecture.packages()
    assert [name for name, folder in rooms.items() if not draw_architecture.meaning(folder)] == []


def test_arrows_are_imports_and_lead_down():
    graph = draw_architecture.arrows()
    assert graph.has_edge("pipeline.scenes", "pipeline.base") and "sim" in graph and not graph.out_edges("sim")
    rows, pieces = draw_architecture.layers(graph)
    row = {one: place for place, names in enumerate(rows) for one in names}
    assert all(row[end] == row[start] + 1 for start, end in pieces.edges)


def test_long_arrows_pass_between_the_boxes():
    rows, pieces = draw_architecture.layers(draw_architecture.arrows())
    corners = [one for one in pieces if isinstance(one, tuple)]
    assert corners and all(pieces.in_degree(one) == pieces.out_degree(one) == 1 for one in corners)
    assert sum(map(len, rows)) == len(pieces)


@pytest.mark.parametrize("page", ["docs/architecture.md", "CONTRIBUTING.md"])
def test_files_that_are_named_exist(page):
    text = re.sub(r"^```.*?^```", "", (ROOT / page).read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    folders = "|".join(path.name for path in ROOT.iterdir() if path.is_dir() and not path.name.startswith("."))
    named = re.findall(rf"`((?:{folders})/[\w./]*)`", text)
    assert len(named) > 3
    assert [one for one in named if not (ROOT / one).exists() and not one.startswith("outputs/")] == []
