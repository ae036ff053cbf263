"""Make the explorer: one page in which a surgeon moves fill, posture and oil, and sees at once what the oil touches.

    python -m pipeline.explorer_page --output outputs/explorer.html

The page holds the tables of ``config/oil_at_rest/explorer`` and asks no network for anything.
"""
from collections.abc import Sequence
from pathlib import Path

from pipeline.base.cli import run, stage_parser
from pipeline.base.files import write_text
from pipeline.explorer.page import page_of
from pipeline.explorer.table import FOLDER


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the stage; see ``--help``."""
    parser = stage_parser("explorer_page", __doc__)
    parser.add_argument("--tables", type=Path, default=FOLDER, help=f"folder of the tables (default: {FOLDER})")
    parser.add_argument("--output", type=Path, default=Path("outputs/explorer.html"),
                        help="page to write (default: %(default)s)")
    options = parser.parse_args(arguments)
    text = page_of(options.tables)
    write_text(options.output, text)
    print(f"{options.output}: {len(text.encode()) / 1e6:.1f} MB")


if __name__ == "__main__":
    run(main)
