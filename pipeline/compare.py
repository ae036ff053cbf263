"""Stage: two or more accuracy levels of one scene side by side: what accuracy costs, and what it changes.

    python -m pipeline.compare outputs/tamponade/draft outputs/tamponade/standard

writes outputs/tamponade/compare_draft_standard.html (one page), .png (the last picture that all have, and curves over
time) and .csv (cost, and every metric that all have). All levels must have been run and drawn. What the oil covers
stands beside the shape of least energy, where the scene has one.
"""
from collections.abc import Sequence
from pathlib import Path

from pipeline.base import cli
from pipeline.base.files import replacing, write_text
from pipeline.base.tables import csv_of
from pipeline.comparison.comparison_page import page_of, rows_of
from pipeline.comparison.levels import changes, check, common_frames, in_short
from pipeline.comparison.picture import picture_of
from pipeline.runs.run_folder import RunFolder


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the stage; see ``--help``."""
    p = cli.stage_parser("compare", __doc__)
    p.add_argument("folders", nargs="+", type=Path, metavar="FOLDER",
                   help="results of a level, outputs/<scene>/<level>; two or more")
    p.add_argument("--output", type=Path, metavar="NAME",
                   help="files to write, without .html, .png and .csv (default: compare_<level>_<level> beside FOLDER)")
    options = p.parse_args(arguments)
    runs = [RunFolder(folder) for folder in options.folders]
    check(runs)
    rows = common_frames(runs)
    found = changes(runs, rows)
    picture = picture_of(runs, rows, found)
    target = options.output or options.folders[0].parent / "_".join(["compare", *(run.level for run in runs)])
    with replacing(target.with_name(f"{target.name}.png")) as partial:
        partial.write_bytes(picture)
    write_text(target.with_name(f"{target.name}.csv"), csv_of(*rows_of(runs, found)))
    write_text(target.with_name(f"{target.name}.html"), page_of(runs, rows, found, target.parent))
    print(f"{runs[0].scene.name}: {in_short(runs, found)}")


if __name__ == "__main__":
    cli.run(main)
