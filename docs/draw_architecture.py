"""Draw docs/images/architecture.svg and write the table of rooms of docs/architecture.md, from what the code imports.

    python docs/draw_architecture.py

A box is a room of the pipeline or another package. An arrow leads to what a room imports; one that follows from two
others is left out. `tests/test_architecture.py` fails where drawing and table are not those of the code.
"""
import ast
from collections.abc import Iterable
from pathlib import Path

import networkx as nx

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "architecture.md"
DRAWING = ROOT / "docs" / "images" / "architecture.svg"
BEGIN, END = "<!-- rooms, by docs/draw_architecture.py -->", "<!-- end of the rooms -->"
PIPELINE = "pipeline"
WIDE, HIGH, STEP, BEND = 118, 30, 74, 128  # of a box, between layers, between places in a layer; pixels


def packages() -> dict[str, Path]:
    """Return the boxes: name -> folder. Rooms of the pipeline come one by one."""
    whole = {path.parent.name: path.parent for path in sorted(ROOT.glob("*/__init__.py"))}
    rooms = {path.parent.name: path.parent for path in sorted(whole.pop(PIPELINE).glob("*/__init__.py"))}
    return {f"{PIPELINE}.{name}": folder for name, folder in rooms.items()} | whole


def imported(folder: Path) -> set[str]:
    """Return all names of modules that the files of a folder import, anywhere in them."""
    found = set()
    for path in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return found


def arrows() -> nx.DiGraph:
    """Return which box imports which, without what follows from two arrows."""
    graph = nx.DiGraph()
    for name, folder in packages().items():
        graph.add_node(name)
        used = imported(folder)
        graph.add_edges_from((name, other) for other in packages() if other != name
                             and any(f"{one}.".startswith(f"{other}.") for one in used))
    return nx.transitive_reduction(graph)


def layers(graph: nx.DiGraph) -> tuple[list[list], nx.DiGraph]:
    """Return the boxes from top to bottom, and the arrows in pieces from one layer to the next; corners are tuples."""
    level = {name: row for row, names in enumerate(nx.topological_generations(graph.reverse())) for name in names}
    pieces = nx.DiGraph()
    for start, end in sorted(graph.edges):
        corners = [(start, end, row) for row in range(level[start] - 1, level[end], -1)]
        nx.add_path(pieces, [start, *corners, end])
        level |= {corner: corner[2] for corner in corners}
    pieces.add_nodes_from(graph)
    rows = [sorted((one for one in pieces if level[one] == row), key=str) for row in range(max(level.values()), -1, -1)]
    places = {one: place - 0.5 * (len(row) - 1) for row in rows for place, one in enumerate(row)}
    for sweep in range(24):  # boxes go where their neighbors are, so that fewer arrows cross
        for row in rows if sweep % 2 else rows[::-1]:
            near = pieces.pred if sweep % 2 else pieces.succ
            mean = {one: _mean([places[other] for other in near[one]], places[one]) for one in row}
            row.sort(key=lambda one: (mean[one], str(one)))
            places |= {one: place - 0.5 * (len(row) - 1) for place, one in enumerate(row)}
    return rows, pieces


def _mean(numbers: list[float], without: float) -> float:
    return sum(numbers) / len(numbers) if numbers else without


def drawing() -> str:
    """Return the SVG."""
    rows, pieces = layers(arrows())
    wide, high = BEND * max(map(len, rows)) + 20, STEP * len(rows) + 10
    at = {one: (0.5 * wide + BEND * (place - 0.5 * (len(row) - 1)), 10 + HIGH / 2 + STEP * depth)
          for depth, row in enumerate(rows) for place, one in enumerate(row)}
    lines, boxes = [], []
    for start, end in sorted(pieces.edges, key=str):
        (x, y), (u, v) = at[start], at[end]
        y, v = (y + HIGH / 2 if isinstance(start, str) else y), (v - HIGH / 2 if isinstance(end, str) else v)
        head = ' marker-end="url(#head)"' if isinstance(end, str) else ""
        middle = 0.5 * (y + v)
        lines.append(f'<path d="M{x:.1f} {y:.1f}C{x:.1f} {middle:.1f} {u:.1f} {middle:.1f} {u:.1f} {v:.1f}"{head}/>')
    for one, (x, y) in at.items():
        if isinstance(one, str):
            kind = "room" if one.startswith(f"{PIPELINE}.") else "package"
            boxes.append(f'<g class="{kind}"><rect x="{x - WIDE / 2:.1f}" y="{y - HIGH / 2:.1f}" width="{WIDE}" '
                         f'height="{HIGH}" rx="6"/><text x="{x:.1f}" y="{y + 4.5:.1f}">{label(one)}</text></g>')
    return "\n".join([
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {wide} {high}" width="{wide}" height="{high}">',
        "<title>Rooms of the pipeline, and what they import</title>",
        "<style>svg { background: #fff } path { fill: none; stroke: #5b6770; stroke-width: 1.2 }"
        " text { font: 13px sans-serif; text-anchor: middle; fill: #1d2730 }"
        " rect { stroke: #1d2730 } .room rect { fill: #f7f0d8 } .package rect { fill: #cfe3f5 }</style>",
        '<defs><marker id="head" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" markerHeight="8" orient="auto">'
        '<path d="M0 0L8 4L0 8z" style="fill: #5b6770; stroke: none"/></marker></defs>',
        *lines, *boxes, "</svg>", ""])


def label(name: str) -> str:
    """Return the name of a box as people read it: a room by its own, another package as a folder."""
    return name.removeprefix(f"{PIPELINE}.") if name.startswith(f"{PIPELINE}.") else f"{name}/"


def meaning(folder: Path) -> str:
    """Return what a room is for, the first sentence of its docstring."""
    text = ast.get_docstring(ast.parse((folder / "__init__.py").read_text(encoding="utf-8"))) or ""
    return " ".join(text.partition("\n\n")[0].split()).rstrip(".").replace("``", "`")


def table() -> str:
    """Return the table of rooms, from the top of the drawing to its bottom."""
    folders = packages()
    order: Iterable[str] = [one for row in layers(arrows())[0] for one in row if isinstance(one, str)]
    rows = [f"| `{folders[one].relative_to(ROOT)}/` | {meaning(folders[one])} |" for one in order]
    return "\n".join([BEGIN, "| room | what |", "|---|---|", *rows, END])


def with_table(text: str) -> str:
    """Return the page with the table in its place."""
    before, _, rest = text.partition(BEGIN)
    return before + table() + rest.partition(END)[2]


if __name__ == "__main__":
    DRAWING.write_text(drawing(), encoding="utf-8")
    PAGE.write_text(with_table(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
