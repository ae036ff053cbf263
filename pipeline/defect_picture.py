"""Picture of the place where a surface cannot be repaired: the surface in gray, the faulty edges in red."""
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pyvista
import trimesh

from pipeline.files import replacing

# Tried in turn: the default window, then OpenGL without a display (a graphics driver, then plain software).
WINDOWS = (None, "vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow")
SECONDS = 60


def picture_of_defect(mesh: trimesh.Trimesh, segments: np.ndarray, path: str | Path) -> bool:
    """Draw a surface and faulty edges (n, 2, 3), both in m, into a PNG; return whether there is a picture.

    A child process draws: without OpenGL the drawing library ends the process, which must not hide the reason for
    which the surface is refused.
    """
    path = Path(path).absolute()
    root = Path(__file__).absolute().parents[1]
    with tempfile.TemporaryDirectory() as folder:
        arrays = Path(folder) / "defect.npz"
        np.savez(arrays, vertices=mesh.vertices, faces=mesh.faces, segments=segments)
        command = [sys.executable, "-m", "pipeline.defect_picture", str(arrays), str(path)]
        for window in WINDOWS:
            environment = os.environ | ({"VTK_DEFAULT_OPENGL_WINDOW": window} if window else {})
            try:
                child = subprocess.run(command, cwd=root, env=environment, capture_output=True, timeout=SECONDS,
                                       check=False)
            except subprocess.TimeoutExpired:
                continue
            if child.returncode == 0:
                return True
    return False


def draw(vertices: np.ndarray, faces: np.ndarray, segments: np.ndarray, path: Path) -> None:
    """Draw triangles (m, 3) of vertices (n, 3) and edges (k, 2, 3) from the side of the edges into a PNG."""
    surface = pyvista.make_tri_mesh(vertices, faces)
    plotter = pyvista.Plotter(off_screen=True, window_size=(1000, 800))
    plotter.set_background("white")
    plotter.add_mesh(surface, color="lightgray", opacity=0.6, edge_color="gray", line_width=0.5,
                     show_edges=len(faces) < 50_000)
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


if __name__ == "__main__":
    with np.load(sys.argv[1]) as data:
        draw(data["vertices"], data["faces"], data["segments"], Path(sys.argv[2]))
