"""Stage: all of a run as one file that ParaView and PyVista open and play, with named parts at every time.

Beside it a script that lets ParaView show the run as the pictures do.
"""
from pathlib import Path

from pipeline.base.cli import run, stage_parser
from pipeline.base.errors import UserError
from pipeline.base.files import replacing_folder, write_text
from pipeline.base.frame_files import write_pvd
from pipeline.exchange.paraview_view import view_script
from pipeline.exchange.run_index import relative, write_parts
from pipeline.scenes.load import load_resolved
from pipeline.surfaces.saved_frame import frames_with_surfaces

SCRIPT = "view_run.py"


def main(arguments: list[str] | None = None) -> None:
    """Command line: ``python -m pipeline.index_run scene.json eye.vtp --frames ... --surfaces ... --output FILE``."""
    parser = stage_parser("index_run", __doc__)
    parser.add_argument("scene", type=Path, metavar="scene.json", help="resolved scene")
    parser.add_argument("wall", type=Path, metavar="eye.vtp", help="surface of the cavity")
    parser.add_argument("--frames", nargs="+", required=True, type=Path, metavar="FRAMES_DIR", help="folders of frames")
    parser.add_argument("--surfaces", nargs="+", required=True, type=Path, metavar="SURFACES_DIR",
                        help="folders of the reconstruct stage")
    parser.add_argument("--output", required=True, type=Path, metavar="FILE.pvd",
                        help=f"index to write; its parts are in a folder of that name, and {SCRIPT} is beside it")
    options = parser.parse_args(arguments)
    scene = load_resolved(options.scene)
    if not options.wall.is_file():
        raise UserError(f"{options.wall}: no such file; run the eye stage first")
    frames = frames_with_surfaces(options.frames, options.surfaces)
    folder, base = options.output.with_suffix(""), options.output.parent
    with replacing_folder(folder) as partial:
        write_parts(partial, folder, frames, scene, options.wall)
    write_text(base / SCRIPT, view_script(scene, base.resolve(), painted=frames[-1].wall is not None))
    write_pvd(options.output, [(one.time, relative(folder / f"{one.name}.vtm", base)) for one in frames])


if __name__ == "__main__":
    run(main)
