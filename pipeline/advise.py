"""Stage: what to expect of a scene before it is run: numbers, time scales, limits of the time step, and advice.

The numbers are estimates of an order of magnitude: one length and one speed stand for the whole scene. Advice is no
error: the stage ends with exit code 0 for every scene that can be read, whatever is advised.
"""
import sys
from collections.abc import Sequence
from pathlib import Path

from pipeline.advice.report import html_of, json_of, report_of, text_of
from pipeline.base.cli import run, stage_parser
from pipeline.base.errors import UserError
from pipeline.base.files import write_text
from pipeline.cavity.initial_state import load_initial
from pipeline.cavity.surface import cavity_volume
from pipeline.scenes.effects import OFF
from pipeline.scenes.folders import scene_file
from pipeline.scenes.load import load_resolved, load_scene

FORMATS = {"text": text_of, "html": html_of, "json": json_of}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the stage; see ``--help``."""
    parser = stage_parser("advise", __doc__, epilog=f"{OFF}.")
    parser.add_argument("scene", type=scene_file, help="scene, by its name or file, or a resolved scene (.json)")
    parser.add_argument("--accuracy", help="accuracy level of a scene file (default: `accuracy` of config.yaml)")
    parser.add_argument("--config-dir", type=Path, help="folder of materials.yaml and accuracy.yaml (default: config)")
    parser.add_argument("--initial", type=Path, help="particles of the voxelize stage (initial.npz), for the volume of "
                                                     "the cavity; without it the volume is that of its surface")
    parser.add_argument("--format", choices=FORMATS, default="text", help="what to write (default: text)")
    parser.add_argument("--output", type=Path, help="file to write (default: standard output)")
    options = parser.parse_args(arguments)
    if options.scene.suffix != ".json":
        scene = load_scene(options.scene, options.accuracy, options.config_dir)
    elif options.accuracy is None:
        scene = load_resolved(options.scene)
    else:
        raise UserError(f'--accuracy is "{options.accuracy}", but {options.scene} is resolved already; name its scene '
                        "file, or leave --accuracy out")
    volume = float(load_initial(options.initial)["cavity_volume"]) if options.initial else cavity_volume(scene)
    report = report_of(scene, volume)
    text = html_of(report, options.output) if options.format == "html" else FORMATS[options.format](report)
    if options.output is None:
        sys.stdout.write(text)
    else:
        write_text(options.output, text)


if __name__ == "__main__":
    run(main)
