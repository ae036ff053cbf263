"""Stage: the smallest fill, the oil and the posture that cover a break of the retina, from shapes at rest.

    python -m pipeline.plan --break 6h,60deg --size 2h
    python -m pipeline.plan --break 10:30,95deg --size 1h,15deg --lens pseudophakic --postures upright,left_side
    python -m pipeline.plan --break 5h,80deg --mesh my_eye.stl --output plan.html
    python -m pipeline.plan --write-map              make the tables of the default eye anew

Clock hours are those that an observer sees who faces the patient (chart of Amsler and Dubois): 12 is superior, 3 is on
the patient's left. The angle is that from the posterior pole: macula 0, equator 90, ora serrata 115 degrees. A break is
covered when the oil at rest touches all of it and a margin around it. A plan for the default eye is read from tables;
for other eyes the shapes are computed, some seconds for each oil and posture, and kept in outputs/plans.

This is an illustration of physics, not for decisions on a patient.
"""
import argparse
import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path

from pipeline.base.cli import run
from pipeline.base.errors import UserError
from pipeline.base.files import write_text
from pipeline.equilibrium.star_cavity import cavity_of, levels_of
from pipeline.planning.breaks import read_break
from pipeline.planning.chart import Charts
from pipeline.planning.confirm import confirming_scene
from pipeline.planning.report import html_of, text_of
from pipeline.planning.search import CACHE, Answer, Question, Tables, answers, write_map
from pipeline.planning.settings import Settings, load_settings, postures
from pipeline.scenes.load import load_scene
from pipeline.scenes.model import LENSES, MESH_UNITS, SIDES, Eye, Material
from pipeline.scenes.reader import Errors, Reader, nearest
from sim.parameters import parameter

MAPS = 4    # answers that the page draws


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the stage; see ``--help``."""
    parser = _parser()
    options = parser.parse_args(arguments)
    settings, materials = load_settings()
    if options.write_map:
        count = write_map(_question(options, settings, materials, "12h,0deg"))
        print(f"{count} tables of the default eye")
        return
    if options.place is None:
        parser.error("name a break with --break, such as --break 6h,60deg")
    question = _question(options, settings, materials, options.place)
    eye = _eye(options)
    _, bounds = levels_of(eye)
    found = answers(question, Tables(eye, options.cache), float(-bounds[0, 2]))
    if options.confirm is not None:
        write_text(options.confirm, confirming_scene(question, found[0], eye, settings.confirming_scene))
    text = text_of(question, found, eye)
    if options.output is None:
        sys.stdout.write(text)
    else:
        write_text(options.output, _page(question, found, eye) if options.output.suffix == ".html" else text)
    if options.confirm is not None:
        print(f"{options.confirm}: one simulation of this, to compare: snakemake -j2 "
              f"outputs/{options.confirm.stem}/draft/metrics.html")


def _page(question: Question, found: Sequence[Answer], eye: Eye) -> str:
    """Return the page, with maps of the best answers."""
    charts = Charts(cavity_of(eye), question.place, eye.side == "right")
    maps = [charts.png(question.liquids(question.oils[answer.oils[0]]), postures()[answer.posture],
                       min(answer.fill, question.largest_fill)) for answer in found[:MAPS]]
    return html_of(question, found, eye, maps)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m pipeline.plan", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--break", dest="place", metavar="HOUR,ANGLE",
                        help="middle of the break: clock hour and angle from the posterior pole, such as 6h,60deg")
    parser.add_argument("--size", default="1h", metavar="WIDTH,HEIGHT",
                        help="width in clock hours, height in degrees, or both, such as 2h,15deg (default: 1h; 10 deg "
                             "high)")
    parser.add_argument("--margin", default="0.5 mm", help="reach of the oil beyond the break (default: 0.5 mm)")
    parser.add_argument("--oil", metavar="OIL,...", help="oils to choose from (default: all of config/plan.yaml)")
    parser.add_argument("--postures", metavar="POSTURE,...", help=f"postures to choose from (default: all: "
                                                                  f"{', '.join(postures())})")
    parser.add_argument("--side", choices=SIDES, default="right", help="which eye, for the words nasal and temporal")
    parser.add_argument("--axial-length", default="24 mm", help="of the eye (default: 24 mm)")
    parser.add_argument("--lens", choices=LENSES, default="phakic", help="of the eye (default: phakic)")
    parser.add_argument("--eye", type=Path, metavar="SCENE", help="scene file whose eye is taken, with buckle, "
                                                                    "staphyloma, landmarks and all, such as "
                                                                    "config/scenes/tamponade.yaml")
    parser.add_argument("--mesh", type=Path, help="surface of the cavity instead of the model eye")
    parser.add_argument("--unit", choices=MESH_UNITS, default="mm", help="unit of length of the mesh (default: mm)")
    parser.add_argument("--tension", help="interface tension (default: config/plan.yaml)")
    parser.add_argument("--contact-angle", help="through the other liquid (default: config/plan.yaml)")
    parser.add_argument("--largest-fill", help="share of the cavity that can be filled (default: config/plan.yaml)")
    parser.add_argument("--output", type=Path, help="file to write: a page if it ends in .html, else text")
    parser.add_argument("--confirm", type=Path, metavar="SCENE",
                        help="also write a scene file of the best answer, such as config/scenes/my_plan.yaml")
    parser.add_argument("--cache", type=Path, default=CACHE, help=f"folder of tables made before (default: {CACHE})")
    parser.add_argument("--write-map", action="store_true", help="make the tables of the default eye anew")
    return parser


def _question(options: argparse.Namespace, settings: Settings, materials: dict[str, Material], place: str) -> Question:
    values = {"tension": options.tension, "contact_angle": options.contact_angle, "largest_fill": options.largest_fill}
    given = _record(Settings, {name: value for name, value in values.items() if value is not None}, settings)
    margin = _record(Margin, {"margin": options.margin}).margin
    oils = _chosen("--oil", options.oil, settings.oils)
    return Question(read_break(place, options.size), margin, {name: materials[name] for name in oils},
                    materials[settings.other_liquid], _chosen("--postures", options.postures, tuple(postures())),
                    given.tension, given.contact_angle, given.other_angles, given.largest_fill)


def _chosen(option: str, words: str | None, allowed: Sequence[str]) -> tuple[str, ...]:
    """Names between commas; all that are allowed where none is given."""
    if words is None:
        return tuple(allowed)
    names = tuple(dict.fromkeys(word.strip() for word in words.split(",")))
    for name in names:
        if name not in allowed:
            raise UserError(f'{option}: "{name}" is not known{nearest(name, allowed)}; known are {", ".join(allowed)}')
    return names


@dataclasses.dataclass(frozen=True)
class Margin:
    """How far the oil must reach beyond a break."""

    margin: float = parameter(unit="m", minimum=0.0, maximum=0.01, meaning="reach of the oil beyond the break")


def _eye(options: argparse.Namespace) -> Eye:
    if options.eye is not None:
        eye = load_scene(options.eye).eye
        if eye is None:
            raise UserError(f"--eye: the scene {options.eye} has a container, but a plan needs an eye")
        return eye
    if options.mesh is None:
        return _record(Eye, {"axial_length": options.axial_length, "lens": options.lens, "side": options.side})
    return _record(Eye, {"model": "mesh", "path": str(options.mesh), "unit": options.unit, "side": options.side})


def _record(kind: type, values: dict[str, object], base: object = None):
    """Read options as a scene's values are read."""
    errors = Errors("options")
    record = Reader(errors).record(kind, values, (), base)
    errors.raise_any()
    return record


if __name__ == "__main__":
    run(main)
