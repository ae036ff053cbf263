"""The structure of docs/architecture.md: what may import what."""
import ast
import functools
import re
from graphlib import TopologicalSorter
from pathlib import Path

import pytest
from conftest import ROOT

PIPELINE = ROOT / "pipeline"
STAGES = {f"pipeline.{path.stem}" for path in PIPELINE.glob("*.py")}


@functools.cache
def nodes(path: Path) -> tuple[ast.AST, ...]:
    """All that the code of a file is made of."""
    return tuple(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))


def imports(path: Path) -> set[str]:
    """Modules that a file imports, anywhere in it; of `from a import b` both a and a.b."""
    found = set()
    for node in nodes(path):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return found


def named(path: Path) -> set[str]:
    """Modules whose names stand in a file as strings: it would be as bound to them as by an import."""
    texts = {node.value for node in nodes(path) if isinstance(node, ast.Constant) and isinstance(node.value, str)}
    return {text for text in texts if re.fullmatch(r"(pipeline|sim|studies)(\.\w+)+", text)}


@pytest.mark.thorough
def test_no_file_imports_a_stage():
    for path in PIPELINE.rglob("*.py"):
        assert not imports(path) & STAGES, path


@pytest.mark.thorough
def test_no_room_imports_one_that_imports_it():
    """Nor names one, as a string, that imports it."""
    folders = {folder.name: folder for folder in PIPELINE.iterdir() if (folder / "__init__.py").is_file()}
    rooms = {room: {name.split(".")[1] for path in folder.rglob("*.py") for name in {*imports(path), *named(path)}
                    if name.startswith("pipeline.")} & {*folders} - {room}
             for room, folder in folders.items()}
    assert "base" in rooms["scenes"]
    TopologicalSorter(rooms).prepare()  # raises where rooms import each other in a circle


def test_the_solver_knows_neither_pipeline_nor_studies():
    assert not [(path, name) for path in (ROOT / "sim").rglob("*.py") for name in {*imports(path), *named(path)}
                if name.split(".")[0] in ("pipeline", "studies")]


def test_the_pipeline_knows_no_study():
    """It finds families and pages by name."""
    assert not [(path, name) for path in PIPELINE.rglob("*.py") for name in {*imports(path), *named(path)}
                if name.split(".")[0] == "studies"]


def test_studies_know_no_stage():
    """What they need of a stage is in a room."""
    assert not [(path, name) for path in (ROOT / "studies").rglob("*.py") for name in imports(path) & STAGES]
