"""Stage: the surfaces of a run for other programs: a saved frame as glTF, STL or PLY, or all of them as USD.

    python -m pipeline.export outputs/tamponade/draft                               the last frame as one glTF file
    python -m pipeline.export outputs/tamponade/draft --frame 20 --format stl --unit mm
    python -m pipeline.export outputs/tamponade/draft --format usd                  the whole run as one USD file
"""
from pathlib import Path

from pipeline.base import cli
from pipeline.base.errors import UserError
from pipeline.runs.run_folder import RunFolder
from pipeline.scenes.model import MESH_UNITS
from pipeline.surfaces.saved_frame import SavedFrame

OF_A_FRAME = ("glb", "ply", "stl")
OF_A_RUN = {"usd": "run.usdc", "usdz": "run.usdz"}


def ready_frames(run: RunFolder) -> list[SavedFrame]:
    """Return the frames of a run that have surfaces, in the order of time.

    Raises
    ------
    UserError : there is none.
    """
    frames = run.ready_frames
    if not frames:
        raise UserError(f"{run.folder}/surfaces: no surfaces there; run the scene, or its reconstruct stage, first")
    return frames


def chosen_frame(frames: list[SavedFrame], number: int | None) -> SavedFrame:
    """Return a frame by its number, the last one without.

    Raises
    ------
    UserError : there is no such frame.
    """
    found = {one.number: one for one in frames}
    if number is not None and number not in found:
        raise UserError(f"--frame is {number}, but must be one of {min(found)} to {max(found)}")
    return found[max(found) if number is None else number]


def what_is_missing(run: RunFolder, frames: list[SavedFrame]) -> str:
    """Return how far a run is that has not ended; empty for one that has."""
    count, ready = len(run.segments), len({frame.surfaces for frame in frames})
    return "" if ready == count else (
        f"{run.folder}: unfinished, {ready} of {'at most ' * run.scene.output.until_rest}{count} segments have "
        f"surfaces; exported up to {frames[-1].time:g} s")


def main(arguments: list[str] | None = None) -> None:
    """Run the stage; see ``--help``."""
    parser = cli.stage_parser("export", __doc__)
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="results of a level: outputs/<scene>/<level>")
    parser.add_argument("--frame", type=int, metavar="N",
                        help="number of the frame (default: the last); usd and usdz hold all frames")
    parser.add_argument("--format", action="append", choices=(*OF_A_FRAME, *OF_A_RUN),
                        help="glb: one file with all surfaces in their colors (default); ply, stl: a file for each; "
                             "usd: one file of the whole run over time, for Blender, Houdini and Omniverse; usdz: the "
                             "same for Quick Look")
    parser.add_argument("--unit", choices=MESH_UNITS, default="m",
                        help="unit of length in PLY and STL, which name none (default: m); glTF and USD are in m")
    parser.add_argument("--output", type=Path, metavar="DIR", help="folder to write to (default: FOLDER/export)")
    options = parser.parse_args(arguments)
    formats = options.format or ["glb"]
    single, whole = ([one for one in formats if one in kind] for kind in (OF_A_FRAME, OF_A_RUN))
    run = RunFolder(options.folder)
    scene = run.scene
    if scene.dimension == 2:
        raise UserError(f"{options.folder}: the surfaces of a scene in two dimensions are lines, but these formats "
                        "hold triangles")
    if options.frame is not None and not single:
        raise UserError(f"--frame is {options.frame}, but --format {whole[0]} holds all frames; leave --frame out, or "
                        f"take a format of one frame: {', '.join(OF_A_FRAME)}")
    frames, output, wall = ready_frames(run), options.output or run.folder / "export", run.wall
    frame = chosen_frame(frames, options.frame)
    if single:
        from pipeline.exchange.mesh_formats import meshes_of, write_meshes

        meshes = meshes_of(frame, scene, wall)
        for path in write_meshes(output, frame.name, meshes, scene, single, 1.0 / MESH_UNITS[options.unit]):
            print(path)
    if whole:
        from pipeline.exchange.usd_film import write_film

        for path in (output / OF_A_RUN[one] for one in whole):
            write_film(path, frames, scene, wall)
            print(path)
        if missing := what_is_missing(run, frames):
            print(missing)


if __name__ == "__main__":
    cli.run(main)
