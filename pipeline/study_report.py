"""Stage: the outcomes of a study's cases become its table, its figures and its page of the report.

    python -m pipeline.study_report <study> --so-far    while cases are running, or after some have failed

A case without a result is a row that does not hold, and a sentence that says why.
"""
from pathlib import Path

from pipeline.base.cli import run, stage_parser
from pipeline.studies.model import Outcome
from pipeline.studies.plan import load_study
from pipeline.studies.report import OUTPUTS, SO_FAR, outcomes_so_far, write_study


def main() -> None:
    """Command line: ``python -m pipeline.study_report <study>``."""
    p = stage_parser("study_report", __doc__)
    p.add_argument("study", help="name of the study")
    p.add_argument("--accuracy", default="draft", help="level of config/accuracy.yaml (default draft)")
    p.add_argument("--folder", type=Path, metavar="DIR",
                   help="of the study, in which its cases are (default outputs/studies/<study>/<level>)")
    p.add_argument("--so-far", action="store_true",
                   help=f"take the cases that have a result, and write into the folder {SO_FAR} beside them")
    arguments = p.parse_args()
    study = load_study(arguments.study, arguments.accuracy)
    folder = arguments.folder or OUTPUTS / study.name / study.accuracy
    if arguments.so_far:
        write_study(study, outcomes_so_far(study, folder), folder / SO_FAR, complete=False)
    else:
        write_study(study, [Outcome.read(folder / "cases" / name) for name in study.cases], folder)


if __name__ == "__main__":
    run(main)
