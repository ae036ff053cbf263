"""Stage: the bodies of every liquid - its pieces as the reconstructed surfaces show them - counted and measured.

A body is what one outer surface encloses; what lies in a hollow of it is taken off. In a mixture the surface is where
the liquid outweighs every other. Droplets below the particle spacing are no bodies: they are a volume fraction.
"""
import dataclasses
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pipeline.base.canvas import empty_figure
from pipeline.base.cli import run, stage_parser
from pipeline.base.errors import UserError
from pipeline.base.files import replacing
from pipeline.base.palette import curve_style
from pipeline.base.progress import progress
from pipeline.base.sequences import SURFACES_AGAIN, in_sequence
from pipeline.base.words import no_formula
from pipeline.runs.segments import check_segments
from pipeline.scenes.load import load_resolved
from pipeline.scenes.model import Scene
from pipeline.surfaces.contour_lines import signed_area
from pipeline.surfaces.surface_files import lines_of, read_statistics, read_surface, surface_path

COLUMNS = {
    "frame": "number of the frame",
    "time [s]": "simulated time",
    "liquid": "name of the liquid",
    "body": "number of the body among those of its liquid, the largest is 0",
    "volume [mL]": "enclosed volume; in two dimensions that of a layer 1 m deep",
    "diameter [mm]": "of the ball, in two dimensions the disc, of that volume",
    "area [cm2]": "outer and hollow surfaces, the wall included; in two dimensions their length times 1 m",
    "interface [cm2]": "the part of that area farther from the wall than half a particle spacing",
    "x [mm]": "center of the volume, x to the patient's left",
    "y [mm]": "superior",
    "z [mm]": "anterior",
}


@dataclasses.dataclass
class Body:
    """A connected piece of liquid, with its hollows taken off.

    Attributes
    ----------
    volume, area, interface : m3, m2, m2; in two dimensions m2, m, m.
    center, lower, upper : (3,) m, of the volume, and the corners of its box.
    """

    volume: float
    area: float
    interface: float
    center: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    def diameter(self, dimension: int) -> float:
        """Diameter (m) of the ball or disc of the same volume."""
        return float((6.0 * self.volume / np.pi) ** (1 / 3) if dimension == 3 else (4.0 * self.volume / np.pi) ** 0.5)


def bodies_of(surface, spacing: float) -> list[Body]:
    """Bodies of a closed surface (pyvista.PolyData with point data ``depth``, m), the largest first."""
    if surface.n_points == 0:
        return []
    away = np.asarray(surface.point_data["depth"]) > 0.5 * spacing
    shells = _shells(surface, away) if len(surface.faces) else _rings(surface, away)
    outer = [shell for shell in shells if shell.volume > 0.0]
    for hollow in (shell for shell in shells if shell.volume < 0.0):
        _take_off(hollow, outer)
    return sorted(outer, key=lambda body: -body.volume)


def _take_off(hollow: Body, outer: Sequence[Body]) -> None:
    """Subtract a hollow from the body around it: that with the smallest box around the hollow's box."""
    around = [body for body in outer if (body.lower <= hollow.lower).all() and (hollow.upper <= body.upper).all()]
    if not around:
        return
    body = min(around, key=lambda one: np.linalg.norm(one.upper - one.lower))
    total = body.volume + hollow.volume
    body.center = (body.volume * body.center + hollow.volume * hollow.center) / total
    body.volume, body.area, body.interface = total, body.area + hollow.area, body.interface + hollow.interface


def _shells(surface, away: np.ndarray) -> list[Body]:
    """The connected pieces of a triangle mesh; a piece that faces inward has a negative volume."""
    points, triangles = np.asarray(surface.points, float), surface.regular_faces
    links = triangles[:, [0, 1, 0, 2]].reshape(-1, 2)
    graph = coo_matrix((np.ones(len(links), bool), tuple(links.T)), shape=(len(points),) * 2)
    _, label = connected_components(graph, directed=False)
    pieces, piece = np.unique(label[triangles[:, 0]], return_inverse=True)
    origin = points.mean(axis=0)
    a, b, c = np.moveaxis((points - origin)[triangles], 1, 0)
    normal = np.cross(b - a, c - a)
    area = 0.5 * np.linalg.norm(normal, axis=1)
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
    moment = volume[:, None] * (a + b + c) / 4.0
    count = len(pieces)
    totals = [np.bincount(piece, values, count) for values in (volume, area, area * away[triangles].mean(axis=1))]
    moments = np.stack([np.bincount(piece, moment[:, axis], count) for axis in range(3)], axis=-1)
    lower, upper = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(lower, piece, points[triangles].min(axis=1))
    np.maximum.at(upper, piece, points[triangles].max(axis=1))
    return [Body(v, s, i, origin + m / v, low, high)
            for v, s, i, m, low, high in zip(*totals, moments, lower, upper, strict=True) if v != 0.0]


def _rings(surface, away: np.ndarray) -> list[Body]:
    """The closed lines of a plane; a line that runs clockwise has a negative area."""
    rings, tree = [], cKDTree(np.asarray(surface.points, float))
    for line in (line.astype(float) for line in lines_of(surface)):
        area = signed_area(line[:, :2])
        sides = np.linalg.norm(np.diff(line, axis=0), axis=1)
        free = away[tree.query(line)[1]].astype(float)
        if area != 0.0:
            rings.append(Body(area, sides.sum(), sides @ (0.5 * (free[:-1] + free[1:])), _center(line, area),
                              line.min(axis=0), line.max(axis=0)))
    return rings


