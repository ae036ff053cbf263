"""From a scene file in YAML to the resolved scene, and back from the resolved file."""
import contextlib
import dataclasses
import functools
import json
import re
import typing
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pipeline.base.errors import UserError
from pipeline.base.project import PROJECT, project_around
from pipeline.base.words import nearest
from pipeline.scenes.checks import NAME, check, check_start
from pipeline.scenes.description import description_of
from pipeline.scenes.fill import fill_at_end
from pipeline.scenes.folders import scene_file, scene_path, scenes_folder
from pipeline.scenes.materials import load_materials, read_liquids
from pipeline.scenes.model import SCENE_KEYS, Eye, Initial, Material, Scene
from pipeline.scenes.paths import file_of_project, project_of
from pipeline.scenes.reader import FAILED, Errors, Find, NotRead, Reader, describe
from pipeline.scenes.yaml_files import read_extended, read_yaml, sibling
from sim.effects import REGISTRY
from sim.schemes import REGISTRY as SCHEMES
from sim.settings import Numerics

FOR_DIGESTS = "instead pipeline.scenes.model"  # how a scene was read does not matter beside its values
TAKEN_OF_LEVELS = ("logs", "all")  # a folder beside those of levels, and what means every level
PROJECT_CONFIG = (project_around(Path.cwd()) or PROJECT) / "config"  # who works in a folder with one works with that


def load_scene(path: str | Path, accuracy: str | None = None, config_dir: str | Path | None = None) -> Scene:
    """Read, check and resolve a scene file.

    Parameters
    ----------
    path : YAML file of the scene, whose name is the scene's, or the name alone (``scene_file``).
    accuracy : level of ``accuracy.yaml``; by default the one that ``config.yaml`` chooses.
    config_dir : folder of ``config.yaml``, ``accuracy.yaml`` and ``materials.yaml``; by default the folder above that
        of the scenes, if it has them, else that of the project.

    Raises
    ------
    UserError
        With one sentence for every error of the file.
    """
    path = scene_file(path)
    if config_dir is None:
        above = scenes_folder(path).parent
        config_dir = above if (above / "materials.yaml").is_file() else PROJECT_CONFIG
    return _Resolver(Path(config_dir), accuracy).resolve(path)


def load_resolved(path: str | Path, *, to_run: bool = True) -> Scene:
    """Read a resolved scene, as ``Scene.to_json`` writes it.

    Parameters
    ----------
    to_run : ask too whether this computer can run it. What was run may have needed a larger one.

    Raises
    ------
    UserError
        The file is missing, or no resolved scene; with one sentence for every error.
    """
    path = Path(path)
    if not path.is_file():
        raise UserError(f"{path}: no such file, write it with `python -m pipeline.scene <scene file> --output {path}`")
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:  # no JSON, no UTF-8, a number without end
        raise UserError(f"{path}: not a resolved scene ({error})") from None
    errors = Errors(path)
    scene = Reader(errors, _liquid_names(data), written=False).record(Scene, data)
    errors.raise_any()
    for key, message in check(vars(scene), to_run=to_run):
        errors.add(key, message)
    errors.raise_any()
    return scene


def scene_of_run(folder: Path) -> Scene:
    """Return the scene of the run in ``outputs/<scene>/<level>``.

    Raises
    ------
    UserError : there is no run in the folder.
    """
    if not (folder / "scene.json").is_file():
        raise UserError(f"{folder}: holds no run; run the scene at this level first")
    return load_resolved(folder / "scene.json", to_run=False)


@functools.cache
def project_materials() -> dict[str, Material]:
    """Return the liquids of ``config/materials.yaml`` by name, read once in a process."""
    return load_materials(PROJECT_CONFIG / "materials.yaml")


@functools.cache
def _places() -> dict[str, list[str]]:
    """Return where every key of a scene stands, by its name, for keys that are written at another level."""
    found: dict[str, list[str]] = {"accuracy": ["--config accuracy=standard at the command line"]}
    found["level"] = found["accuracy"]
    rooms = {field.name: next((one for one in (field.type, *typing.get_args(field.type))
                               if dataclasses.is_dataclass(one)), None) for field in dataclasses.fields(Scene)}
    rooms |= {"numerics": Numerics} | {f"effects.{name}": effect.Parameters for name, effect in REGISTRY.items()}
    for room, kind in rooms.items():
        if "." in room:
            found.setdefault(room.split(".")[1], []).append(room)
        for field in dataclasses.fields(kind) if kind is not None else ():
            found.setdefault(field.name, []).append(f"{room}.{field.name}")
    return found


