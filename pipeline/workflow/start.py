"""Snakemake itself, with its arguments, but that Ctrl-C and wrong options end it in one sentence.

    python -m pipeline.workflow.start -j2 all

`pipeline` has set what becomes of errors that nobody catches before Snakemake is imported, which takes a second or two.
"""
import argparse
import sys
from typing import NoReturn

from pipeline.base.cli import mistake

NAME = "snakemake"


def main() -> None:
    """Command line of Snakemake."""
    from snakemake.cli import main as snakemake

    argparse.ArgumentParser.error = _refuse  # type: ignore[assignment, method-assign]  # the parser is Snakemake's own
    sys.argv[0] = NAME
    snakemake()


def _refuse(parser: argparse.ArgumentParser, message: str) -> NoReturn:
    from pipeline.workflow.scenes import stop

    stop(mistake(NAME, parser, message))


if __name__ == "__main__":
    main()
