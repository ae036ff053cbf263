"""Digests of code: which files of this project a module uses, and what they mean.

Comments, docstrings and layout do not count.
"""
import ast
import functools
import hashlib
import json
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("pipeline", "sim")
# These only speak to the user.
WITHOUT_INFLUENCE = ("pipeline.advice.report", "pipeline.base.cli", "pipeline.base.errors", "pipeline.base.progress",
                     "pipeline.scenes.memory_check")
# How a scene was read does not matter beside its values, which the digest holds.
INSTEAD = {"pipeline.scenes.load": "pipeline.scenes.model"}
# Packages with one file per choice: a scene depends on the files it calls for, not on the others.
CHOICES = ("sim.effects", "sim.schemes")


def call_digest(module: str, chosen: Iterable[str], values: object) -> str:
    """Return the digest of a call of ``module`` with ``values`` (plain data), with the chosen effects and schemes."""
    return shortened(json.dumps(values, sort_keys=True), code_used(module, chosen))


def shortened(*texts: str) -> str:
    """Return the digest of texts, 16 hexadecimal digits."""
    return hashlib.sha256("".join(texts).encode()).hexdigest()[:16]


def code_used(module: str, chosen: Iterable[str] = ()) -> str:
    """Return the paths and the code of all that :func:`modules_used` names."""
    return "".join(f"{path.relative_to(ROOT)}\n{_meaning(path)}\n" for path in modules_used(module, chosen))


def modules_used(module: str, chosen: Iterable[str] = ()) -> list[Path]:
    """Return the files of this project that ``module`` imports, directly or not, sorted by path.

    Parameters
    ----------
    module : dotted name.
    chosen : names of the effects and schemes that the scene calls for (:data:`CHOICES`).
    """
    found, waiting = {}, [module]
    while waiting:
        name = waiting.pop()
        path = _file(name)
        if path is None or path in found.values() or (name in WITHOUT_INFLUENCE and name != module):
            continue
        if name in CHOICES:
            waiting += [f"{name}.{choice}" for choice in chosen if _file(f"{name}.{choice}")]
            continue
        found[name] = path
        for imported in _imports(path):
            # A scene's effects are values to the stages around the solver: only the solver runs their code.
            if imported not in CHOICES or name.startswith("sim."):
                waiting.append(INSTEAD.get(imported, imported))
    return sorted(found.values())


def _file(name: str) -> Path | None:
    """The file of a module of this project, or ``None``."""
    if name.split(".")[0] not in PACKAGES:
        return None
    path = ROOT.joinpath(*name.split("."))
    candidates = (path.with_suffix(".py"), path / "__init__.py")
    return next((file for file in candidates if file.is_file()), None)


def _imports(path: Path) -> Iterable[str]:
    """Names that a file imports, wherever in the file; ``from a import b`` may mean ``a`` or ``a.b``."""
    return _parsed(path.read_text(encoding="utf-8"))[0]


def _meaning(path: Path) -> str:
    """The code of a file without comments, docstrings and layout."""
    return _parsed(path.read_text(encoding="utf-8"))[1]


@functools.cache  # a study of a hundred cases asks for the same files a hundred times
def _parsed(code: str) -> tuple[tuple[str, ...], str]:
    """What ``_imports`` and ``_meaning`` say of the code of a file."""
    tree, imports = ast.parse(code), []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            imports += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            submodules = [f"{node.module}.{alias.name}" for alias in node.names]
            imports += [name for name in submodules if _file(name)]
            if not all(map(_file, submodules)):
                imports.append(node.module)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            del node.body[0]
    return tuple(imports), ast.dump(tree)
