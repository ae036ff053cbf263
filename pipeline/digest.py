"""What a stage depends on: a digest of the code it uses and of the part of the scene it reads.

Snakemake keeps the digest of every finished job as a parameter, and runs the job again when it changes. Comments,
docstrings and layout do not count.
"""
import ast
import dataclasses
import functools
import hashlib
import json
from collections.abc import Iterable
from pathlib import Path

from pipeline.scene_model import Scene

ROOT = Path(__file__).parents[1]
PACKAGES = ("pipeline", "sim")
# These only speak to the user.
WITHOUT_INFLUENCE = ("pipeline.advise", "pipeline.cli", "pipeline.errors", "pipeline.memory_check", "pipeline.progress")
# How a scene was read does not matter beside its values, which the digest holds.
INSTEAD = {"pipeline.scene": "pipeline.scene_model"}
# Packages with one file per choice: a scene depends on the files it calls for, not on the others.
CHOICES = ("sim.effects", "sim.schemes")
WORDS = ("title", "description", "label")
PICTURE = ("output.cell_ratio", "output.contour", "output.smoothing_iterations", "output.image_size", "output.formats")
# What a stage does not read of the scene, so that a new color or a longer duration does not cost a simulation.
UNREAD = {
    "advise": ("description", "label", *PICTURE, "liquids.color", "liquids.source"),
    "estimate": ("description", "label", "liquids.color", "liquids.source"),
    "cost": ("description", "label", "liquids.color", "liquids.source"),
    "eye": (*WORDS, "accuracy", "start_from", "initial", "blocks", "effects", "schemes", "numerics", "output",
            "liquids"),
    "voxelize": (*WORDS, "accuracy", "start_from", "schemes", "output", "liquids.color", "liquids.source"),
    "simulate": (*WORDS, "accuracy", "output.duration", *PICTURE, "liquids.color", "liquids.source"),
    "reconstruct": (*WORDS, "accuracy", "start_from", "initial", "effects", "schemes", "output.duration",
                    "output.image_size", "liquids.color", "liquids.source"),
    "bodies": ("description", "label", "accuracy", "start_from", "initial", "blocks", "effects", "schemes", "output",
               "liquids.color", "liquids.source"),
    "effects": ("description", "label", "start_from", "initial", "blocks", "eye", "container", "schemes", "liquids",
                "output"),
    "render": ("accuracy", "start_from", "initial", "blocks", "schemes", "output.duration"),
    "metrics": (*WORDS, "accuracy", "start_from", "initial", "blocks", "schemes", "output.duration", *PICTURE,
                "liquids.color", "liquids.source"),
}


def stage_digest(stage: str, scene: Scene | None = None) -> str:
    """Return the digest of ``python -m pipeline.<stage>`` for a scene: a new one means that its results may differ.

    Parameters
    ----------
    stage : name of the module in ``pipeline``.
    scene : the scene it works on; ``None`` for a stage that reads no scene.
    """
    chosen = {*scene.effects, scene.numerics.scheme} if scene else set()
    digest = hashlib.sha256()
    for path in modules_used(f"pipeline.{stage}", chosen):
        digest.update(f"{path.relative_to(ROOT)}\n{_meaning(path)}\n".encode())
    if scene:
        digest.update(json.dumps(_part_read(scene, UNREAD.get(stage, ())), sort_keys=True).encode())
    return digest.hexdigest()[:16]


def call_digest(module: str, chosen: Iterable[str], values: object) -> str:
    """Return the digest of a call of ``module`` with ``values`` (plain data), with the chosen effects and schemes."""
    digest = hashlib.sha256(json.dumps(values, sort_keys=True).encode())
    for path in modules_used(module, chosen):
        digest.update(f"{path.relative_to(ROOT)}\n{_meaning(path)}\n".encode())
    return digest.hexdigest()[:16]


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


def _part_read(scene: Scene, unread: Iterable[str]) -> dict:
    """The values of a scene without the keys in ``unread``; ``liquids.color`` means the color of every liquid.

    Parameters of schemes that are not chosen are not read by any stage.
    """
    values = json.loads(json.dumps(dataclasses.asdict(scene)))
    values["schemes"] = values["schemes"].get(scene.numerics.scheme)
    for key in unread:
        first, _, second = key.partition(".")
        if not second:
            values.pop(first)
        else:
            for record in values[first] if isinstance(values[first], list) else [values[first]]:
                record.pop(second)
    return values
