"""Stage: surfaces of one frame -> a still picture of the opened eye with its oil, for talks and title pages.

Light is followed through the clear oil (``pipeline.pictures.path_tracer``). The watery liquid is not drawn.
Equations: docs/methods/pictures.md.
"""
import argparse
from pathlib import Path

import numpy as np
from PIL import Image

from pipeline.base.cli import run
from pipeline.base.errors import UserError
from pipeline.base.files import replacing
from pipeline.base.frame_files import FrameData, find_frames, read_frame
from pipeline.base.progress import progress
from pipeline.base.threads import checked_threads
from pipeline.base.vtk_files import read_vtk, text_of
from pipeline.scenes.model import Scene
from pipeline.surfaces.surface_files import read_surface, surface_path

CELL = 0.18e-3                  # m, of the distances: the surface of a smaller drop is not seen
SMOOTHING = 0.8                 # cells, over which the distance to the oil is averaged: refraction shows every facet
MARGIN = 1.6e-3                 # m around the wall: its thickness and a bit
INNER_COLORS = {                # share of the light that the inner side of the wall reflects, red green blue
    "retina": (0.72, 0.25, 0.12), "macula": (0.55, 0.15, 0.07), "pars_plana": (0.42, 0.24, 0.15),
    "ciliary_body": (0.30, 0.18, 0.12), "lens": (0.80, 0.86, 0.90), "cornea": (0.80, 0.86, 0.90),
    "anterior": (0.42, 0.24, 0.15),
}
VIEW = (1.0, 0.36, 0.62)        # to the camera: toward the half that is taken away, up, across both
VIEW_DISTANCE, VIEW_ANGLE = 85e-3, np.radians(18.0)
EXPOSURE, WHITE = 1.5, 2.5      # light that is shown as 1 before, and as white after, the curve (Z6)
SAMPLES_AT_ONCE = 4


