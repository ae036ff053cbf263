"""Snakemake itself, with its arguments, but that Ctrl-C ends it in one sentence from its first moment on.

    python -m pipeline.workflow.start -j2 all

`pipeline` has set what becomes of errors that nobody catches before Snakemake is imported, which takes a second or two.
"""
import sys


def main() -> None:
    """Command line of Snakemake."""
    from snakemake.cli import main as snakemake

    sys.argv[0] = "snakemake"
    snakemake()


if __name__ == "__main__":
    main()
