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
WITHOUT_INFLUENCE = ("pipeline.base.cli", "pipeline.base.errors", "pipeline.base.progress",
                     "pipeline.scenes.memory_check")
# What is said of a scene before it is run counts for the modules that end in words, by the first of these, no others:
# they know neither these files, nor the hooks of effects and schemes that are read by them, nor their checks.
ADVICE = ("pipeline.advice.rules", "sim.advice", "sim.effects.parts.viscous_advice")
SPEAKING_HOOKS = ("advice", "speeds", "wall_speeds", "omitted_acceleration", "numbers", "time_scales", "wave_speeds",
        "expected_time_step_limit")
SPEAKING_PREFIXES = ("_advice", "_check")
BESIDE_ITS_WORK = {"pipeline.simulate": "pipeline.advice.report"}  # what a stage prints first
# How a scene was read does not matter beside its values, which the digest holds.
INSTEAD = {"pipeline.scenes.load": "pipeline.scenes.model"}
# Packages with one file per choice: a scene depends on the files it calls for, not on the others.
CHOICES = ("sim.effects", "sim.schemes")
# The settings ask for the names of the schemes only.
NAMES_ONLY = ("sim.settings",)
# A scene's effects are values to the stages around the solver, but for these modules, which run their code.
ASKING = ("pipeline.forecast.phases", "pipeline.measures.events", "pipeline.measures.metric",
          "pipeline.scenes.effects", "pipeline.scenes.fill", "pipeline.simulation.solver_setup")


def call_digest(module: str, chosen: Iterable[str], values: object) -> str:
    """Return the digest of a call of ``module`` with ``values`` (plain data), with the chosen effects and schemes."""
    return shortened(json.dumps(values, sort_keys=True), code_used(module, chosen))


def shortened(*texts: str) -> str:
    """Return the digest of texts, 16 hexadecimal digits."""
    return hashlib.sha256("".join(texts).encode()).hexdigest()[:16]


def code_used(module: str, chosen: Iterable[str] = ()) -> str:
    """Return the paths and the code of all that :func:`modules_used` names."""
    used = modules_used(module, chosen)
    speaks = _file(ADVICE[0]) in used
    return "".join(f"{path.relative_to(ROOT)}\n{_meaning(path, speaks)}\n" for path in used)


def modules_used(module: str, chosen: Iterable[str] = ()) -> list[Path]:
    """Return the files of this project that ``module`` imports, directly or not, sorted by path.

    Parameters
    ----------
    module : dotted name.
    chosen : names of the effects and schemes that the scene calls for (:data:`CHOICES`).
    """
    found, waiting, read = {}, [module], set()
    while waiting:
        name = waiting.pop()
        path = _file(name)
        if path is None or path in found.values() or (name in WITHOUT_INFLUENCE and name != module):
            continue
        if BESIDE_ITS_WORK.get(module) == name:
            continue
        if name == ADVICE[0]:  # effects that a scene does not have speak too
            chosen = [file.stem for package in CHOICES for file in _file(package).parent.glob("*.py")]
            waiting += CHOICES
        if name in CHOICES:
            waiting += [f"{name}.{choice}" for choice in chosen if _file(f"{name}.{choice}")]
            continue
        found[name] = path
        for imported in _imports(path):
            if imported in ADVICE and name.startswith("pipeline."):
                read.add(imported)
            runs = (name.startswith("sim.") and name not in NAMES_ONLY) or name in ASKING
            if imported not in CHOICES or runs:
                waiting.append(INSTEAD.get(imported, imported))
    if ADVICE[0] not in found:
        found = {name: path for name, path in found.items() if name not in ADVICE or name in read}
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


def _meaning(path: Path, speaks: bool) -> str:
    """The code of a file without comments, docstrings and layout; what only speaks counts if `speaks`."""
    choice = any(path.is_relative_to(ROOT.joinpath(*package.split("."))) for package in CHOICES)
    return _parsed(path.read_text(encoding="utf-8"), speaks or not choice)[1]


@functools.cache  # a study of a hundred cases asks for the same files a hundred times
def _parsed(code: str, speaks: bool = True) -> tuple[tuple[str, ...], str]:
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
        if isinstance(node, ast.Module | ast.ClassDef) and not speaks:
            node.body = [one for one in node.body if not (isinstance(one, ast.FunctionDef) and (
                one.name in SPEAKING_HOOKS or one.name.startswith(SPEAKING_PREFIXES)))]
    return tuple(imports), ast.dump(tree)
