"""Surfaces of a frame in the formats of other programs: STL and PLY one by one, glTF with all of them, colored."""
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import trimesh

from pipeline.base.files import replacing
from pipeline.scenes.model import Scene
from pipeline.scenes.shown_liquids import liquid_around
from pipeline.surfaces.saved_frame import SavedFrame
from pipeline.surfaces.surface_files import EMPTY, read_surface

WALL_COLOR = "#dfe5ec"
WALL_OPACITY, CLEAR_OPACITY = 0.25, 0.35  # of the wall, and of the liquid around the others
ROUGHNESS = 0.35


def mesh_of(path: Path) -> trimesh.Trimesh:
    """Return the triangles of a surface file in m; it may be empty.

    Raises
    ------
    UserError : the file is missing.
    """
    surface = read_surface(path)
    faces = surface.regular_faces if surface.n_cells else np.zeros((0, 3), int)
    return trimesh.Trimesh(np.asarray(surface.points, float), faces, process=False)


def meshes_of(frame: SavedFrame, scene: Scene, wall: Path) -> dict[str, trimesh.Trimesh]:
    """Return the closed surfaces of a frame in m, name of the liquid or ``wall`` -> mesh; one may be empty."""
    files = {liquid.name: frame.surface_path(liquid.name) for liquid in scene.liquids}
    return {name: mesh_of(path) for name, path in (files | {"wall": wall}).items()}


def colors_of(scene: Scene) -> dict[str, tuple[str, float]]:
    """Return the color, #rrggbb in sRGB, and the opacity of every liquid and of the ``wall``."""
    return {liquid.name: (liquid.color, CLEAR_OPACITY if liquid is liquid_around(scene) else 1.0)
            for liquid in scene.liquids} | {"wall": (WALL_COLOR, WALL_OPACITY)}


def linear(color: str) -> np.ndarray:
    """Return red, green and blue (3,) of a color #rrggbb as amounts of light, with which programs multiply."""
    light = np.array([int(color[k:k + 2], 16) / 255.0 for k in (1, 3, 5)])
    return np.where(light <= 0.04045, light / 12.92, ((light + 0.055) / 1.055) ** 2.4)


def write_meshes(folder: Path, name: str, meshes: Mapping[str, trimesh.Trimesh], scene: Scene,
                 formats: Sequence[str], factor: float = 1.0) -> list[Path]:
    """Write meshes into ``folder`` and return the files.

    Parameters
    ----------
    name : first part of the names of the files.
    formats : "glb", "ply" or "stl". glTF is in m, as it has to be.
    factor : units of length per m in STL and PLY, which name none.
    """
    written = []
    for suffix in formats:
        if suffix == "glb":
            contents = {f"{name}.glb": gltf(meshes, scene)}
        else:
            contents = {f"{name}_{part}.{suffix}": mesh.copy().apply_scale(factor).export(file_type=suffix)
                        if len(mesh.faces) else EMPTY[f".{suffix}"] for part, mesh in meshes.items()}
        for file, content in contents.items():
            with replacing(folder / file) as partial:
                partial.write_bytes(content)
            written.append(folder / file)
    return written


def gltf(meshes: Mapping[str, trimesh.Trimesh], scene: Scene) -> bytes:
    """Return one binary glTF file with a named node for every mesh that is not empty."""
    colors = colors_of(scene)
    whole = trimesh.Scene()
    for name, mesh in meshes.items():
        if len(mesh.faces):
            shown, (color, opacity) = mesh.copy(), colors[name]
            shown.visual = trimesh.visual.TextureVisuals(material=material(name, color, opacity))
            whole.add_geometry(shown, node_name=name, geom_name=name)
    return whole.export(file_type="glb", include_normals=True)


def material(name: str, color: str, opacity: float) -> trimesh.visual.material.PBRMaterial:
    """Return a smooth dielectric of a color, #rrggbb in sRGB."""
    return trimesh.visual.material.PBRMaterial(
        name=name, baseColorFactor=[*linear(color), opacity], metallicFactor=0.0, roughnessFactor=ROUGHNESS,
        doubleSided=True, alphaMode="OPAQUE" if opacity == 1.0 else "BLEND")
