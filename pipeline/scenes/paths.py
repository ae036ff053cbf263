"""Files that a scene names: they lie in its project, unless the user has put a link there."""
import os
from pathlib import Path

from pipeline.scenes.folders import scenes_folder
from pipeline.scenes.reader import Errors, Key, describe


def project_of(scene_file: Path, config_dir: Path) -> Path:
    """Return the folder that the files of a scene lie in: its project, or its own folder if it is in none.

    Parameters
    ----------
    config_dir : folder of the configuration that the scene is read with.
    """
    path = Path(os.path.abspath(scene_file))
    config = scenes_folder(path).parent
    return config.parent if config.resolve() == config_dir.resolve() else path.parent


def file_of_project(scene_file: Path, project: Path, errors: Errors, name: str, key: Key) -> Path | None:
    """Return the file that ``key`` of a scene names, relative to the file that says so; None if there is none.

    A scene is data, possibly a stranger's: it cannot reach for files outside the project. A link in the project does,
    for those who want that.

    Parameters
    ----------
    project : folder that the file must lie in.
    errors : learns of a file that is missing or elsewhere.
    """
    folder = errors.origins.get(key, scene_file).parent  # of the scene that it was inherited from
    path = Path(os.path.normpath(folder / name))
    if not Path(os.path.abspath(path)).is_relative_to(project):
        errors.add(key, f"is {describe(name)}, which lies outside of the project ({project}), but a scene may name "
                        "files in it only; copy the file, or link to it (`ln -s`), beside the scene")
        return None
    if not _is_file(path):
        there = "that is a folder" if os.path.isdir(path) else "there is no such file"
        errors.add(key, f"is {describe(name)}, but {there} beside the scene ({path.parent})")
        return None
    return path


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # a name that is too long, or cannot be one
        return False
