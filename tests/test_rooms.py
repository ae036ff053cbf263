"""The structure of docs/architecture.md: what may import what."""
import ast
from graphlib import TopologicalSorter
from pathlib import Path

from conftest import ROOT

PIPELINE = ROOT / "pipeline"
STAGES = {f"pipeline.{path.stem}" for path in PIPELINE.glob("*.py")}


def imports(path: Path) -> set[str]:
    """Modules that a file imports, anywhere in it; of `from a import b` both a and a.b."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return found


def test_no_file_imports_a_stage():
    for path in PIPELINE.rglob("*.py"):
        assert not imports(path) & STAGES, path


def test_no_room_imports_one_that_imports_it():
    rooms = {folder.name: {name.split(".")[1] for path in folder.rglob("*.py") for name in imports(path)
                           if name.startswith("pipeline.")} - {folder.name}
             for folder in PIPELINE.iterdir() if (folder / "__init__.py").is_file()}
    assert "base" in rooms["scenes"]
    TopologicalSorter(rooms).prepare()  # raises where rooms import each other in a circle


def test_the_solver_knows_no_stage():
    assert not [path for path in (ROOT / "sim").rglob("*.py")
                if any(name.split(".")[0] == "pipeline" for name in imports(path))]