def picture_axes(gravity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors (3,) up in the picture, and toward the half of the wall that is taken away, across ``up``.

    Up is against gravity, without it superior. The eye is opened along its sagittal plane, and along the horizontal one
    where the patient lies on the side.
    """
    strength = float(np.linalg.norm(gravity))
    up = -np.asarray(gravity, float) / strength if strength else np.array([0.0, 1.0, 0.0])
    side = np.array([1.0, 0.0, 0.0]) if abs(up[0]) < 0.7 else np.array([0.0, 1.0, 0.0])
    side = side - (side @ up) * up
    return up, side / np.linalg.norm(side)


def model_of(eye, oils: list, gravity: np.ndarray):
    """The :class:`pipeline.pictures.path_tracer.Model` of a wall with ``region`` and closed surfaces of oil, in m."""
    import trimesh
    from scipy.ndimage import gaussian_filter
    from scipy.spatial import cKDTree

    from pipeline.cavity.signed_distance_grid import distance_at_nodes, distance_of_mesh, node_positions
    from pipeline.pictures.path_tracer import SHELL, Model

    wall = distance_of_mesh(trimesh.Trimesh(eye.points, eye.regular_faces, process=False), CELL, MARGIN)
    counts = np.array(wall.values.shape)
    oil = np.full(counts, 1.0)
    for surface in oils:
        if surface.n_cells:
            mesh = trimesh.Trimesh(surface.points, surface.regular_faces)
            oil = np.minimum(oil, distance_at_nodes(mesh, wall.origin, counts, CELL, 3.0 * CELL).values)
    near = np.abs(wall.values) < MARGIN
    _, triangle = cKDTree(eye.cell_centers().points).query(node_positions(wall.origin, counts, CELL)[near])
    of_region = np.array([INNER_COLORS[name] for name in text_of(eye, "regions").split("\n")])
    color = np.zeros((*counts, 3), np.float32)
    color[near] = of_region[np.asarray(eye.cell_data["region"])[triangle]]
    up, opened = picture_axes(gravity)
    return Model(wall.values, gaussian_filter(oil, SMOOTHING), color, wall.origin, CELL, up,
                 float((np.asarray(eye.points) @ up).min()) - SHELL, opened)


def developed(light: np.ndarray) -> np.ndarray:
    """Pixels (height, width, 3) uint8 of linear light of the same shape (Z6), in the encoding of sRGB."""
    exposed = EXPOSURE * light
    shown = np.clip(exposed * (1.0 + exposed / WHITE**2) / (1.0 + exposed), 0.0, 1.0)
    encoded = np.where(shown <= 0.0031308, 12.92 * shown, 1.055 * np.maximum(shown, 1e-9) ** (1.0 / 2.4) - 0.055)
    return (255.0 * encoded + 0.5).astype(np.uint8)


def draw(eye, oils: list, gravity: np.ndarray, size: tuple[int, int], samples: int, label: str) -> Image.Image:
    """Picture of one frame; Taichi must run."""
    from pipeline.pictures.path_tracer import Camera, PathTracer

    model = model_of(eye, oils, gravity)
    center, toward = np.asarray(eye.center), np.asarray(VIEW) / np.linalg.norm(VIEW) @ model.axes
    camera = Camera(center + VIEW_DISTANCE * toward, center, VIEW_ANGLE)
    tracer, light = PathTracer(model), np.zeros((size[1], size[0], 3))
    with progress(samples, label, unit="sample") as bar:
        for first in range(0, samples, SAMPLES_AT_ONCE):
            count = min(SAMPLES_AT_ONCE, samples - first)
            light += tracer.trace(camera, size, count, first=first)
            bar.update(count)
    return Image.fromarray(developed(light / samples))


def frame_at(folder: Path, time: float | None) -> tuple[str, FrameData]:
    """Name and data of the frame of a folder that is nearest to a time in s; of the last one without."""
    frames = [(path.stem, read_frame(path)) for path in find_frames(folder)[slice(-1 if time is None else None, None)]]
    return min(frames, key=lambda found: 0.0 if time is None else abs(found[1].time - time))


def clear_oils(scene: Scene) -> list[str]:
    """Names of the liquids that are drawn: those in bulk that are not clear water.

    Raises
    ------
    UserError : the scene has no eye, or no such liquid.
    """
    from pipeline.scenes.effects import droplets_of

    if scene.container is not None or scene.dimension != 3:
        raise UserError(f"{scene.name}: has no eye; a still shows the oil in one")
    oils = [liquid.name for index, liquid in enumerate(scene.liquids)
            if not liquid.clear and index != droplets_of(scene)]
    if not oils:
        raise UserError(f"{scene.name}: `liquids` are all clear ones; a still shows the oil in them")
    return oils


def size_of(text: str) -> tuple[int, int]:
    """Width and height of "1600x900"."""
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal() and 16 <= int(width) <= 8192 and 16 <= int(height) <= 8192):
        raise argparse.ArgumentTypeError(f"is {text}, but must be such as 1600x900, 16 to 8192 pixels each")
    return int(width), int(height)


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m pipeline.still",
                                     description="Draw one frame as a still picture with glassy oil.")
    parser.add_argument("scene", type=Path, metavar="scene.json", help="resolved scene")
    parser.add_argument("eye", type=Path, metavar="eye.vtp", help="surface of the cavity")
    parser.add_argument("frames", type=Path, metavar="FRAMES_DIR", help="folder of frames")
    parser.add_argument("surfaces", type=Path, metavar="SURFACES_DIR", help="folder of the reconstruct stage")
    parser.add_argument("--output", required=True, type=Path, metavar="still.png", help="picture to write")
    parser.add_argument("--time", type=float, metavar="SECONDS", help="the frame nearest to it (default: the last)")
    parser.add_argument("--size", type=size_of, default=(1600, 900), metavar="WIDTHxHEIGHT",
                        help="pixels, 16 to 8192 each (default: 1600x900)")
    parser.add_argument("--samples", type=int, default=128, metavar="N",
                        help="paths of light through every pixel: four times as many halve the noise (default: 128)")
    parser.add_argument("--threads", type=int, default=0, metavar="N", help="default: as many as are useful")
    options = parser.parse_args(arguments)
    if options.samples < 1:
        raise UserError(f"--samples is {options.samples}, but must be at least 1")
    if not options.eye.is_file():
        raise UserError(f"{options.eye}: no such file; run the eye stage first")
    threads = checked_threads(options.threads, "--threads")

    from pipeline.scenes.load import load_resolved
    from sim.runtime import initialize

    scene = load_resolved(options.scene)
    oils = clear_oils(scene)
    name, frame = frame_at(options.frames, options.time)
    initialize("f32", threads)
    picture = draw(read_vtk(options.eye), [read_surface(surface_path(options.surfaces, name, oil)) for oil in oils],
                   frame.gravity, options.size, options.samples, f"{scene.name}: still")
    with replacing(options.output) as partial:
        picture.save(partial, format="PNG")
    print(f"{options.output}: t = {frame.time:.2f} s, {options.samples} paths of light per pixel")


if __name__ == "__main__":
    run(main)
