"""All that is said about a scene before it is run, as text, page or JSON."""
import dataclasses
import json
import math
from pathlib import Path

from pipeline.advice.dimensionless_numbers import dimensionless_numbers, scales_of, time_scales
from pipeline.advice.rules import advice
from pipeline.advice.time_step_limits import deciding_limit, step_count, time_step_limits
from pipeline.base import page
from pipeline.scenes.effects import OFF
from pipeline.scenes.model import Scene
from pipeline.scenes.timeline import timeline_in_words
from sim.advice import NOTE, SEEN_EFFECT, WARNING, Advice, Limit, Quantity, shown
from sim.scales import Scales

HEADINGS = {WARNING: "Warnings", SEEN_EFFECT: "What matters", NOTE: "Notes"}
DISCLAIMER = ("Estimates of an order of magnitude: one length L and one speed U stand for the whole scene, and U is "
              "the largest that the scene can give its liquids.")


@dataclasses.dataclass(frozen=True)
class Report:
    """All that is said about a scene; numbers in SI.

    Attributes
    ----------
    timeline : what is done to the eye, and when; what the scene inherits too.
    """

    scene: str
    title: str
    accuracy: str
    timeline: str
    size: tuple[Quantity, ...]
    speeds: tuple[Quantity, ...]
    numbers: tuple[Quantity, ...]
    times: tuple[Quantity, ...]
    time_step_limits: tuple[Limit, ...]
    time_step: float
    steps: int
    advice: tuple[Advice, ...]

    @property
    def cost(self) -> str:
        """What decides the time step, and the number of steps."""
        source = deciding_limit(list(self.time_step_limits)).source
        return f"{shown(self.time_step, 's')} decided by {source}: about {self.steps} steps"


def report_of(scene: Scene, cavity_volume: float) -> Report:
    """Return what is said about a scene with a cavity of that volume in m^3 (in two dimensions m^2)."""
    scales = scales_of(scene, cavity_volume)
    limits = time_step_limits(scales)
    decides = deciding_limit(limits).value
    return Report(
        scene=scene.name, title=scene.title or scene.name, accuracy=scene.accuracy,
        timeline=timeline_in_words(scene, lambda _: cavity_volume), size=_sizes(scales),
        speeds=_speeds(scales), numbers=tuple(dimensionless_numbers(scales)), times=tuple(time_scales(scales)),
        time_step_limits=tuple(limits), time_step=decides, steps=step_count(scene, decides),
        advice=tuple(advice(scene, scales, limits)))


def _sizes(scales: Scales) -> tuple[Quantity, ...]:
    dimension = scales.settings.dimension
    what = "the scarcest liquid" if scales.start.blocks else "the cavity"
    ball = "disc" if dimension == 2 else "ball"
    filled = scales.filled_volume
    volume = f"{1e6 * filled:.3g} mL" if dimension == 3 and filled < 1e-3 else f"{filled:.3g} m{dimension}"
    count = round(filled / scales.spacing**dimension)
    return (Quantity("length L", scales.length, "m", f"radius of the {ball} with the volume of {what}"),
            Quantity("spacing dx", scales.spacing, "m", f"between particles: about {count} in {volume} of liquid"))


def _speeds(scales: Scales) -> tuple[Quantity, ...]:
    fastest = max(scales.speeds, key=lambda quantity: quantity.value, default=None)
    meaning = f"the largest of the following: {fastest.name}" if fastest else "nothing sets the liquids in motion"
    return (Quantity("speed U", scales.speed, "m/s", meaning), *scales.speeds, *scales.wall_speeds)


def _sections(report: Report) -> list[tuple[str, list[tuple[str, str, str]]]]:
    """Headings with their rows: name, number, meaning."""
    tables = (("Size", report.size), ("Speeds", report.speeds), ("Dimensionless numbers", report.numbers),
              ("Time scales", report.times))
    sections = [(heading, [(one.name, shown(one.value, one.unit), one.meaning) for one in quantities])
                for heading, quantities in tables]
    sections.append(("Limits of the time step", [
        (limit.source, shown(limit.value, "s"), limit.meaning) for limit in report.time_step_limits]))
    return [(heading, rows) for heading, rows in sections if rows]


def text_of(report: Report) -> str:
    """Return the report as lines of text."""
    lines = [f"{report.scene} ({report.accuracy}). {DISCLAIMER}"]
    lines += [f"Timeline: {report.timeline}."] * bool(report.timeline)
    sections = _sections(report)
    widths = [max(len(row[column]) for _, rows in sections for row in rows) for column in (0, 1)]
    for heading, rows in sections:
        lines += [heading, *(f"  {row[0]:{widths[0]}}  {row[1]:>{widths[1]}}  {row[2]}" for row in rows)]
    lines.append(f"  time step {report.cost}")
    for level, heading in HEADINGS.items():
        chosen = [one for one in report.advice if one.level == level]
        lines += [heading] * bool(chosen) + [f"  {one.effect}: {one.sentence}." for one in chosen]
    return "\n".join([*lines, f"{OFF}."]) + "\n"


def html_of(report: Report, path: Path | None = None) -> str:
    """Return the report as a page, to be written to a file."""
    return page.page(f"{report.title}: advice", [page.filled(
        __file__, report=report, disclaimer=DISCLAIMER, sections=_sections(report), off=OFF,
        advice={heading: [one for one in report.advice if one.level == level] for level, heading in HEADINGS.items()})],
        path=path)


def json_of(report: Report) -> str:
    """Return the report as JSON; an infinite number, such as a limit that there is not, is null."""
    def finite(value):
        if isinstance(value, dict):
            return {name: finite(one) for name, one in value.items()}
        if isinstance(value, list | tuple):
            return [finite(one) for one in value]
        return None if isinstance(value, float) and not math.isfinite(value) else value
    return json.dumps(finite(dataclasses.asdict(report)), indent=2, ensure_ascii=False) + "\n"