def _center(line: np.ndarray, area: float) -> np.ndarray:
    """Center (3,) of the area (m2) inside a closed line (k, 3) in the plane z = 0."""
    x, y = (line[:, :2] - line[0, :2]).T
    cross = x[:-1] * y[1:] - x[1:] * y[:-1]
    inner = [((values[:-1] + values[1:]) @ cross) / (6.0 * area) for values in (x, y)]
    return line[0] + np.array([*inner, 0.0])


def measure(scene: Scene, folders: Iterable[Path]) -> list[dict[str, Any]]:
    """Return one row per body, in the order of frames, liquids and size.

    Raises
    ------
    UserError : a folder holds no surfaces of this scene, or not those of every frame.
    """
    rows, spacing = [], scene.numerics.particle_spacing
    folders = list(folders)
    frames = in_sequence((path for folder in folders for path in Path(folder).glob("frame_*.json")), SURFACES_AGAIN)
    if not frames:
        raise UserError(f"{', '.join(map(str, folders))}: no surfaces there; run the reconstruct stage first")
    check_segments(scene, frames, SURFACES_AGAIN)
    with progress(len(frames), f"{scene.name}: bodies") as bar:
        for path in frames:
            time = float(read_statistics(path)["time"])
            for liquid in scene.liquids:
                surface = read_surface(surface_path(path.parent, path.stem, liquid.name))
                for number, body in enumerate(bodies_of(surface, spacing)):
                    x, y, z = 1e3 * body.center
                    values = (int(path.stem.rpartition("_")[2]), time, liquid.name, number, 1e6 * body.volume,
                              1e3 * body.diameter(scene.dimension), 1e4 * body.area, 1e4 * body.interface, x, y, z)
                    rows.append(dict(zip(COLUMNS, values, strict=True)))
            bar.update(1)
    return rows


def write_bodies(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    """Write the rows as CSV."""
    lines = [",".join(COLUMNS), *(",".join(f"{value:.9g}" if isinstance(value, float) else str(value)
                                           for value in row.values()) for row in rows), ""]
    with replacing(path) as partial:
        partial.write_text("\n".join(lines))


def write_plot(path: Path, rows: Sequence[dict[str, Any]], scene: Scene) -> None:
    """Draw the number of bodies of every liquid over time, and how their sizes are distributed at the end."""
    from matplotlib.ticker import MaxNLocator

    canvas = empty_figure((12, 4.5))
    left, right = canvas.subplots(1, 2)
    spacing = 1e3 * scene.numerics.particle_spacing
    frames = sorted({row["frame"]: row["time [s]"] for row in rows}.items())
    for number, liquid in enumerate(one.name for one in scene.liquids):
        own = [row for row in rows if row["liquid"] == liquid]
        if not own:
            continue
        counts = [sum(row["frame"] == frame for row in own) for frame, _ in frames]
        style = {"where": "post", "label": liquid.replace("_", " "), **curve_style(number)}
        left.step([time for _, time in frames], counts, **style)
        size = np.sort([row["diameter [mm]"] for row in own if row["frame"] == frames[-1][0]])
        right.step([0.1 * spacing, *size], np.arange(len(size), -1, -1), **style)
    left.set(xlabel="simulated time [s]", ylabel="bodies")
    # From the size of a single particle to beyond the largest body.
    largest = max((row["diameter [mm]"] for row in rows), default=1.0)
    right.set(xlabel="diameter of the ball of equal volume [mm]", ylabel="bodies of at least this size", xscale="log",
              xlim=(spacing, 2.0 * max(largest, spacing)))
    canvas.suptitle(no_formula(f"{scene.title or scene.name}: bodies of the liquids"), x=0.01, ha="left", fontsize=12,
                    wrap=True)
    right.set_title("sizes at the end", loc="left", fontsize=11)
    for axes in (left, right):
        axes.grid(alpha=0.3)
        axes.set_ylim(bottom=0)
        axes.yaxis.set_major_locator(MaxNLocator(integer=True))
        if axes.get_legend_handles_labels()[0]:
            axes.legend(frameon=False)
    with replacing(path) as partial:
        canvas.savefig(partial, dpi=120, format="png")


def main(arguments: list[str] | None = None) -> None:
    """Command line: ``python -m pipeline.bodies scene.json SURFACES_DIR... --output bodies.csv``."""
    parser = stage_parser("bodies", f"{__doc__}\ncolumns of the table:\n" + "\n".join(
        f"  {column}: {meaning}" for column, meaning in COLUMNS.items()))
    parser.add_argument("scene", type=Path, metavar="scene.json", help="resolved scene")
    parser.add_argument("folders", type=Path, nargs="+", metavar="SURFACES_DIR", help="folders of surfaces")
    parser.add_argument("--output", required=True, type=Path, metavar="FILE.csv", help="table to write")
    parser.add_argument("--plot", type=Path, metavar="FILE.png", help="counts over time, and sizes at the end")
    options = parser.parse_args(arguments)
    scene = load_resolved(options.scene)
    rows = measure(scene, options.folders)
    write_bodies(options.output, rows)
    if options.plot:
        write_plot(options.plot, rows, scene)


if __name__ == "__main__":
    run(main)
