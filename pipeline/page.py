"""Stage: after a run, one page of it: numbers, movie, pictures, surfaces that turn, curves, what was simulated and how.

    python -m pipeline.page outputs/tamponade/draft --output outputs/tamponade/draft/index.html

The page holds all that it shows, in 10 MB at most, and asks no network for anything. Links lead to the pages beside it.
"""
from collections.abc import Sequence
from pathlib import Path

from pipeline.advice.report import report_of
from pipeline.base import cli
from pipeline.base.errors import UserError
from pipeline.base.files import write_text
from pipeline.base.sequences import PICTURES_AGAIN
from pipeline.forecast.scene_errors import errors_of
from pipeline.measures.shown import shown_metrics
from pipeline.pages.run_page import page_of
from pipeline.runs.run_folder import RunFolder
from pipeline.runs.segments import check_segments
from pipeline.scenes.folders import scene_file
from pipeline.scenes.yaml_files import scene_files


def refuse_incomplete(run: RunFolder) -> None:
    """Raise a UserError for a run without what the page shows as it is; one that goes on has no still yet."""
    check_segments(run.scene, run.pictures, PICTURES_AGAIN)
    if not run.pictures:
        raise UserError(f"{run.folder / 'images'}: no pictures (segment_*/frame_*.png); run the render stage first")
    whole = len(run.pictures) >= run.frame_count
    shown = {"movie.mp4": "movie"} | ({"still.png": "still"} if run.scene.dimension == 3 and whole else {})
    for name, stage in shown.items():
        if not (run.folder / name).is_file():
            raise UserError(f"{run.folder / name}: no such file; run the {stage} stage first")


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the stage; see ``--help``."""
    p = cli.stage_parser("page", __doc__)
    p.add_argument("folder", type=Path, metavar="FOLDER", help="results of a run: outputs/<scene>/<level>")
    p.add_argument("--source", type=Path, metavar="SCENE.yaml",
                   help="file of the scene (default: that of its name)")
    p.add_argument("--output", type=Path, metavar="index.html", help="page to write (default: index.html in FOLDER)")
    options = p.parse_args(arguments)
    run = RunFolder(options.folder)
    refuse_incomplete(run)
    source = options.source or scene_file(run.scene.name)
    if not source.is_file():
        raise UserError(f"{source}: no such file; name the file of the scene with --source")
    sources, output = scene_files(source), options.output or options.folder / "index.html"
    text = page_of(run, shown=shown_metrics(run.table, run.metrics), advice=report_of(run.scene, run.cavity_volume),
                   errors=errors_of(run.scene, run.cavity_volume), sources=sources, path=output)
    write_text(output, text)
    print(f"{output}: {len(text.encode()) / 1e6:.1f} MB")


if __name__ == "__main__":
    cli.run(main)
