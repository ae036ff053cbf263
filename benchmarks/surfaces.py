"""Surfaces of the liquids, measured: contact line, normals, curvature, volumes, drops, films and CPU seconds.

    python benchmarks/surfaces.py                          balls of 90,000 particles, a cap, drops and films
    python benchmarks/surfaces.py --runs outputs/tamponade/draft outputs/emulsification/draft
                                                           frames 5, 10, 15, 20 of these runs as well
    python benchmarks/surfaces.py --count 20000            smaller balls, a minute
    python benchmarks/surfaces.py --contour marching_cubes --skip balls

pysplashsurf is measured beside, in the same process and by one thread too, where it is installed. CPU seconds count
only beside those of another program in the same run. The clouds are random, but the same in every run.
"""
import argparse
import os
import time
from pathlib import Path

for library in ("OMP_NUM_THREADS", "RAYON_NUM_THREADS"):     # before they are loaded: of NumPy, and of the peer
    os.environ.setdefault(library, "1")

import numpy as np  # noqa: E402
from scipy.spatial import cKDTree  # noqa: E402

from pipeline.base.frame_files import FrameData, find_frames, read_frame  # noqa: E402
from pipeline.base.markdown import table  # noqa: E402

KERNELS = ("isotropic", "anisotropic")
VOLUME = 4.39e-6        # m**3 of oil in the balls
TURNS = 7               # in which CPU seconds are measured; the median counts
FRAMES = (5, 10, 15, 20)
ALONG = 1e-3            # m, over which a contact line is smoothed
STEP = 0.5e-3           # m, over which its turning is measured
SHORTEST = 6e-3         # m, contact lines below this are left out


# Clouds

def relaxed_ball(count: int) -> tuple[np.ndarray, float, float]:
    """Particles (n, 3), radius and spacing of a ball that is packed as the start of a scene is."""
    from pipeline.cavity.shapes import shape_arrays
    from sim.packing import pack

    radius, spacing = (0.75 * VOLUME / np.pi) ** (1 / 3), (VOLUME / count) ** (1 / 3)
    arrays = shape_arrays("sphere", radius, spacing, dimension=3)
    position, _ = pack(arrays["fluid_position"], arrays["fluid_volume"], arrays["wall_position"],
                       arrays["wall_volume"], spacing, 2.5, 150)
    return position, radius, spacing


def lattice_ball(radius: float, spacing: float, jitter: float = 0.2) -> np.ndarray:
    """Particles (n, 3) of a lattice with random places, cut by a ball."""
    half = int(np.ceil(radius / spacing)) + 1
    axis = (np.arange(-half, half) + 0.5) * spacing
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    points = points + np.random.default_rng(0).uniform(-jitter, jitter, points.shape) * spacing
    return points[np.linalg.norm(points, axis=1) < radius]


def ball_cavity(radius: float, spacing: float) -> dict[str, np.ndarray]:
    """Arrays of `initial.npz` of a ball, without wall particles."""
    cell = 0.5 * spacing
    half = int(np.ceil((radius + 5.0 * spacing) / cell))
    axis = cell * np.arange(-half, half + 1)
    distance = np.sqrt(axis[:, None, None] ** 2 + axis[:, None] ** 2 + axis**2) - radius
    return {"sdf_values": distance, "sdf_origin": np.full(3, axis[0]), "sdf_cell": np.array(cell),
            "particle_spacing": np.array(spacing), "dimension": np.array(3),
            "cavity_volume": np.array(4.0 / 3.0 * np.pi * radius**3),
            "wall_position": np.zeros((0, 3)), "wall_volume": np.zeros(0)}


def frame_of(position: np.ndarray, phase: np.ndarray, volume: float, liquids: int) -> FrameData:
    """Frame of particles of equal volume."""
    count = len(position)
    return FrameData(
        position=position.astype(np.float32), id=np.arange(count), phase=phase.astype(np.int32),
        velocity=np.zeros((count, 3), np.float32), pressure=np.zeros(count), volume=np.full(count, volume),
        volume_fraction=np.eye(liquids, dtype=np.float32)[phase.astype(int)], compression_rate=np.ones(count),
        time=0.0, step=0, gravity=np.zeros(3), particle_spacing=volume ** (1 / 3), scene="benchmark",
        liquids=tuple(f"liquid {k}" for k in range(liquids)))


