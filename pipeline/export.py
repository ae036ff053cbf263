"""Stage: the surfaces of a saved frame as glTF, STL or PLY, for other programs.

    python -m pipeline.export outputs/tamponade/draft                               the last frame as one glTF file
    python -m pipeline.export outputs/tamponade/draft --frame 20 --format stl --unit mm
"""
import argparse
from pathlib import Path

from pipeline.base.cli import run
from pipeline.base.errors import UserError
from pipeline.exchange.run_index import SavedFrame, saved_frames
from pipeline.scenes.load import scene_of_run
from pipeline.scenes.model import MESH_UNITS

FORMATS = ("glb", "ply", "stl")


def chosen_frame(folder: Path, number: int | None) -> SavedFrame:
    """Return a frame of a run by its number, the last one without.

    Raises
    ------
    UserError : there is no such frame.
    """
    surfaces = sorted(folder.glob("surfaces/segment_*"))
    if not surfaces:
        raise UserError(f"{folder}/surfaces: no surfaces there; run the scene, or its reconstruct stage, first")
    found = {int(one.name.rpartition("_")[2]): one for one in saved_frames(
        [folder / "frames" / path.name for path in surfaces], surfaces)}
    if number is not None and number not in found:
        raise UserError(f"--frame is {number}, but must be one of {min(found)} to {max(found)}")
    return found[max(found) if number is None else number]


def main(arguments: list[str] | None = None) -> None:
    """Run the stage; see ``--help``."""
    parser = argparse.ArgumentParser(prog="python -m pipeline.export", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="results of a level: outputs/<scene>/<level>")
    parser.add_argument("--frame", type=int, metavar="N", help="number of the frame (default: the last)")
    parser.add_argument("--format", action="append", choices=FORMATS,
                        help="glb: one file with all surfaces in their colors (default); ply, stl: a file for each")
    parser.add_argument("--unit", choices=MESH_UNITS, default="m",
                        help="unit of length in PLY and STL, which name none (default: m); glTF is in m")
    parser.add_argument("--output", type=Path, metavar="DIR", help="folder to write to (default: FOLDER/export)")
    options = parser.parse_args(arguments)
    scene = scene_of_run(options.folder)
    if scene.dimension == 2:
        raise UserError(f"{options.folder}: the surfaces of a scene in two dimensions are lines, but these formats "
                        "hold triangles")
    frame = chosen_frame(options.folder, options.frame)

    from pipeline.exchange.mesh_formats import meshes_of, write_meshes

    meshes = meshes_of(frame, scene, options.folder / "eye.vtp")
    for path in write_meshes(options.output or options.folder / "export", frame.name, meshes, scene,
                             options.format or ["glb"], 1.0 / MESH_UNITS[options.unit]):
        print(path)


if __name__ == "__main__":
    run(main)
