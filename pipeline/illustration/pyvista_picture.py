"""The same opened eye by VTK, where Mitsuba is not installed: light goes around no corners, liquids are tinted."""
from collections.abc import Iterable
from typing import Any

import numpy as np

from pipeline.illustration.geometry import Part
from pipeline.illustration.looks import TISSUES, Look
from pipeline.illustration.view import ANGLE, View
from pipeline.pictures.opengl import off_screen

PEELS = 8
SAMPLING = 2                    # the picture is drawn so many times as large and averaged
FACES = {"oil_face": 0.16, "aqueous_face": 0.72, "cornea": 0.12, "glass": 0.35}        # how opaque
BACKGROUND = ((0.96, 0.97, 0.98), (0.74, 0.79, 0.86))      # below and above
# Lamps: direction (right, up, toward the reader) and strength.
LAMPS = (((-0.55, 0.75, 0.6), 0.75), ((0.9, 0.4, 0.4), 0.35), ((0.05, 0.2, 1.0), 0.5))


def draw(parts: Iterable[Part], look: Look, textures: dict[str, np.ndarray], view: View,
         size: tuple[int, int]) -> np.ndarray:
    """Pixels (height, width, 3) uint8 of a picture; parameters as of ``mitsuba_picture.Tracer``."""
    import pyvista
    from PIL import Image

    plotter = off_screen(window_size=[SAMPLING * length for length in size], lighting="none")
    plotter.set_background(BACKGROUND[0], top=BACKGROUND[1])
    for part in parts:
        _add(plotter, part, look, textures)
    axes = view.axes
    for way, strength in LAMPS:
        plotter.add_light(pyvista.Light(position=view.middle + 200.0 * np.asarray(way) @ axes, focal_point=view.middle,
                                        intensity=strength, light_type="scene light"))
    plotter.camera_position = [view.camera, view.middle, axes[1]]
    plotter.camera.view_angle = float(np.degrees(ANGLE))
    plotter.camera.clipping_range = (20.0, 400.0)
    plotter.enable_depth_peeling(PEELS, occlusion_ratio=0.0)
    plotter.disable_anti_aliasing()
    pixels = plotter.screenshot(None, return_img=True)[..., :3]
    plotter.close()
    return np.asarray(Image.fromarray(np.ascontiguousarray(pixels)).reduce(SAMPLING))


def _add(plotter, part: Part, look: Look, textures: dict[str, np.ndarray]) -> None:
    import pyvista

    mesh = pyvista.make_tri_mesh(part.points, part.triangles)
    if part.normals is not None:
        mesh.point_data.active_normals = np.asarray(part.normals, np.float32)
    options: dict[str, Any] = {"smooth_shading": True, "ambient": 0.25, "diffuse": 0.75, "specular": 0.1}
    if part.name in textures and part.places is not None:
        mesh.active_texture_coordinates = np.asarray(part.places, np.float32)
        rows = _encoded(textures[part.name][::-1])      # the first one is the top here
        options["texture"] = pyvista.Texture(np.ascontiguousarray(rows))
    elif part.name in ("oil_face", "aqueous_face"):
        color = look.skin.color if part.name == "oil_face" else look.media["aqueous"].albedo
        options |= {"color": _encoded(np.array(color)) / 255.0, "opacity": FACES[part.name], "lighting": False}
    elif part.name == "cornea":
        options |= {"color": (0.86, 0.92, 0.96), "opacity": FACES["cornea"], "specular": 0.8, "specular_power": 60}
    elif part.name == "glass":
        options |= {"color": _encoded(np.array(look.skin.color)) / 255.0, "opacity": FACES["glass"], "specular": 0.9,
                    "specular_power": 80}
    else:
        tissue = look.skin if part.name == "interface" else TISSUES[part.name]
        options |= {"color": _encoded(np.array(tissue.color)) / 255.0, "opacity": tissue.opacity,
                    "specular": 0.1 + 0.4 * tissue.gloss, "specular_power": 30}
    plotter.add_mesh(mesh, reset_camera=False, render=False, **options)


def _encoded(linear: np.ndarray) -> np.ndarray:
    return (255.0 * np.clip(linear, 0.0, 1.0) ** (1.0 / 2.2) + 0.5).astype(np.uint8)
