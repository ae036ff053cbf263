"""Shape of the injected oil without interface forces, with those of [song, fig. 7], and with a tension in N/m.

The paper shows two pictures. Here the difference has numbers, from the reconstructed surface of the oil: its sphericity
pi^(1/3) (6 V)^(2/3) / A (1 for a ball, less for oil that the eye flattens or that is torn), the area of its interface
with the aqueous (the part of A that is farther than half a particle spacing from the wall), and the number of bodies.
"""
import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from pipeline.pictures.eye_layout import legend_of, section_and_map
from pipeline.pictures.marks import OVERSAMPLING
from pipeline.pictures.picture_grid import evenly, sheet
from pipeline.runs.run_folder import RunFolder
from pipeline.scenes.model import Scene
from pipeline.studies.family import Family
from pipeline.studies.model import Curve, Figure, Outcome, Row
from sim.parameters import parameter

FIGURES = (
    Figure("oil_sphericity", "Sphericity of the oil", "time / s", "surface of a ball of this volume / surface"),
    Figure("oil_interface", "Area between oil and aqueous", "time / s", "interface / cross-section of the eye"),
)
WIDTH = 330  # pixels of a section, and of a map of the fundus
LEGEND = 70  # pixels, height of the legend
PICTURES = ("oil_shape_pictures",)


@dataclasses.dataclass(frozen=True)
class Parameters:
    """The scenes to compare: the same injection, with different forces at the interface."""

    scenes: tuple[str, ...] = parameter(meaning="names of the scenes: without forces first")
    liquids: tuple[str, ...] = parameter(meaning="name of the oil in each of the scenes")
    pictures: int = parameter(2, minimum=1, maximum=8, meaning="times at which the scenes are drawn side by side")


def scenes(parameters: Parameters) -> tuple[str, ...]:
    """Names of the scenes whose results are read."""
    return parameters.scenes


@dataclasses.dataclass(frozen=True)
class Oil:
    """The oil of one scene, frame by frame: time, s; sphericity; interface, m2; bodies."""

    scene: Scene
    pictures: list[Path]
    time: np.ndarray
    sphericity: np.ndarray
    interface: np.ndarray
    bodies: np.ndarray


def run(parameters: Parameters, folders: Mapping[str, RunFolder]) -> Outcome:
    """Measure the oil of every scene and compare its end with that of the first scene."""
    oils = [_load(folders[name], liquid) for name, liquid in zip(parameters.scenes, parameters.liquids, strict=True)]
    outcome = Outcome(pictures={PICTURES[0]: _side_by_side(oils, parameters.pictures)})
    section = np.pi / 4.0 * _diameter(folders[parameters.scenes[0]].cavity_volume) ** 2
    for oil in oils:
        at: dict[str, Any] = {"at": oil.scene.name}
        outcome.rows += [
            Row("sphericity of the oil at the end", oil.sphericity[-1], **at),
            Row("interface at the end / cross-section of the eye", oil.interface[-1] / section, **at),
            Row("bodies of oil at the end", float(oil.bodies[-1]), **at)]
        outcome.curves += [Curve("oil_sphericity", oil.scene.name, oil.time, oil.sphericity, "line"),
                           Curve("oil_interface", oil.scene.name, oil.time, oil.interface / section, "line")]
    for oil in oils[1:]:
        ratio = oil.interface[-1] / oils[0].interface[-1]
        outcome.rows.append(Row("interface at the end / without forces", ratio, at=oil.scene.name))
        outcome.remarks.append(
            f"{oil.scene.title}: at the end the oil has {100 * ratio:.0f} % of the interface that it has in "
            f"{oils[0].scene.name}, a sphericity of {oil.sphericity[-1]:.3f} ({oils[0].sphericity[-1]:.3f}), and "
            f"{oil.bodies[-1]} bodies ({oils[0].bodies[-1]}).")
    return outcome


def sphericity(volume: float, area: float) -> float:
    """Surface of a ball of a volume, m3, over an area, m2."""
    return float(np.pi ** (1.0 / 3.0) * (6.0 * volume) ** (2.0 / 3.0) / area)


def _diameter(volume: float) -> float:
    """Diameter of the ball of a volume, m3, in m."""
    return float((6.0 * volume / np.pi) ** (1.0 / 3.0))


def _load(run: RunFolder, liquid: str) -> Oil:
    rows = [(frame.read().time, *measured(frame.surface(liquid), run.scene.numerics.particle_spacing))
            for frame in run.frames]
    time, ratio, interface, bodies = (np.array(column) for column in zip(*rows, strict=True))
    return Oil(run.scene, [run.picture_of(frame) for frame in run.frames], time, ratio, interface, bodies)


def measured(surface, spacing: float) -> tuple[float, float, int]:
    """Sphericity, interface away from the wall, m2, and bodies of a closed surface with point data `depth`, m."""
    if surface.n_cells == 0:  # before the injection
        return np.nan, 0.0, 0
    sizes = surface.compute_cell_sizes(length=False, volume=False)
    area = sizes.cell_data["Area"]
    away = surface.point_data_to_cell_data().cell_data["depth"] > 0.5 * spacing
    bodies = int(surface.connectivity().point_data["RegionId"].max()) + 1
    return sphericity(surface.volume, float(area.sum())), float(area[away].sum()), bodies


def _side_by_side(oils: list[Oil], count: int) -> bytes:
    """Sections and maps of the fundus of all scenes at the same times, a row for every scene, as PNG; one legend.

    It is that of the last scene while oil streams in, and so names the cannula too.
    """
    shortest = min(oils, key=lambda oil: oil.time[-1]).time
    times = shortest[evenly(count, len(shortest))]
    rows = []
    for oil in oils:
        row, legends = [], []
        for index in np.abs(oil.time[:, None] - times).argmin(axis=0):  # scenes keep frames at intervals of their own
            with Image.open(oil.pictures[index]) as opened:
                picture = opened.convert("RGB")
            legends.append(legend_of(picture, OVERSAMPLING * LEGEND))
            section, fundus = section_and_map(picture, OVERSAMPLING * WIDTH)
            row += [(section, f"{oil.time[index]:.1f} s"), (fundus, "fundus")]
        rows.append((oil.scene.title, row))
    return sheet(rows, legends=legends[:1])


FAMILY = Family(__name__, Parameters, run, scenes=scenes, reads=("frames", "surfaces", "images"), figures=FIGURES,
                pictures=PICTURES)
