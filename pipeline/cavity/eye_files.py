"""The files that an eye is read from: a mesh or an image, and what the head of an NRRD image names beside it."""
import re
from pathlib import Path

from pipeline.base.errors import UserError
from pipeline.scenes.model import Eye

HEAD = 65536    # bytes that hold the head of an NRRD


def eye_files(eye: Eye | None) -> list[str]:
    """Return the files of an eye, the one that the scene names first; none of a parametric eye.

    Raises
    ------
    UserError : the head of an image names voxels that are not in one file beside it.
    """
    if eye is None or not eye.path:
        return []
    voxels = detached(Path(eye.path))
    return [eye.path] if voxels is None else [eye.path, str(voxels)]


def detached(path: Path) -> Path | None:
    """Return the file with the voxels that the head of an NRRD names; ``None`` where the file holds them itself.

    Raises
    ------
    UserError : they are not in one file beside the head: scenes of strangers can read nothing else.
    """
    if not path.name.lower().endswith((".nrrd", ".nhdr")) or not path.is_file():
        return None
    with path.open("rb") as file:
        head = re.split(rb"\r?\n\r?\n", file.read(HEAD))[0]
    named = re.search(rb"^data ?file:[ \t]*(.*?)[ \t\r]*$", head, re.IGNORECASE | re.MULTILINE)
    if named is None:
        return None
    name = named[1].decode("utf-8", "replace")
    if name.startswith("LIST") or re.search(r"%\d*d", name):
        raise UserError(f"{path} (eye.path): its voxels are in many files ({name}), but one is needed: save the image "
                        "as one .nrrd file")
    if Path(name).name != name or name in ("", ".", ".."):
        raise UserError(f"{path} (eye.path): its voxels are in {name or 'no file'}, but must be in a file beside it: "
                        "copy it there, and write its name alone after data file:")
    return path.with_name(name)
