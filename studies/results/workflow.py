"""What the rules of `results` ask: which runs there are, what each needs, and what brings its numbers into tables."""
import sys
from collections.abc import Iterable
from typing import Any

from pipeline.base.errors import UserError
from pipeline.workflow.scenes import stop
from pipeline.workflow.studies import Studies
from studies.results.plan import PLAN, Plan, Run, read_plan
from studies.results.tables import FOLDER, LAYOUT, read_layout, read_rows

WORD = "results"  # begins the names of the targets, and of rules that jobs elsewhere are asked for
LONG_JOBS = {"study": "case", "scene": "simulate"}  # of a run: what its rules for them are called after
SOON = 1000  # priority above that of any long job
DRY_RUN = ("-n", "--dry-run", "--dryrun")


class Results:
    """The runs behind the numbers of docs/results; none where nobody asks for them, or where this is no clone.

    Parameters
    ----------
    studies : what the cases of a study are called.
    """

    def __init__(self, studies: Studies):
        self._studies = studies
        asked = any(WORD in word for word in sys.argv[1:])
        self._plan = Plan((), {})
        if asked and (FOLDER / LAYOUT).is_file() and PLAN.is_file():
            try:
                self._plan = read_plan()
                self._layout = read_layout(FOLDER)
                self._rows = {page.name: read_rows(FOLDER, page) for page in self._layout.pages}
            except UserError as error:
                stop(*error.messages)
            if set(sys.argv) & set(DRY_RUN):
                print(self._plan.told(), flush=True)

    @property
    def runs(self) -> tuple[Run, ...]:
        """All runs, the cheapest first."""
        return self._plan.runs

    def inputs(self, run: Run) -> list[str]:
        """Return the files that a run makes."""
        return run.targets(self._studies.study(run.name, run.level).cases if run.kind == "study" else ())

    def commands(self, run: Run) -> str:
        """Return the commands that bring the numbers of a run into tables."""
        commands = run.commands(self._layout, self._rows)
        return " && ".join(commands) or "echo no table has numbers of this run"

    def rules(self, kind: str) -> list[tuple[str, str, str, int]]:
        """Return name, study or scene, level and priority of the rules by which cheap runs of a kind come first."""
        return [(f"{WORD}_{LONG_JOBS[kind]}_{run.key}", run.name, run.level, self._plan.priority(run))
                for run in self.runs if run.kind == kind]

    def hasten(self, rules: Iterable[Any]) -> None:
        """Let what a run needs beside its long jobs come before the next run, so that its numbers are taken soon."""
        long = tuple(f"{WORD}_{job}_" for job in LONG_JOBS.values())
        for rule in rules if self.runs else ():
            if not rule.name.startswith(long):
                rule.priority = SOON
