"""Digests of code: which files of this project a module uses, and what they mean.

Comments, docstrings and layout do not count.
"""
import ast
import contextlib
import functools
import hashlib
import importlib.util
import json
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

from pipeline.base.files import replacing

ROOT = Path(__file__).parents[2]
PACKAGES = ("pipeline", "sim")
# These only speak to the user, or hold what others say.
WITHOUT_INFLUENCE = ("pipeline.base.cli", "pipeline.base.errors", "pipeline.base.progress",
                     "pipeline.scenes.memory_check", "pipeline.study_kit.family")
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
          "pipeline.planning.settings", "pipeline.scenes.effects", "pipeline.scenes.fill", "pipeline.scenes.timeline",
          "pipeline.simulation.solver_setup")

BESIDE = (".css", ".html", ".js")

# What files say, by what they hold, for processes to come: to parse all takes seconds.
KNOWN = Path(importlib.util.cache_from_source(__file__)).with_suffix(".json")
MOST_KNOWN = 5000  # files; more are of versions long past


def call_digest(module: str, chosen: Iterable[str], values: object) -> str:
    """Return the digest of a call of ``module`` with ``values`` (plain data), with the chosen effects and schemes."""
    return shortened(json.dumps(values, sort_keys=True), code_used(module, chosen))


def shortened(*texts: str) -> str:
    """Return the digest of texts, 16 hexadecimal digits."""
    return hashlib.sha256("".join(texts).encode()).hexdigest()[:16]


def code_used(module: str, chosen: Iterable[str] = ()) -> str:
    """Return the paths of all that :func:`modules_used` names, and digests of their code."""
    before = len(_known())
    used = modules_used(module, chosen)
    speaks = _file(ADVICE[0]) in used
    text = "".join(f"{path.relative_to(ROOT)}\n{_meaning(path, speaks)}\n" for path in used)
    if len(_known()) > before and not sys.dont_write_bytecode:
        with contextlib.suppress(OSError), replacing(KNOWN) as partial:     # without it the next process parses again
            partial.write_text(json.dumps(_known()), encoding="utf-8")
    return text


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


def _imports(path: Path) -> Iterator[str]:
    """Names that a file imports, wherever in the file; ``from a import b`` may mean ``a`` or ``a.b``."""
    for module, names in _facts(path)["imports"]:
        submodules = [f"{module}.{name}" for name in names]
        yield from (name for name in submodules if _file(name))
        if not submodules or not all(map(_file, submodules)):
            yield module


def _meaning(path: Path, speaks: bool) -> str:
    """Digest of the code of a file without comments, docstrings and layout; what only speaks counts if `speaks`.

    What lies beside it under its name, a style or a template, counts with it.
    """
    choice = any(path.is_relative_to(ROOT.joinpath(*package.split("."))) for package in CHOICES)
    code = _facts(path)["all" if speaks or not choice else "work"]
    beside = [path.with_suffix(kind) for kind in BESIDE]
    return shortened(code, *(one.read_text(encoding="utf-8") for one in beside if one.is_file()))


def _facts(path: Path) -> dict:
    """What a file imports, and the digests of all its code and of that which does not only speak."""
    code, known = path.read_text(encoding="utf-8"), _known()
    name = shortened(_own_code(), code)
    if name not in known:
        if len(known) >= MOST_KNOWN:
            known.clear()
        known[name] = _read(code)
    return known[name]


@functools.cache
def _known() -> dict[str, dict]:
    """What is known of files, by the digest of what they hold."""
    with contextlib.suppress(OSError, ValueError):
        if isinstance(known := json.loads(KNOWN.read_text(encoding="utf-8")), dict):
            return known
    return {}


@functools.cache
def _own_code() -> str:
    return Path(__file__).read_text(encoding="utf-8")


def _read(code: str) -> dict:
    """What :func:`_facts` says of the code of a file."""
    tree = ast.parse(code)
    imports: list[tuple[str, list[str]]] = []
    bodies: list[ast.Module | ast.ClassDef] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            imports += [(alias.name, []) for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            imports.append((node.module, [alias.name for alias in node.names]))
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            del node.body[0]
        if isinstance(node, ast.Module | ast.ClassDef):
            bodies.append(node)
    everything = work = shortened(ast.dump(tree))
    if any(map(_speaks, (one for node in bodies for one in node.body))):
        for node in bodies:
            node.body = [one for one in node.body if not _speaks(one)]
        work = shortened(ast.dump(tree))
    return {"imports": imports, "all": everything, "work": work}


def _speaks(node: ast.stmt) -> bool:
    """Whether a statement of a module or a class is a function that only speaks."""
    return isinstance(node, ast.FunctionDef) and (
        node.name in SPEAKING_HOOKS or node.name.startswith(SPEAKING_PREFIXES))
