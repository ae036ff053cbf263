"""Changes of a scene, as arguments of a function give them, become a scene file that extends it."""
import hashlib
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pipeline.base.errors import UserError
from pipeline.base.files import write_text
from pipeline.base.words import nearest
from pipeline.scenes.checks import NAME
from pipeline.scenes.folders import scene_path, scene_paths
from pipeline.scenes.load import load_scene
from pipeline.scenes.model import SCENE_KEYS

MADE = "# Made by pipeline.run: what differs from the scene that it extends."


def changed_scene(folder: Path, scene: str, changes: Mapping[str, Any], accuracy: str, name: str | None) -> str:
    """Write a scene that extends another one, and return its name; without changes and a name, that of the other one.

    Parameters
    ----------
    folder : of the scene files.
    changes : scene key -> value; keys may be dotted, values mappings; None removes what is inherited.
    name : of the new scene; by default it tells the changes apart by a digest.

    Raises
    ------
    UserError : the scene has errors; one sentence for each, and no file is written.
    """
    for one in (scene, name or scene):
        if not re.fullmatch(NAME, one):
            raise UserError(f'"{one}" cannot name a scene, use letters, digits, "_" and "-"')
    if not changes and name is None:
        load_scene(scene_path(scene, folder), accuracy)
        return scene
    nested = _nested(changes)
    if name is None:
        name = f"{scene}_changed_{hashlib.sha256(json.dumps(nested, sort_keys=True).encode()).hexdigest()[:8]}"
    path = scene_paths(folder).get(name, folder / f"{name}.yaml")
    before = path.read_text(encoding="utf-8") if path.is_file() else None
    if before is not None and not before.startswith(MADE):
        raise UserError(f"{path}: is a scene that was written by hand; choose another name than {name} for a scene "
                        "with changes")
    values = {"extends": scene, **nested}
    text = f"{MADE}\n" + yaml.safe_dump(values, sort_keys=False, width=120, allow_unicode=True)
    write_text(path, text)
    try:
        load_scene(path, accuracy)
    except UserError:
        path.unlink() if before is None else write_text(path, before)
        raise
    return name


def _nested(changes: Mapping[str, Any]) -> dict[str, Any]:
    """Changes as nested mappings of plain data.

    >>> _nested({"effects.injection.fill": 0.9, "effects": {"gravity": {"posture": "prone"}}})
    {'effects': {'injection': {'fill': 0.9}, 'gravity': {'posture': 'prone'}}}
    """
    nested: dict[str, Any] = {}
    for key, value in changes.items():
        first, *others = key.split(".")
        if first not in SCENE_KEYS or first == "extends":
            known = [name for name in SCENE_KEYS if name != "extends"]
            raise UserError(f"{key}: is no key of a scene{nearest(first, known)}; known are {', '.join(known)}")
        given = _plain(key, value)
        for part in reversed(others):
            given = {part: given}
        _add(nested, {first: given}, key)
    return nested


def _add(base: dict[str, Any], more: Mapping[str, Any], key: str) -> None:
    for name, value in more.items():
        if isinstance(value, dict) and isinstance(base.get(name), dict):
            _add(base[name], value, key)
        elif name in base:
            raise UserError(f"{key}: gives {name} a second time")
        else:
            base[name] = value


def _plain(key: str, value: Any) -> Any:
    """A value as data of YAML."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(name): _plain(f"{key}.{name}", one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(f"{key}[{index}]", one) for index, one in enumerate(value)]
    if isinstance(value, Path):
        return str(value)
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise UserError(f"{key}: is a {type(value).__name__}, but must be a number (in SI units), a text such as \"5 mm\", "
                    "a list or a mapping")