class _Resolver:
    """Resolves the scenes of one configuration at one accuracy level."""

    def __init__(self, config_dir: Path, accuracy: str | None):
        self.materials = load_materials(config_dir / "materials.yaml")
        levels = load_accuracy_levels(config_dir / "accuracy.yaml")
        where = "--accuracy"
        if accuracy is None:
            where = f"{config_dir / 'config.yaml'}: accuracy"
            accuracy = read_yaml(config_dir / "config.yaml").get("accuracy")
        if not isinstance(accuracy, str) or accuracy not in levels:
            raise UserError(f"{where} is {describe(accuracy)}, but must be one of {', '.join(levels)}"
                            f"{nearest(accuracy, levels)}")
        self.accuracy, self.levels = accuracy, levels
        self._config_dir = config_dir
        self._resolved: dict[Path, Scene] = {}  # a chain of scenes that start from each other asks for each many times

    def resolve(self, path: Path, chain: tuple[Path, ...] = ()) -> Scene:
        """Return the scene in ``path``.

        Parameters
        ----------
        chain : files of the scenes that start from this one.
        """
        if path in self._resolved:
            return self._resolved[path]
        errors = Errors(path)
        data = read_extended(path, errors)
        find = functools.partial(file_of_project, path, project_of(path, self._config_dir), errors)
        parts = self._read_parts(path.stem, data, errors, find)
        for key, message in check(parts):
            errors.add(key, message)
        if isinstance(parts.get("eye"), Eye) and parts["eye"].path is not None:
            parts["eye"] = dataclasses.replace(parts["eye"], path=str(find(parts["eye"].path, ("eye", "path"))))
        if parts.get("start_from") is not None:
            self._check_start(parts, path, (*chain, path), errors)
        errors.raise_any()
        scene = Scene(**parts)
        if not scene.description:
            scene = dataclasses.replace(scene, description=description_of(scene, self._other(path, chain)))
        self._resolved[path] = scene
        return scene

    def _other(self, path: Path, chain: tuple[Path, ...]) -> Callable[[str], Scene]:
        """Return what resolves a scene by the name that the scene in ``path`` calls it."""
        return lambda name: self.resolve(scene_path(name, scenes_folder(path)), chain)

    def _read_parts(self, name: str, data: dict[str, Any], errors: Errors, find: Find) -> dict[str, Any]:
        """Return the fields of the scene without those that have errors."""
        liquids = data.get("liquids")
        # With an unknown liquid the references to the right name would look wrong too.
        known = isinstance(liquids, dict) and liquids.keys() <= self.materials.keys()
        reader = Reader(errors, liquids if known else (), find, places=_places())
        reader.refuse_unknown(data, SCENE_KEYS, ())
        parts: dict[str, Any] = {"name": name, "accuracy": self.accuracy}
        if liquids is not None:
            parts["liquids"] = read_liquids(liquids, self.materials, reader, errors)
        level = self._read_level(data.get("levels", {}), reader)
        parts["numerics"] = reader.record(Numerics, data.get("numerics", {}), ("numerics",), level)
        for field in dataclasses.fields(Scene):
            if field.name not in parts:
                parts[field.name] = reader.field(field, data.get(field.name, dataclasses.MISSING), (field.name,))
        parts = {name: value for name, value in parts.items() if value is not FAILED}
        self._refuse_unread(data, parts, errors)
        if "container" in data and "eye" not in data:
            parts["eye"] = None
        elif "container" not in data and parts.get("liquids") and parts.get("initial") == Initial():
            parts["initial"] = Initial(liquid=parts["liquids"][0].name)
        return parts

    def _read_level(self, data: Any, reader: Reader) -> Numerics:
        """Return the numerics of the chosen accuracy level with what the scene changes of it under ``levels``."""
        changed = {}
        if reader.is_mapping(data, ("levels",)):
            reader.refuse_unknown(data, self.levels, ("levels",))
            changed = {name: reader.record(Numerics, data[name], ("levels", name), level)
                       for name, level in self.levels.items() if name in data}
        level = changed.get(self.accuracy)
        return level if isinstance(level, Numerics) else self.levels[self.accuracy]

    def _refuse_unread(self, data: dict[str, Any], parts: dict[str, Any], errors: Errors) -> None:
        """Collect an error for every number that the scene itself gives to a scheme that does not read it."""
        levels = data.get("levels")
        given = {("numerics",): data.get("numerics"),
                 ("levels", self.accuracy): levels.get(self.accuracy) if isinstance(levels, dict) else None}
        effects = parts.get("effects", {})
        with contextlib.suppress(NotRead):
            scheme = parts["numerics"].scheme
            for key, numbers in given.items():
                for name, place_taker in SCHEMES[scheme].unread.items() if isinstance(numbers, dict) else ():
                    if name in numbers and not any(name in REGISTRY[effect].reads for effect in effects):
                        errors.add((*key, name), f"is not read by the scheme {scheme}: its place takes {place_taker}")

    def _check_start(self, parts: dict[str, Any], path: Path, chain: tuple[Path, ...], errors: Errors) -> None:
        """Collect the errors of the scene that this one starts from, or of what they should have in common."""
        try:
            start = self.resolve(sibling(path, "start_from", parts["start_from"], chain), chain)
        except UserError as error:
            for sentence in error.messages:
                errors.take(sentence)
            return
        fill = fill_at_end(start, self._other(path, chain))
        for key, message in check_start(parts, start, fill):
            errors.add(key, message)


def load_accuracy_levels(path: Path) -> dict[str, Numerics]:
    """Return the numerics of every level of ``accuracy.yaml``."""
    errors = Errors(path)
    reader = Reader(errors)
    levels = {name: reader.record(Numerics, data, (name,)) for name, data in read_yaml(path).items()}
    for name in levels:
        if not re.fullmatch(NAME, name) or name.lower() in TAKEN_OF_LEVELS:
            errors.add((name,), "is no name for a level: its results get a folder of that name, so it must be made of "
                                f"letters, digits, _ and -, and be none of {', '.join(TAKEN_OF_LEVELS)}")
    errors.raise_any()
    return levels


def _liquid_names(data: Any) -> list[str]:
    """Return the names of the liquids in a resolved scene, as far as they can be found."""
    liquids = data.get("liquids") if isinstance(data, dict) else None
    names = [liquid.get("name") for liquid in liquids if isinstance(liquid, dict)] if isinstance(liquids, list) else []
    return [name for name in names if isinstance(name, str)]
