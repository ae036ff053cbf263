"""Stage: the smallest fill, the oil and the posture that cover a break of the retina, from shapes at rest.

    python -m pipeline.plan --break 6h,60deg --size 2h
    python -m pipeline.plan --break 10:30,95deg --size 1h,15deg --lens pseudophakic --postures upright,left_side
    python -m pipeline.plan --break 5h,80deg --mesh my_eye.stl --output plan.html
    python -m pipeline.plan --sequence day_of_postures
    python -m pipeline.plan --write-map              make the tables of the default eye anew

Clock hours are those that an observer sees who faces the patient (chart of Amsler and Dubois): 12 is superior, 3 is on
the patient's left. The angle is that from the posterior pole: macula 0, equator 90, ora serrata 115 degrees. A break is
covered when the oil at rest touches all of it and a margin around it. A plan for the default eye is read from tables;
for other eyes the shapes are computed, about 15 seconds for each oil and posture (the command says how long in
all before it begins), and kept in outputs/plans. Answers come oil by oil, the first posture first.

--sequence takes the postures of a scene over time, and tells what its oil covers at rest in each, without a simulation.

This is an illustration of physics, not for decisions on a patient.
"""
import argparse
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from pipeline.base.cli import CommandLine, run, stage_parser
from pipeline.base.errors import UserError
from pipeline.base.files import write_text
from pipeline.planning.confirm import BREAK, confirmation
from pipeline.planning.plan import plan_fill, question_of
from pipeline.planning.search import CACHE, write_map
from pipeline.planning.sequence import html_of as sequence_page
from pipeline.planning.sequence import sequence_of
from pipeline.planning.sequence import text_of as sequence_text
from pipeline.planning.settings import postures
from pipeline.scenes.checks import NAME
from pipeline.scenes.folders import scene_file, scene_paths
from pipeline.scenes.load import PROJECT_CONFIG
from pipeline.scenes.model import LENSES, MESH_UNITS, SIDES
from pipeline.scenes.yaml_files import read_yaml


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the stage; see ``--help``."""
    parser = _parser()
    options = parser.parse_args(arguments)
    given = {"margin": options.margin, "oils": _names(options.oil), "tension": options.tension,
             "contact_angle": options.contact_angle, "largest_fill": options.largest_fill}
    if options.write_map:
        count = write_map(question_of("12h,0deg", "1h", chosen=_names(options.postures), **given))
        print(f"{count} tables of the default eye")
        return
    if options.sequence is not None:
        if options.place is not None or options.confirm is not None:
            parser.error("--sequence asks about the breaks of its scene; leave out --break and --confirm")
        found = sequence_of(options.sequence)
        _write(options.output, lambda: sequence_text(found), lambda: sequence_page(found))
        return
    if options.place is None:
        parser.error("name a break with --break, such as --break 6h,60deg")
    if options.confirm is not None:
        _refuse_to_confirm_in(options.confirm)
    plan = plan_fill(options.place, options.size, postures=_names(options.postures), eye=_eye(options),
                     cache=options.cache, **given)
    if options.confirm is not None:
        write_text(options.confirm, plan.scene())  # unchanged it keeps its date, and what was made of it stays
    _write(options.output, plan.text, plan.page)
    if options.confirm is not None:
        print("\n".join(confirmation(options.confirm, plan.question, plan.answers[0])))


def _refuse_to_confirm_in(path: Path) -> None:
    """Raise where a file cannot be a confirming scene: it would not be found, or take the place of another scene."""
    scenes = PROJECT_CONFIG / "scenes"
    if path.parent.resolve() != scenes.resolve() or path.suffix != ".yaml" or not re.fullmatch(NAME, path.stem):
        raise UserError(f"--confirm is {path}, but must be a file in {scenes}, where scenes are looked for, with a "
                        'name of letters, digits, "_" and "-", such as my_plan.yaml')
    known = scene_paths(scenes).get(path.stem)
    if known and [one.get("name") for one in read_yaml(known).get("breaks") or ()] != [BREAK]:
        raise UserError(f"--confirm is {path}, which is a scene that confirms no plan; choose another name")


def _write(output: Path | None, text: Callable[[], str], page: Callable[[], str]) -> None:
    """Write words or, into a file that ends in .html, a page."""
    if output is None:
        sys.stdout.write(text())
    else:
        write_text(output, page() if output.suffix == ".html" else text())


def _parser() -> CommandLine:
    parser = stage_parser("plan", __doc__)
    parser.add_argument("--break", dest="place", metavar="HOUR,ANGLE",
                        help="middle of the break: clock hour and angle from the posterior pole, such as 6h,60deg")
    parser.add_argument("--size", default="1h", metavar="WIDTH,HEIGHT",
                        help="width in clock hours, height in degrees or mm, or both, such as 2h,15deg or 3mm "
                             "(default: 1h; 10 deg high)")
    parser.add_argument("--margin", default="0.5 mm", help="reach of the oil beyond the break (default: 0.5 mm)")
    parser.add_argument("--oil", metavar="OIL,...", help="oils to choose from (default: all of config/plan.yaml)")
    parser.add_argument("--postures", metavar="POSTURE,...", help=f"postures to choose from (default: all: "
                                                                  f"{', '.join(postures())})")
    parser.add_argument("--side", choices=SIDES, default="right", help="which eye, for the words nasal and temporal")
    parser.add_argument("--axial-length", default="24 mm", help="of the eye (default: 24 mm)")
    parser.add_argument("--lens", choices=LENSES, default="phakic", help="of the eye (default: phakic)")
    parser.add_argument("--mesh", type=Path, help="surface or labelled image of the cavity, in place of the model eye")
    parser.add_argument("--label", type=int, help="number of the vitreous cavity in a labelled image")
    parser.add_argument("--unit", choices=MESH_UNITS, default="mm", help="unit of length of the mesh (default: mm)")
    parser.add_argument("--tension", help="interface tension (default: config/plan.yaml)")
    parser.add_argument("--contact-angle", help="through the other liquid (default: config/plan.yaml)")
    parser.add_argument("--largest-fill", help="share of the cavity that can be filled (default: config/plan.yaml)")
    parser.add_argument("--output", type=Path, help="file to write: a page if it ends in .html, else text")
    parser.add_argument("--confirm", type=Path, metavar="SCENE",
                        help="also write a scene file of the answer with the smallest fill (--oil and --postures "
                             "choose another), such as config/scenes/my_plan.yaml, and tell how to simulate it, or, "
                             "once that is done, whether the simulation agrees")
    parser.add_argument("--sequence", type=scene_file, metavar="SCENE",
                        help="tell what the oil of a scene covers at rest in each of its postures over time")
    parser.add_argument("--cache", type=Path, default=CACHE, help=f"folder of tables made before (default: {CACHE})")
    parser.add_argument("--write-map", action="store_true", help="make the tables of the default eye anew")
    return parser


def _names(words: str | None) -> list[str] | None:
    """Names between commas."""
    return None if words is None else [word.strip() for word in words.split(",")]


def _eye(options: argparse.Namespace) -> dict[str, Any]:
    if options.mesh is None:
        return {"axial_length": options.axial_length, "lens": options.lens, "side": options.side}
    label = {} if options.label is None else {"label": options.label}
    return {"model": "mesh", "path": str(options.mesh), "unit": options.unit, "side": options.side, **label}


if __name__ == "__main__":
    run(main)
