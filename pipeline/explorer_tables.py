"""Make the tables of the explorer: shapes of least energy for all directions of gravity and fills.

    python -m pipeline.explorer_tables              # what is missing: half an hour of processor time a length
    python -m pipeline.explorer_tables --check 200  # how far they are off between their shapes

A direction that was finished is kept, so that the same command goes on where it was stopped.
"""
from collections.abc import Sequence
from pathlib import Path

from pipeline.base.cli import run, stage_parser
from pipeline.base.progress import progress
from pipeline.explorer.cases import TABLES, eyes, tamponades
from pipeline.explorer.chart import Chart
from pipeline.explorer.errors import check
from pipeline.explorer.shapes import Views
from pipeline.explorer.table import FOLDER, count, make, path_of


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
    missing: dict[str, list[str]] = {}
    for length, name in TABLES:
        if not path_of(length, name, options.output).is_file():
            missing.setdefault(length, []).append(name)
    with progress(count() * sum(map(len, missing.values())), "oil at rest", unit="shape") as bar:
        for length, names in missing.items():
            bar.set_postfix_str(f"{length} mm")
            views, kinds = Views(eyes()[length]), {name: tamponades()[name] for name in names}
            folders = {name: options.cache / f"{length}mm_{name}" for name in names}
            for name, table in make(views, Chart.of(views.wall), kinds, folders, bar.update).items():
                table.write(path_of(length, name, options.output))


if __name__ == "__main__":
    run(main)
