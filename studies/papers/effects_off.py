"""What every effect of a scene costs and what it changes: the scene beside the same scene with that effect off.

The cost is that of the table of effects (`pipeline.effect_costs`): computing time of all cores without compilation. An
effect costs more than its own row, or less: it makes other parts work, shortens the time step, or spares the pressure
solve iterations. So the time that switching it off saves is measured too. What it changes is measured at the end: the
share of the oil that is elsewhere (where the nearest particle of the other scene holds less oil), the oil's center,
coverage, interface and speed. Beside it stands what `pipeline.advise` said before any run.
"""
import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from scipy.spatial import cKDTree

from pipeline.advice.report import report_of
from pipeline.advice.rules import SEEN_EFFECT
from pipeline.base.frame_files import FrameData
from pipeline.pictures.eye_layout import legend_of, section_and_map
from pipeline.pictures.marks import OVERSAMPLING
from pipeline.pictures.picture_grid import sheet
from pipeline.runs.run_folder import RunFolder
from pipeline.scenes.model import Scene
from pipeline.studies.family import Family
from pipeline.studies.model import Curve, Figure, Outcome, Row
from sim.parameters import parameter
from studies.papers.oil_shape import measured

FIGURES = (
    Figure("effects_coverage", "Wall under the oil, with every effect off in turn", "time / s", "covered wall / %"),
    Figure("effects_center", "Center of the oil, with every effect off in turn", "time / s",
           "height of the center (superior) / mm"),
)
WIDTH, ACROSS = 330, 2  # pixels of a section, and of a map of the fundus; scenes side by side
LEGEND = 52  # pixels, height of a legend
PICTURES = ("effects_pictures",)
OFF = "_without_"  # in the name of a scene, between the scene that it extends and the effect that it lacks
METRICS = {"wall coverage": ("wall_coverage", "%"), "fill": ("fill", "%"), "rms speed": ("speed_rms", "mm/s")}


@dataclasses.dataclass(frozen=True)
class Parameters:
    """The scenes: each with all its effects, and once for every effect that is switched off."""

    scenes: tuple[str, ...] = parameter(meaning="names of the scenes with all effects")
    off: tuple[str, ...] = parameter(meaning="names of the scenes without one: <scene>_without_<effect>")
    liquid: str = parameter(meaning="name of the oil")


def scenes(parameters: Parameters) -> tuple[str, ...]:
    """Names of the scenes whose results are read."""
    return parameters.scenes + parameters.off


@dataclasses.dataclass(frozen=True)
class Result:
    """What one scene came to; `numbers` at the end: name -> (value, unit); `costs`: rows of its table of effects.

    ``cavity_volume`` is in m^3 (in two dimensions m^2).
    """

    scene: Scene
    cavity_volume: float
    frame: FrameData
    picture: Path
    table: dict[str, np.ndarray]
    costs: dict[str, dict[str, str]]
    numbers: dict[str, tuple[float, str]]

    @property
    def seconds(self) -> float:
        """Computing time of all cores, without compilation, s."""
        return sum(float(row["cpu_seconds"]) for row in self.costs.values())

    @property
    def launches(self) -> float:
        """Launches of kernels per time step."""
        return sum(float(row["launches_per_step"]) for row in self.costs.values())


def run(parameters: Parameters, folders: Mapping[str, RunFolder]) -> Outcome:
    """Compare every scene that lacks an effect with the one that has all."""
    runs = {name: _load(folders[name], parameters.liquid) for name in scenes(parameters)}
    outcome, order = Outcome(), []
    for base in parameters.scenes:
        outcome.rows += _rows_of_base(runs[base])
        order.append((runs[base], ""))
        for name in [name for name in parameters.off if name.partition(OFF)[0] == base]:
            rows, remark, caption = compared(runs[base], runs[name], name.partition(OFF)[2], parameters.liquid)
            outcome.rows += rows
            outcome.remarks.append(remark)
            order.append((runs[name], caption))
        family = [one for one, _ in order if one.scene.name.partition(OFF)[0] == base]
        outcome.curves += [curve for one in family for curve in _curves(one, parameters.liquid)]
    outcome.pictures = {PICTURES[0]: _side_by_side(order)}
    return outcome


def elsewhere(one: FrameData, other: FrameData, oil: int) -> float:
    """Share of the oil of one frame where the nearest particle of the other frame holds less of it."""
    nearest = cKDTree(other.position).query(one.position)[1]
    here, there = one.volume_fraction[:, oil].astype(float), other.volume_fraction[nearest, oil].astype(float)
    return float(one.volume @ np.maximum(here - there, 0.0) / (one.volume @ here))


