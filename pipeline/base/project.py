"""Where the files of the project are that are no Python: configuration, rules, texts of reports.

In a checkout they are beside the packages; a wheel carries a copy of them inside of this package.
"""
from pathlib import Path

PACKAGE = Path(__file__).parents[1]
SNAKEFILE = "Snakefile"
PROJECT = PACKAGE.parent if (PACKAGE.parent / SNAKEFILE).is_file() else PACKAGE / "project"
