"""Stage: the surfaces of a run for other programs: a saved frame as glTF, STL or PLY, or all of them as USD.

    python -m pipeline.export outputs/tamponade/draft                               the last frame as one glTF file
    python -m pipeline.export outputs/tamponade/draft --frame 20 --format stl --unit mm
    python -m pipeline.export outputs/tamponade/draft --format usd                  the whole run as one USD file
"""
import argparse
from pathlib import Path

from pipeline.base.cli import run
from pipeline.base.errors import UserError
from pipeline.exchange.run_index import SavedFrame, saved_frames
from pipeline.scenes.ending import segments_made
from pipeline.scenes.load import scene_of_run
from pipeline.scenes.model import MESH_UNITS, Scene

OF_A_FRAME = ("glb", "ply", "stl")
OF_A_RUN = {"usd": "run.usdc", "usdz": "run.usdz"}


def frames_of(folder: Path) -> list[SavedFrame]:
    """Return the frames of a run that have surfaces, in the order of time.

    Raises
    ------
    UserError : there is none.
    """
    surfaces = sorted(folder.glob("surfaces/segment_*"))
    if not surfaces:
        raise UserError(f"{folder}/surfaces: no surfaces there; run the scene, or its reconstruct stage, first")
    return saved_frames([folder / "frames" / path.name for path in surfaces], surfaces)


def chosen_frame(frames: list[SavedFrame], number: int | None) -> SavedFrame:
    """Return a frame by its number, the last one without.

    Raises
    ------
    UserError : there is no such frame.
    """
    found = {int(one.name.rpartition("_")[2]): one for one in frames}
    if number is not None and number not in found:
        raise UserError(f"--frame is {number}, but must be one of {min(found)} to {max(found)}")
    return found[max(found) if number is None else number]


def what_is_missing(folder: Path, scene: Scene, frames: list[SavedFrame]) -> str:
    """Return how far a run is that has not ended; empty for one that has."""
    segments, made = segments_made(scene, folder), {frame.surfaces.name for frame in frames}
    ready = sum(f"segment_{name}" in made for name in segments)
    return "" if ready == len(segments) else (
        f"{folder}: unfinished, {ready} of {'at most ' * scene.output.until_rest}{len(segments)} segments have "
        f"surfaces; exported up to {frames[-1].time:g} s")


def main(arguments: list[str] | None = None) -> None:
    """Run the stage; see ``--help``."""
    parser = argparse.ArgumentParser(prog="python -m pipeline.export", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
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
    scene = scene_of_run(options.folder)
    if scene.dimension == 2:
        raise UserError(f"{options.folder}: the surfaces of a scene in two dimensions are lines, but these formats "
                        "hold triangles")
    if options.frame is not None and not single:
        raise UserError(f"--frame is {options.frame}, but --format {whole[0]} holds all frames; leave --frame out, or "
                        f"take a format of one frame: {', '.join(OF_A_FRAME)}")
    frames, output, wall = frames_of(options.folder), options.output or options.folder / "export", "eye.vtp"
    frame = chosen_frame(frames, options.frame)
    if single:
        from pipeline.exchange.mesh_formats import meshes_of, write_meshes

        meshes = meshes_of(frame, scene, options.folder / wall)
        for path in write_meshes(output, frame.name, meshes, scene, single, 1.0 / MESH_UNITS[options.unit]):
            print(path)
    if whole:
        from pipeline.exchange.usd_film import write_film

        for path in (output / OF_A_RUN[one] for one in whole):
            write_film(path, frames, scene, options.folder / wall)
            print(path)
        if missing := what_is_missing(options.folder, scene, frames):
            print(missing)


if __name__ == "__main__":
    run(main)
