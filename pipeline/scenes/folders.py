"""Where scenes are: in `config/scenes` and in its folders. Everywhere else a scene is called by its bare name."""
import os
from pathlib import Path

from pipeline.base.errors import UserError
from pipeline.base.project import PROJECT, project_around
from pipeline.base.words import nearest

SCENES = Path("config/scenes")  # of the project that somebody works in
LISTED = "`python -m pipeline.scene --scenes` lists all"


def scenes_folder(path: Path) -> Path:
    """Return the folder below which the scenes lie that a scene file may name: its own, or the one above that.

    The upper one where that lies beside the liquids, as `config/scenes` does.
    """
    own = path.parent
    above = _above(own)
    return above if not _is_config(_above(own)) and _is_config(_above(above)) else own


def scene_paths(folder: Path = SCENES) -> dict[str, Path]:
    """Return the files of all scenes in a folder and in its folders: name -> path, in the order of names.

    Raises
    ------
    UserError : two have the same name.
    """
    found: dict[str, Path] = {}
    for path in _files(folder):
        if path.stem in found:
            raise UserError(_alike(found[path.stem], path))
        found[path.stem] = path
    return found


def scene_path(name: str, folder: Path = SCENES) -> Path:
    """Return the file of a scene.

    Raises
    ------
    UserError : there is none of this name, or more than one.
    """
    files = _files(folder)
    found = [path for path in files if path.stem == name]
    if len(found) > 1:
        raise UserError(_alike(*found[:2]))
    if not found:
        if (folder / f"{name}.yml").is_file():
            raise UserError(f"{folder / name}.yml: is no scene for its name, which must end in .yaml; rename it")
        raise UserError(f"{folder / name}.yaml: no such file{nearest(name, [path.stem for path in files])}"
                        + f"; {LISTED}" * _is_config(_above(folder)))
    return found[0]


def scene_file(given: str | Path) -> Path:
    """Return the file that somebody means by a scene: a file, or a scene's name.

    `config/scenes/<name>.yaml` means the scene of that name too where it lies in a folder of `config/scenes`. Other
    paths come back as they are.

    Raises
    ------
    UserError : there is no scene of this name, or more than one.
    """
    path = Path(given)
    if path.name == str(path) and not path.suffix:
        project = project_around(Path.cwd()) or PROJECT
        return scene_path(path.name, SCENES if project == Path.cwd() else project / SCENES)
    return path if path.suffix != ".yaml" or path.is_file() else scene_path(path.stem, path.parent)


def _files(folder: Path) -> list[Path]:
    """Files of scenes in the order of names, without what programs keep in hidden ones; `config/scenes` has folders."""
    found = [*folder.glob("*.yaml"), *(folder.glob("[!.]*/*.yaml") if _is_config(_above(folder)) else ())]
    return sorted((path for path in found if not path.name.startswith(".")), key=lambda path: (path.stem, path))


def _alike(one: Path, other: Path) -> str:
    return f"{one} and {other}: have the same name, by which alone scenes are called; rename or remove one of them"


def _is_config(folder: Path) -> bool:
    return (folder / "materials.yaml").is_file()


def _above(folder: Path) -> Path:
    """The folder above, of "." too."""
    return Path(os.path.normpath(folder / ".."))