def judgment(scene: Scene, cavity_volume: float, effect: str) -> tuple[bool, str]:
    """Whether the advisor says that an effect matters, and its first sentence on it."""
    found = [one for one in report_of(scene, cavity_volume).advice if one.effect == effect]
    return any(one.level == SEEN_EFFECT for one in found), found[0].sentence if found else "no advice"


def compared(base: Result, off: Result, effect: str, liquid: str) -> tuple[list[Row], str, str]:
    """Rows, a remark and a caption: what an effect costs and changes."""
    own = base.costs[effect]
    at: dict[str, Any] = {"at": off.scene.name}
    saved = 1.0 - off.seconds / base.seconds
    moved = elsewhere(base.frame, off.frame, base.frame.liquids.index(liquid))
    matters, sentence = judgment(base.scene, base.cavity_volume, effect)
    rows = [Row("the advisor says that it matters (1 or 0)", float(matters), **at),
            Row("its own share of the computing time", float(own["cpu_share"]), **at),
            Row("memory of its own", float(own["bytes"]) / 2**20, "MiB", **at),
            Row("kernels of its own", float(own["kernels"]), **at),
            Row("computing time of all cores", off.seconds, "s", reference=base.seconds, **at),
            Row("computing time saved without it / all", saved, **at),
            Row("time steps", float(off.frame.step), reference=float(base.frame.step), **at),
            Row("kernel launches per step", off.launches, reference=base.launches, **at),
            Row("oil that is elsewhere at the end / oil", moved, **at)]
    for name, (value, unit) in off.numbers.items():
        reference = base.numbers[name][0]
        if math.isfinite(value):
            rows.append(Row(name, value, unit, reference=reference, error=abs(value - reference), **at))
    share, memory = float(own["cpu_share"]), float(own["bytes"]) / 2**20
    remark = (f"{off.scene.title} ({base.scene.name}): {100 * abs(saved):.0f} % {'less' if saved > 0.0 else 'more'} "
              f"computing time, {100 * moved:.1f} % of the oil is elsewhere at the end. Its own part takes "
              f"{100 * share:.1f} % of the time and {memory:.2f} MiB. Advice before the run: "
              f"{'it matters; ' if matters else ''}{sentence}.")
    return rows, remark, f"time {-100 * saved:+.0f} %, oil elsewhere {100 * moved:.0f} %"


def _rows_of_base(base: Result) -> list[Row]:
    at: dict[str, Any] = {"at": base.scene.name}
    return [Row("computing time of all cores", base.seconds, "s", **at),
            Row("time steps", float(base.frame.step), **at),
            *(Row(f"share of the computing time: {part}", float(row["cpu_share"]), **at)
              for part, row in base.costs.items()),
            *(Row(name, value, unit, **at) for name, (value, unit) in base.numbers.items())]


def _curves(one: Result, liquid: str) -> list[Curve]:
    time, label = one.table["time [s]"], one.scene.title
    return [Curve("effects_coverage", label, time, one.table["wall_coverage [%]"], "line"),
            Curve("effects_center", label, time, one.table[f"center_of_mass_{liquid}_y [mm]"], "line")]


def _load(run: RunFolder, liquid: str) -> Result:
    table, last = run.table, run.frames[-1]
    numbers = {label: (float(table[f"{column} [{unit}]"][-1]), unit) for label, (column, unit) in METRICS.items()}
    numbers |= {f"center of the oil, {axis}": (float(table[f"center_of_mass_{liquid}_{axis} [mm]"][-1]), "mm")
                for axis in "yz"}
    area = measured(last.surface(liquid), run.scene.numerics.particle_spacing)[1]
    numbers["interface away from the wall"] = (1e6 * area, "mm2")
    return Result(run.scene, run.cavity_volume, last.read(), run.picture_of(last), table, run.effect_costs, numbers)


def _side_by_side(order: list[tuple[Result, str]]) -> bytes:
    """Sections and maps of the fundus of all scenes at their ends, as PNG; the legends of those with all effects."""
    rows, legends = [], []
    for one, caption in order:
        with Image.open(one.picture) as opened:
            picture = opened.convert("RGB")
        drawn = section_and_map(picture, OVERSAMPLING * WIDTH)
        if not caption:
            legends.append(legend_of(picture, OVERSAMPLING * LEGEND))
        rows.append((f"{one.scene.title}: {caption or f'{one.seconds:.0f} s of computing time'}",
                     [(panel, "") for panel in drawn]))
    return sheet(rows, ACROSS, legends)


FAMILY = Family(__name__, Parameters, run, scenes=scenes, reads=("frames", "surfaces", "images", "effects.csv"),
                figures=FIGURES, pictures=PICTURES)
