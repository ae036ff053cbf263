"""Digests of code: which files of this project a module uses, and what they mean.

Comments, docstrings and layout do not count, nor does the version of Python that reads them.
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
from sim.backend.choice import backend_version

ROOT = Path(__file__).parents[2]
PACKAGES = ("pipeline", "sim", "studies")
OWN = "config"  # of the folder that somebody works in, with families of cases of his own
SAYING = "FOR_DIGESTS"
# What a module says of itself by this name, which is part of no digest.
NO_INFLUENCE = "no influence"  # on any result: it only speaks to the user, or holds what others say
RUNS_EFFECTS = "runs effects"  # of the scene; to the other modules around the solver these are values
ALL_SPEAK = "all effects speak"  # in it, those too that a scene does not have: what it says of a scene before it is run
INSTEAD = "instead "  # and the module that counts in its place
BESIDE = "beside "  # and a module that counts for others, but is beside the work of this one
# Packages with one file per choice: a scene depends on the files it calls for, not on the others.
CHOICES = ("sim.effects", "sim.schemes")
NAMES_ONLY = ("sim.settings",)  # asks for the names of the schemes only
# Advice counts for the modules that end in words, no others: they know neither these files, nor the hooks of effects
# and schemes that are read by them, nor their checks.
ADVICE = ("sim.advice", "sim.effects.parts.viscous_advice")
SPEAKING_HOOKS = ("advice", "speeds", "wall_speeds", "omitted_acceleration", "numbers", "time_scales", "wave_speeds",
        "expected_time_step_limit")
SPEAKING_PREFIXES = ("_advice", "_check")
TEXTS = (".css", ".html", ".js")  # that count with the module beside them that has their name

# What imports it computes with the library of kernels: other versions of that may have other results.
KERNELS = "sim.backend.language"

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
    """Return the paths of all that :func:`modules_used` names, and digests of their code.

    Where kernels are among it, name and version of the library that compiles them stand before all.
    """
    before = len(_known())
    used = modules_used(module, chosen)
    speaks = any(_says(path) == ALL_SPEAK for path in used)
    text = f"{backend_version()}\n" if _file(KERNELS) in used else ""
    text += "".join(f"{_told(path)}\n{_meaning(path, speaks)}\n" for path in used)
    if len(_known()) > before and not sys.dont_write_bytecode:
        with contextlib.suppress(OSError), replacing(KNOWN) as partial:     # without it the next process parses again
            partial.write_text(json.dumps(_known()), encoding="utf-8")
    return text


def modules_used(module: str, chosen: Iterable[str] = ()) -> list[Path]:
    """Return the files of this project or of its user that ``module`` imports, directly or not, sorted by path.

    Parameters
    ----------
    module : dotted name.
    chosen : names of the effects and schemes that the scene calls for (:data:`CHOICES`).
    """
    found, waiting, read, all_speak = {}, [module], set(), False
    beside = _after(BESIDE, _file(module))
    while waiting:
        name = waiting.pop()
        path = _file(name)
        if path is None or path in found.values() or name == beside:
            continue
        says = _says(path)
        if says == NO_INFLUENCE and name != module:
            continue
        if says == ALL_SPEAK:
            all_speak = True
            chosen = [file.stem for package in CHOICES for file in _file(package).parent.glob("*.py")]
            waiting += CHOICES
        if name in CHOICES:
            waiting += [f"{name}.{choice}" for choice in chosen if _file(f"{name}.{choice}")]
            continue
        found[name] = path
        for imported in _imports(name, path):
            if imported in ADVICE and name.startswith("pipeline."):
                read.add(imported)
            runs = (name.startswith("sim.") and name not in NAMES_ONLY) or says == RUNS_EFFECTS
            if imported not in CHOICES or runs:
                waiting.append(_after(INSTEAD, _file(imported)) or imported)
    if not all_speak:
        found = {name: path for name, path in found.items() if name not in ADVICE or name in read}
    return sorted(found.values())


def _file(name: str) -> Path | None:
    """The file of a module of this project, or ``None``."""
    parts = name.split(".")
    if parts[0] not in (*PACKAGES, OWN):
        return None
    path = (Path.cwd() if parts[0] == OWN else ROOT).joinpath(*parts)
    candidates = (path.with_suffix(".py"), path / "__init__.py")
    return next((file for file in candidates if file.is_file()), None)


def _says(path: Path | None) -> str:
    """What a module says of itself (``FOR_DIGESTS``)."""
    return _facts(path)["says"] if path else ""


def _after(word: str, path: Path | None) -> str:
    """The module that one names after a word."""
    says = _says(path)
    return says.removeprefix(word) if says.startswith(word) else ""


def _told(path: Path) -> Path:
    """The path of a file, without where this project, or the folder that somebody works in, is."""
    return path.relative_to(ROOT if path.is_relative_to(ROOT) else Path.cwd())


def _imports(name: str, path: Path) -> Iterator[str]:
    """Names that a module imports, wherever in its file; ``from a import b`` may mean ``a`` or ``a.b``."""
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    for module, names in _facts(path)["imports"]:
        module = importlib.util.resolve_name(module, package) if module.startswith(".") else module
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
    beside = [path.with_suffix(kind) for kind in TEXTS]
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
    said = [node for node in tree.body if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == SAYING]
    tree.body = [node for node in tree.body if node not in said]
    says = [node.value.value for node in said if isinstance(node.value, ast.Constant)]
    imports: list[tuple[str, list[str]]] = []
    bodies: list[ast.Module | ast.ClassDef] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            imports += [(alias.name, []) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            module = "." * node.level + (node.module or "")
            imports.append((module, [alias.name for alias in node.names]))
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            del node.body[0]
        if isinstance(node, ast.Module | ast.ClassDef):
            bodies.append(node)
    everything = work = shortened(_written(tree))
    if any(map(_speaks, (one for node in bodies for one in node.body))):
        for node in bodies:
            node.body = [one for one in node.body if not _speaks(one)]
        work = shortened(_written(tree))
    return {"imports": imports, "all": everything, "work": work, "says": str(says[0]) if says else ""}


def _written(node: object) -> str:
    """A tree of code as text, the same with every version of Python.

    ``ast.dump`` also writes empty fields, which newer versions have more of, and what of a text is printable changes.
    """
    if isinstance(node, list):
        return f"[{','.join(map(_written, node))}]"
    if not isinstance(node, ast.AST):
        return ascii(node)
    if isinstance(node, ast.JoinedStr):  # Python 3.12.1 ends formats in texts with an empty one
        node.values = [one for one in node.values if getattr(one, "value", None) != ""]
    fields = ((name, getattr(node, name, None)) for name in node._fields)
    told = (f"{name}={_written(value)}" for name, value in fields if value is not None and value != [])
    return f"{type(node).__name__}({','.join(told)})"


def _speaks(node: ast.stmt) -> bool:
    """Whether a statement of a module or a class is a function that only speaks."""
    return isinstance(node, ast.FunctionDef) and (
        node.name in SPEAKING_HOOKS or node.name.startswith(SPEAKING_PREFIXES))
