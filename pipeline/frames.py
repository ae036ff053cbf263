"""The one place that reads and writes frames, their time index and checkpoints.

A frame is a VTK unstructured grid of vertices (``.vtu``), because ParaView, pyvista and meshio all open it; meshio
reads no ``.vtp`` and no LZ4, so the arrays are stored raw, and with Python 3.13.5, whose base64 no longer ends at a
padding, no raw ones either. Every array carries its unit (VTK's ``UNITS_LABEL``) and the parts of ``volume_fraction``
and ``fill`` carry the liquid's name, those of vectors X, Y and Z. Text is stored as UTF-8 bytes, to be read with
``bytes(mesh.field_data["liquids"]).decode()``: meshio has no string arrays.
"""
import os
from pathlib import Path

from pipeline.base.cli import run, stage_parser
from pipeline.base.frame_files import FIELD_UNITS, FrameData, frames_of, read_frame, write_pvd


def main(arguments: list[str] | None = None) -> None:
    """Command line: ``python -m pipeline.frames pvd FRAMES_DIR... --output frames.pvd``."""
    parser = stage_parser("frames", "Index or inspect saved frames.")
    commands = parser.add_subparsers(dest="command", required=True)
    pvd = commands.add_parser("pvd", help="write the .pvd time index that ParaView and pyvista open")
    pvd.add_argument("folders", nargs="+", type=Path, metavar="FRAMES_DIR", help="folders of frames, one per segment")
    pvd.add_argument("--output", required=True, type=Path, metavar="FILE.pvd", help="the index to write")
    show = commands.add_parser("show", help="print what a frame holds")
    show.add_argument("frame", type=Path, metavar="FRAME.vtu", help="file of the frame")
    options = parser.parse_args(arguments)
    if options.command == "show":
        _show(read_frame(options.frame))
        return
    paths = frames_of(options.folders)
    base = options.output.resolve().parent
    entries = sorted((read_frame(path).time, os.path.relpath(path.resolve(), base)) for path in paths)
    write_pvd(options.output, entries)


def _show(frame: FrameData) -> None:
    print(f"scene {frame.scene}, time {frame.time:g} s, step {frame.step}, {len(frame.position)} particles, "
          f"spacing {frame.particle_spacing * 1e3:g} mm, gravity {frame.gravity.tolist()} m/s2")
    for liquid, volume in zip(frame.liquids, frame.fill, strict=True):
        print(f"  {liquid}: {volume * 1e6:.4f} mL, {100 * volume / frame.fill.sum():.2f} %")
    for name, value in frame.statistics.items():
        print(f"  {name}: {value:g} {FIELD_UNITS.get(name, '')}".rstrip())


if __name__ == "__main__":
    run(main)
