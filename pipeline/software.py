"""Stage: name, version and license of all packages that are installed, and of libraries in pages, as a page or a table.

    python -m pipeline.software --output outputs/software.html --output outputs/software.csv
"""
import platform
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from pipeline.base import page
from pipeline.base.cli import run, stage_parser
from pipeline.base.files import write_text
from pipeline.base.packages import Package, packages
from pipeline.base.tables import csv_of
from pipeline.web.scripts import LIBRARIES

HEADS = ("name", "version", "license")


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the stage; see ``--help``."""
    parser = stage_parser("software", __doc__)
    parser.add_argument("--output", type=Path, action="append", default=[],
                        help="file to write: a page if it ends in .html, else a table; several are allowed (default: a "
                             "table on standard output)")
    options = parser.parse_args(arguments)
    found = [*packages(), *LIBRARIES]
    if not options.output:
        sys.stdout.write(table_of(found))
    for path in options.output:
        write_text(path, page_of(found) if path.suffix == ".html" else table_of(found))


def table_of(found: Sequence[Package]) -> str:
    """Return the packages as CSV."""
    return csv_of(HEADS, [(one.name, one.version, one.license) for one in found])


def page_of(found: Sequence[Package]) -> str:
    """Return the packages as a page."""
    return page.page("Software", [page.filled(
        __file__, python=platform.python_version(), system=platform.platform(), heads=HEADS,
        libraries=" and ".join(one.name for one in LIBRARIES),
        packages=[(one.name, one.version, one.license) for one in found],
        licenses=Counter(one.license for one in found).most_common())])


if __name__ == "__main__":
    run(main)
