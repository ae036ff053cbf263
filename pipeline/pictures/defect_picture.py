"""Picture of the place where a surface cannot be repaired: the surface in gray, the faulty edges in red."""
from pathlib import Path

import numpy as np
import pyvista
import trimesh

from pipeline.base.cli import describe
from pipeline.base.errors import UserError
from pipeline.base.files import replacing
from pipeline.pictures.opengl import off_screen

MOST_SHOWN_EDGES = 50_000       # triangles; finer meshes turn black when their edges are drawn


def picture_of_defect(mesh: trimesh.Trimesh, segments: np.ndarray, path: str | Path) -> str:
    """Draw a surface and faulty edges (n, 2, 3), both in m, into a PNG; return where it is, or why there is none.

    A machine without OpenGL or room must not hide the reason for which the surface is refused.
    """
    try:
        draw(mesh, segments, Path(path))
    except UserError as missing:
        return f"no picture of the place: {missing}"
    except OSError as error:
        return f"no picture of the place: {describe(error)}"
    return f"see {path}"


def draw(mesh: trimesh.Trimesh, segments: np.ndarray, path: Path) -> None:
    """Draw a surface and edges (n, 2, 3) in m from the side of the edges into a PNG."""
    surface = pyvista.make_tri_mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    plotter = off_screen(window_size=(1000, 800))
    plotter.set_background("white")
    plotter.add_mesh(surface, color="lightgray", opacity=0.6, edge_color="gray", line_width=0.5,
                     show_edges=len(mesh.faces) < MOST_SHOWN_EDGES)
    center, side = np.array(surface.center), np.array([1.0, 0.5, 0.5])
    if len(segments):
        lines = np.insert(np.arange(2 * len(segments)).reshape(-1, 2), 0, 2, axis=1)
        edges = pyvista.PolyData(segments.reshape(-1, 3), lines=lines.ravel())
        plotter.add_mesh(edges, color="red", line_width=6, render_lines_as_tubes=True)
        offset = segments.mean(axis=(0, 1)) - center
        side = offset if np.linalg.norm(offset) > 0.05 * surface.length else side
        plotter.add_text(f"{len(segments)} faulty edges", color="red", font_size=12)
    up = (0.0, 1.0, 0.0) if abs(side[1]) < 0.9 * np.linalg.norm(side) else (0.0, 0.0, 1.0)
    plotter.camera_position = [center + 2.0 * surface.length * side / np.linalg.norm(side), center, up]
    plotter.reset_camera()
    with replacing(path) as temporary:
        plotter.screenshot(temporary)
    plotter.close()
