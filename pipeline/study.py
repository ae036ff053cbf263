"""Run the cases of a study: an answer that takes several runs.

    python -m pipeline.study validation --list                 what there is
    python -m pipeline.study validation                        every case, the table and the figures
    python -m pipeline.study validation --case CASE --output DIR    one case, as Snakemake calls it
"""
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from pipeline.base.cli import CommandLine, run, stage_parser
from pipeline.base.errors import UserError
from pipeline.base.files import replacing_folder, write_text
from pipeline.base.origin import code, machine
from pipeline.base.threads import checked_threads
from pipeline.scenes.devices import HELP, checked_device
from pipeline.studies.model import Outcome
from pipeline.studies.plan import Case, Study, load_study, study_names
from pipeline.studies.report import DEPENDS, OUTPUTS, write_study


def precision_of(case: Case) -> str:
    """Return the precision of a case: rounding must not be what is measured, unless the case asks for that."""
    return getattr(case.parameters, "precision", "f64")


def run_case(case: Case, threads: int = 0, device: str = "cpu", *, keep_to_core: bool = False) -> Outcome:
    """Run one case and return what it measured, every row with the seconds it took.

    A case that its own parameters make impossible has a failure as its outcome: it would fail again, and is no reason
    to keep the others from their table. What the computer does (memory, disk) is raised.

    Parameters
    ----------
    threads : of the solver, 0 for as many as are useful.
    device : of the solver.
    keep_to_core : see ``sim.backend.runtime.initialize``.
    """
    from sim.backend.runtime import initialize
    from sim.errors import RunError

    initialize(precision_of(case), threads, device, keep_to_core=keep_to_core)
    begin = time.perf_counter()
    try:
        outcome = case.run()
    except (UserError, RunError, OverflowError) as error:
        outcome = Outcome.failed(case.name, " ".join(str(error).split()))
        print(f"error: {outcome.failure}", file=sys.stderr)
    outcome.case, outcome.machine, outcome.code = case.name, machine(), code()
    print(f"{case.name}: {len(outcome.rows)} rows in {time.perf_counter() - begin:.1f} s", file=sys.stderr)
    return outcome


def parser() -> CommandLine:
    """Command line of the stage."""
    p = stage_parser("study", __doc__)
    p.add_argument("study", help=f"one of {', '.join(study_names())}")
    p.add_argument("--case", help="run this case only (default: all, then table and figures)")
    p.add_argument("--accuracy", default="draft", help="level of config/accuracy.yaml (default draft)")
    p.add_argument("--output", type=Path, metavar="DIR",
                   help="folder to write (default outputs/studies/<study>/<level>, of a case cases/<case> in it)")
    p.add_argument("--threads", type=int, default=0, metavar="N",
                   help="threads of the solver (default 0: as many as are useful)")
    p.add_argument("--device", default="auto", help=f"{HELP} (default auto)")
    p.add_argument("--list", action="store_true", help="print the names of the cases and stop")
    return p


def main() -> None:
    """Run a study or one of its cases."""
    arguments = parser().parse_args()
    threads = checked_threads(arguments.threads, "--threads")
    study = load_study(arguments.study, arguments.accuracy)
    if arguments.list:
        print("\n".join(study.cases))
        return
    folder = OUTPUTS / study.name / study.accuracy
    cases = [study.case(arguments.case)] if arguments.case else list(study.cases.values())
    _refuse_missing(study, cases)
    devices = [checked_device(arguments.device, "--device", precision_of(case)) for case in cases]
    if arguments.case:
        _run_into(cases[0], arguments.output or folder / "cases" / arguments.case, threads, devices[0])
        return
    folder = arguments.output or folder
    for case, device in zip(cases, devices, strict=True):
        _run_into(case, folder / "cases" / case.name, threads, device)
    write_study(study, [Outcome.read(folder / "cases" / name) for name in study.cases], folder)


def _refuse_missing(study: Study, cases: Sequence[Case]) -> None:
    """Stop before a case that reads what is not there yet: its failure would pass for a result."""
    for case in cases:
        read = [folder / name for folder in case.folders().values() for name in ("metrics.csv", *case.family.reads)]
        missing = [path for path in (*map(Path, case.files()), *read) if not path.exists()]
        if missing:
            raise UserError(f"{case.name} reads {missing[0]}, which is not there yet; "
                            f"`snakemake -j2 {study.name} --config accuracy={study.accuracy}` makes it first")


def _run_into(case: Case, folder: Path, threads: int, device: str) -> None:
    depends = case.digest()
    outcome = run_case(case, threads, device, keep_to_core=True)
    with replacing_folder(folder) as partial:
        outcome.write(partial)
        write_text(partial / DEPENDS, depends)


if __name__ == "__main__":
    run(main)
