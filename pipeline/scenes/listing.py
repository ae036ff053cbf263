"""Which scenes there are: a line for each in a terminal, or a page in Markdown with the liquids that they can name."""
import dataclasses
from collections.abc import Mapping
from pathlib import Path

from pipeline.base.errors import UserError
from pipeline.base.markdown import table
from pipeline.scenes.load import load_scene
from pipeline.scenes.model import Material

FOLDERS = {
    "clinic": "what a surgeon would ask of an eye",
    "papers": "figures of the papers that this project follows",
    "studies": "parts of studies",
    "tests": "tests, and eyes that come to rest",
}
OWN = "yours, in config/scenes itself"
LIQUIDS = """\
What `liquids` of a scene can name ([config/materials.yaml](../config/materials.yaml)). "Unverified" numbers were
not checked against a primary source. Tension and contact angle are those of two liquids on a wall, so a scene has them
under `interface_tension`: that of `tamponade` for oil, that of `gas_eye` for gas, with their sources."""


@dataclasses.dataclass(frozen=True)
class Entry:
    """A scene in a list.

    Attributes
    ----------
    folder : name of its folder in `config/scenes`; empty in `config/scenes` itself.
    dimension : such as "3D". duration : simulated, with its unit.
    """

    name: str
    folder: str
    dimension: str
    duration: str
    title: str
    description: str


def entries_of(paths: Mapping[str, Path], folder: Path) -> list[Entry]:
    """Return scenes by their folders; one with errors has its first one for a title.

    Parameters
    ----------
    paths : files by name, as of ``scene_paths``.
    folder : that they lie below.
    """
    found = []
    for name, path in paths.items():
        within = "" if path.parent == folder else path.parent.name
        try:
            scene = load_scene(path)
        except UserError as error:
            found.append(Entry(name, within, "", "", f"has errors: {error.messages[0]}", ""))
        else:
            found.append(Entry(name, within, f"{scene.dimension}D", f"{scene.output.duration:g} s",
                               scene.title or name, scene.description))
    return sorted(found, key=lambda one: (one.folder, one.name))


def text_of(entries: list[Entry]) -> str:
    """Return a line for each scene: name, dimensions, simulated time, title."""
    wide = max((len(one.name) for one in entries), default=0)
    lines = []
    for folder, inside in _by_folder(entries):
        lines += ["", f"{folder}: {FOLDERS.get(folder, '')}".rstrip(": ") if folder else OWN]
        lines += [f"  {one.name:{wide}}  {one.dimension:2}  {one.duration:>6}  {one.title}" for one in inside]
    return "\n".join(lines[1:]) + "\n"


def markdown_of(entries: list[Entry], liquids: Mapping[str, Material]) -> str:
    """Return the same as a page, with what every scene shows, and a table of liquids by name."""
    lines = ["# Scenes", "",
             "Made by `python -m pipeline.scene --scenes --output docs/scenes.md`. A scene is called by its name,",
             "whatever folder of `config/scenes` it lies in: `./run tamponade`. The [liquids](#liquids) come last.", ""]
    for folder, inside in _by_folder(entries):
        rows = [(f"`{one.name}`", one.dimension, one.duration, one.title, one.description) for one in inside]
        lines += [f"## {folder or 'Yours'}", "", f"{FOLDERS.get(folder, OWN).capitalize()}.", "",
                  table(("scene", "", "simulated", "title", "what it shows"), rows), ""]
    body = [(f"`{name}`", f"{one.density:g}", f"{1e3 * one.dynamic_viscosity:g}", one.source)
            for name, one in liquids.items()]
    lines += ["## Liquids", "", LIQUIDS, "",
              table(("liquid", "density, kg/m³", "viscosity, mPa s", "source"), body), ""]
    return "\n".join(lines)


def _by_folder(entries: list[Entry]) -> list[tuple[str, list[Entry]]]:
    folders = dict.fromkeys(one.folder for one in entries)
    return [(folder, [one for one in entries if one.folder == folder]) for folder in folders]
