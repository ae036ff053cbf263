"""Make the tables of the explorer: shapes of least energy for all directions of gravity and fills.

    python -m pipeline.explorer_tables              # what is missing: 3 minutes of processor time for each
    python -m pipeline.explorer_tables --check 60   # how far they are off between their shapes

A direction that was finished is kept, so that the same command goes on where it was stopped.
"""
from collections.abc import Sequence
from pathlib import Path

from pipeline.base.cli import run, stage_parser
from pipeline.base.progress import progress
from pipeline.explorer.cases import FILLS, TABLES, eyes, tamponades
from pipeline.explorer.chart import Chart
from pipeline.explorer.errors import check
from pipeline.explorer.shapes import Views
from pipeline.explorer.table import FOLDER, directions, make, path_of


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the stage; see ``--help``."""
    parser = stage_parser("explorer_tables", __doc__)
    parser.add_argument("--output", type=Path, default=FOLDER, help=f"folder of the tables (default: {FOLDER})")
    parser.add_argument("--cache", type=Path, default=Path("outputs/explorer/directions"),
                        help="folder of directions made before (default: %(default)s)")
    parser.add_argument("--check", type=int, metavar="COUNT",
                        help="instead compute random settings again, and write how far the tables are off there")
    options = parser.parse_args(arguments)
    if options.check is not None:
        with progress(options.check, "random settings", unit="setting") as bar:
            check(options.check, options.output, bar.update)
        return
    missing = [case for case in TABLES if not path_of(*case, options.output).is_file()]
    with progress(len(missing) * len(list(directions())) * len(FILLS), "oil at rest", unit="shape") as bar:
        for length, name in missing:
            tamponade = tamponades()[name]
            bar.set_postfix_str(f"{length} mm, {tamponade.words}")
            views, cache = Views(eyes()[length]), options.cache / f"{length}mm_{name}"
            make(views, Chart.of(views.wall), tamponade, cache, bar.update).write(path_of(length, name, options.output))


if __name__ == "__main__":
    run(main)
