"""Files that a scene names: they lie in its project, unless the user has put a link there."""
import os
from pathlib import Path

from pipeline.scenes.reader import Errors, Key, describe


def file_of_project(scene_file: Path, name: str, project: Path, key: Key, errors: Errors) -> str:
    """Return the path of a file that ``key`` of a scene file names, relative to the folder of that file.

    A scene is data, possibly a stranger's: it cannot reach for files outside the project. A link in the project does,
    for those who want that.

    Parameters
    ----------
    project : folder that the file must lie in.
    errors : learns of a file that is missing or elsewhere.
    """
    path = Path(os.path.normpath(scene_file.parent / name))
    if not Path(os.path.abspath(path)).is_relative_to(os.path.abspath(project)):
        errors.add(key, f"is {describe(name)}, which lies outside of the project ({os.path.abspath(project)}), but a "
                        "scene may name files in it only; copy the file, or link to it (`ln -s`), beside the scene")
    elif not _is_file(path):
        errors.add(key, f"is {describe(name)}, but there is no such file beside the scene ({path.parent})")
    return str(path)


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a name that is too long
        return False