# Measures

def normals(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Normals (t, 3) of triangles, as long as twice their areas."""
    a, b, c = (vertices[corner] for corner in triangles.T)
    return np.cross(b - a, c - a)


def enclosed(vertices: np.ndarray, triangles: np.ndarray) -> float:
    """Volume inside a closed mesh."""
    a, b, c = (vertices[corner] for corner in triangles.T)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def spread_of_normals(vertices: np.ndarray, triangles: np.ndarray) -> float:
    """Angle in degrees between the normals and the rays from the origin, rms over the area."""
    normal, ray = normals(vertices, triangles), vertices[triangles].mean(axis=1)
    area = np.linalg.norm(normal, axis=1)
    cosine = (normal * ray).sum(axis=1) / np.maximum(area * np.linalg.norm(ray, axis=1), 1e-300)
    return float(np.degrees(np.sqrt(area @ np.arccos(np.clip(cosine, -1.0, 1.0)) ** 2 / area.sum())))


def contact_lines(vertices: np.ndarray, triangles: np.ndarray, depth: np.ndarray, at_wall: float) -> list[np.ndarray]:
    """Closed lines (k, 3) between the triangles at the wall (all depths below ``at_wall``) and the others."""
    wall = (depth[triangles] < at_wall).all(axis=1)
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]).astype(np.int64)
    of_wall, count = np.tile(wall, 3), len(vertices)
    key, back = edges[:, 0] * count + edges[:, 1], edges[:, 1] * count + edges[:, 0]
    order = np.argsort(key)
    beyond = of_wall[order[np.searchsorted(key, back, sorter=order)]]
    following: dict[int, list[int]] = {}
    for start, end in edges[of_wall & ~beyond]:
        following.setdefault(start, []).append(end)
    lines = []
    while following:
        line = [next(iter(following))]
        while line[-1] in following and (len(line) == 1 or line[-1] != line[0]):
            ends = following[line[-1]]
            line.append(ends.pop())
            if not ends:
                del following[line[-2]]
        lines.append(vertices[line])
    return lines


def resampled(line: np.ndarray, step: float) -> tuple[np.ndarray, float]:
    """Points (k, 3) of a closed line at equal distances near ``step``, without the repeated last one; the distance."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    count = max(3, round(along[-1] / step))
    places = np.arange(count) * along[-1] / count
    return np.stack([np.interp(places, along, line[:, axis]) for axis in range(3)], axis=1), along[-1] / count


def roughness(lines: list[np.ndarray]) -> tuple[float, float]:
    """Length over smoothed length, and turning per ``STEP`` (degrees, rms), of all lines that are long enough."""
    length = smoothed = 0.0
    turns = []
    for line in lines:
        fine, step = resampled(line, ALONG / 50.0)
        if step * len(fine) < SHORTEST:
            continue
        kernel = np.ones(round(ALONG / step)) * step / ALONG
        even = np.stack([np.convolve(np.tile(axis, 3), kernel, "same")[len(fine):2 * len(fine)] for axis in fine.T], 1)
        length += step * len(fine)
        smoothed += np.linalg.norm(even - np.roll(even, 1, axis=0), axis=1).sum()
        points, _ = resampled(line, STEP)
        way = np.roll(points, -1, axis=0) - points
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        turns.append(np.arccos(np.clip((way * np.roll(way, 1, axis=0)).sum(axis=1), -1.0, 1.0)))
    if not turns:
        return float("nan"), float("nan")
    return length / smoothed, float(np.degrees(np.sqrt(np.mean(np.concatenate(turns) ** 2))))


def of_droplets(lines: list[np.ndarray], frame: FrameData, spacing: float) -> list[bool]:
    """Whether the contact lines are around pieces so small that they count as droplets, whose levels are not smoothed.

    A circle of length L turns by 180 mm/L degrees per 0.5 mm however smooth it is: those of droplets by more than 8.
    """
    from pipeline.surfaces.droplets import find_droplets

    small = np.zeros(len(frame.phase), bool)
    for liquid in range(len(frame.liquids)):
        small[[particle for piece in find_droplets(frame, liquid, spacing) for particle in piece]] = True
    trees = [(cKDTree(frame.position[own]), small[own]) for own in
             (np.flatnonzero(frame.phase == liquid) for liquid in range(len(frame.liquids))) if len(own)]
    return [any(few[tree.query(line)[1]].mean() > 0.5 for tree, few in trees) for line in lines]


def curvature_noise(vertices: np.ndarray, triangles: np.ndarray, depth: np.ndarray,
                    spacing: float) -> tuple[float, float]:
    """Noise of the mean curvature and its mean, 1/m, from quadrics through vertices and what is within 1.5 spacings.

    Noise is how far it is from its mean within 4 spacings: rms of all vertices more than 1.5 spacings deep.
    """
    radius = 1.5 * spacing
    normal = np.zeros_like(vertices)
    for corner in triangles.T:
        np.add.at(normal, corner, normals(vertices, triangles))
    away = np.flatnonzero(depth > radius)
    if not len(away):
        return float("nan"), float("nan")
    chosen, used, curvature = np.random.default_rng(0).permutation(away)[:1500], [], []
    for vertex, near in zip(chosen, cKDTree(vertices).query_ball_point(vertices[chosen], radius), strict=True):
        if len(near) < 8:
            continue
        up = normal[near].sum(axis=0)
        up /= np.linalg.norm(up)
        side = np.cross(up, np.eye(3)[np.abs(up).argmin()])
        side /= np.linalg.norm(side)
        x, y, z = ((vertices[near] - vertices[vertex]) @ np.stack([side, np.cross(up, side), up], axis=1)).T / radius
        p, q, r, s, t = np.linalg.lstsq(np.stack([x, y, x * x / 2, x * y, y * y / 2], axis=1), z, rcond=None)[0]
        curvature.append(-((1 + q * q) * r - 2 * p * q * s + (1 + p * p) * t) / (2 * (1 + p * p + q * q) ** 1.5))
        used.append(vertex)
    values = np.array(curvature) / radius
    around = cKDTree(vertices[used]).query_ball_point(vertices[used], 4.0 * spacing)
    smooth = np.array([values[near].mean() for near in around])
    return float(np.sqrt(np.mean((values - smooth) ** 2))), float(values.mean())


# Tables

def balls(count: int, contour: str) -> str:
    """Balls in a void: ours with the smoothing of a full cavity and of a free surface, and the peer."""
    relaxed, radius, spacing = relaxed_ball(count)
    frames = [frame_of(cloud, np.zeros(len(cloud)), spacing**3, 1)
              for cloud in (relaxed, lattice_ball(radius, spacing))]
    cavity = ball_cavity(radius + 4.3 * spacing, spacing)
    made = {f"{kernel}, smoothed over {length:g} dx, cell {cell:g} dx": _ours(cavity, contour, cell, kernel, length)
            for cell, kernel, length in ((0.5, "isotropic", 1.0), (0.5, "isotropic", 0.5), (0.5, "anisotropic", 1.0),
                                         (0.5, "anisotropic", 0.5), (0.25, "isotropic", 1.0), (1.0, "isotropic", 1.0))}
    try:
        made |= {f"pysplashsurf, {name}": _peer(spacing, cube, options) for name, cube, options in (
            ("raw, cell 0.5 dx", 1.0, {}),
            ("25 weighted passes, cell 0.5 dx", 1.0, {"mesh_smoothing_iters": 25}),
            ("25 weighted passes, clean-up, cell 0.25 dx", 0.5, {"mesh_smoothing_iters": 25, "mesh_cleanup": True}))}
        left_out = ""
    except ImportError:
        left_out = "\n\npysplashsurf is not installed: left out."
    meshes = {name: [make(frame) for frame in frames] for name, make in made.items()}      # ours compiles
    seconds: dict[str, list[float]] = {name: [] for name in made}
    for _ in range(TURNS):      # in turns, so that other work on the machine meets all of them
        for name, make in made.items():
            begin = time.process_time()
            make(frames[0])
            seconds[name].append(time.process_time() - begin)
    body = []
    for name, both in meshes.items():
        volumes = [frame.volume.sum() for frame in frames]
        body.append((name, f"{np.median(seconds[name]):.3f}",
                     " / ".join(f"{100.0 * (enclosed(*mesh) / volume - 1.0):+.2f}"
                                for mesh, volume in zip(both, volumes, strict=True)),
                     " / ".join(f"{spread_of_normals(*mesh):.2f}" for mesh in both), f"{len(both[0][1]):,}"))
    return table(("surface", "CPU s", "volume %, relaxed / rough", "normals deg, relaxed / rough", "triangles"),
                 body) + left_out


def _ours(cavity: dict, contour: str, cell: float, kernel: str, length: float):
    """Return what makes vertices and triangles of a frame."""
    from pipeline.surfaces.liquid_surface import Reconstructor

    reconstructor = Reconstructor(cavity, 1, cell_ratio=cell, method=contour, kernel=kernel, smoothing_length=length,
                                  free_surface=True)

    def make(frame: FrameData):
        mesh = reconstructor.surfaces(frame)[0].mesh
        return mesh.vertices, mesh.triangles

    return make


def _peer(spacing: float, cube: float, options: dict):
    """Return what makes vertices and triangles of a frame by pysplashsurf."""
    import pysplashsurf

    def make(frame: FrameData):
        done = pysplashsurf.reconstruction_pipeline(
            frame.position, particle_radius=0.5 * spacing, rest_density=1000.0, smoothing_length=2.0,
            cube_size=cube, iso_surface_threshold=0.6, mesh_smoothing_weights=bool(options), **options)
        mesh = done[0] if isinstance(done, tuple) else done
        mesh = getattr(mesh, "mesh", mesh)
        return np.asarray(mesh.vertices, float), np.asarray(mesh.triangles, int)

    return make


def cap(contour: str) -> str:
    """Oil over a plane in a full ball: the contact line is a circle."""
    from pipeline.surfaces.liquid_surface import Reconstructor

    radius, spacing, height, body = 11e-3, 0.6e-3, 3e-3, []
    position = lattice_ball(radius - 0.4 * spacing, spacing)
    exact = np.sqrt(radius**2 - height**2)
    volume = 4.0 / 3.0 * np.pi * radius**3 / len(position)
    for kernel in KERNELS:
        reconstructor = Reconstructor(ball_cavity(radius, spacing), 2, method=contour, kernel=kernel)
        phase = position @ (0.0, 0.8, 0.6) > height
        surfaces = reconstructor.surfaces(frame_of(position, phase, volume, 2))
        water, oil = (surface.mesh for surface in surfaces)
        depth = reconstructor.depth_at(oil.vertices)
        lines = contact_lines(oil.vertices, oil.triangles, depth, 0.05 * spacing)
        ratio, turning = roughness(lines)
        round_ = [np.linalg.norm(line - np.outer(line @ (0.0, 0.8, 0.6), (0.0, 0.8, 0.6)), axis=1) for line in lines]
        inner = oil.vertices[depth > spacing]
        apart = cKDTree(water.vertices).query(inner)[0].max()
        body.append((kernel, f"{ratio:.3f}", f"{turning:.1f}",
                     f"{1e3 * np.concatenate(round_).mean():.2f} ± {1e3 * np.concatenate(round_).std():.2f}",
                     f"{1e3 * exact:.2f}", f"{1e3 * apart:.4f}", f"{-1e3 * depth.min():.3f}",
                     " / ".join(f"{100.0 * surface.statistics['volume_error']:+.3f}" for surface in surfaces)))
    return table(("kernel", "length over smoothed", "turning deg per 0.5 mm", "radius mm", "exact mm",
                  "between the liquids mm", "beyond the wall mm", "volume %, aqueous / oil"), body)


def drops_and_films(contour: str) -> str:
    """Volumes of drops of 1, 7 and 50 particles in water, and how much is left of films of one and of two layers."""
    from pipeline.surfaces.liquid_surface import Reconstructor

    radius, spacing, body = 11e-3, 0.6e-3, []
    position = lattice_ball(radius - 0.4 * spacing, spacing, jitter=0.05)
    volume, tree = 4.0 / 3.0 * np.pi * radius**3 / len(position), cKDTree(position)
    centers = np.stack(np.meshgrid(*[np.arange(-6e-3, 7e-3, 4e-3)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    centers = centers[np.linalg.norm(centers, axis=1) < 0.75 * radius]
    for kernel in KERNELS:
        reconstructor, cells = Reconstructor(ball_cavity(radius, spacing), 2, method=contour, kernel=kernel), [kernel]
        for count in (1, 7, 50):
            phase = np.zeros(len(position))
            phase[tree.query(centers, count)[1].ravel()] = 1
            mesh = reconstructor.surfaces(frame_of(position, phase, volume, 2))[1].mesh
            drops = mesh.component_volumes() / (count * volume) - 1.0
            cells.append(f"{100.0 * np.abs(drops).max():.1f}" if len(drops) == len(centers) else "torn")
        for layers in (1, 2):
            phase = (position[:, 1] > 0.0) & (position[:, 1] < layers * spacing)
            mesh = reconstructor.surfaces(frame_of(position, phase, volume, 2))[1].mesh
            inner = np.linalg.norm(mesh.vertices[mesh.triangles].mean(axis=1), axis=1) < 0.6 * radius
            up = np.maximum(normals(mesh.vertices, mesh.triangles)[inner, 1], 0.0).sum() / 2.0
            cells.append(f"{100.0 * up / (np.pi * (0.6 * radius) ** 2):.0f}")
        body.append(cells)
    return table(("kernel", "drops of 1: off by %", "of 7", "of 50", "film of 1 layer: area left %", "of 2"), body)


def runs(folders: list[Path], contour: str) -> str:
    """Contact line and curvature in frames of runs."""
    from pipeline.cavity.initial_state import load_initial
    from pipeline.surfaces.liquid_surface import Reconstructor

    body = []
    for folder in folders:
        initial = load_initial(folder / "initial.npz")
        paths = {path.stem: path for segment in (folder / "frames").iterdir() if segment.is_dir()
                 for path in find_frames(segment)}
        for kernel in KERNELS:
            reconstructor = Reconstructor(initial, 2, method=contour, kernel=kernel)
            for index in FRAMES:
                frame = read_frame(paths[f"frame_{index:05d}"])
                oil = reconstructor.surfaces(frame)[1]
                mesh, spacing = oil.mesh, reconstructor.grid.spacing
                depth = reconstructor.depth_at(mesh.vertices)
                lines = contact_lines(mesh.vertices, mesh.triangles, depth, 0.03 * spacing)
                small = of_droplets(lines, frame, spacing)
                (ratio, turning), (_, rest) = (
                    roughness([line for line, few in zip(lines, small, strict=True) if few == wanted])
                    for wanted in (False, True))
                noise, mean = curvature_noise(mesh.vertices, mesh.triangles, depth, spacing)
                body.append((folder.parent.name, index, kernel, f"{ratio:.3f}", f"{turning:.1f}",
                             "" if np.isnan(rest) else f"{rest:.1f}",
                             f"{noise:.0f} of {mean:.0f}", f"{100.0 * oil.statistics['volume_error']:+.3f}"))
    return table(("scene", "frame", "kernel", "contact line: length over smoothed", "turning deg per 0.5 mm",
                  "the same of droplets", "noise of the mean curvature 1/m", "volume of the oil %"), body)


def main() -> None:
    """Command line."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--count", type=int, default=90_000, help="particles of a ball")
    p.add_argument("--contour", default="sharp", help="as `output.contour`")
    p.add_argument("--runs", type=Path, nargs="*", default=[], metavar="FOLDER", help="scene at an accuracy level")
    p.add_argument("--skip", nargs="*", default=[], choices=("balls", "cap", "drops"), help="parts to leave out")
    options = p.parse_args()
    from sim.backend.runtime import initialize

    initialize("f32", 1)
    for name, made in (("balls", lambda: balls(options.count, options.contour)), ("cap", lambda: cap(options.contour)),
                       ("drops", lambda: drops_and_films(options.contour))):
        if name not in options.skip:
            print(f"\n## {name}\n\n{made()}", flush=True)
    if options.runs:
        print(f"\n## runs\n\n{runs(options.runs, options.contour)}")


if __name__ == "__main__":
    main()
