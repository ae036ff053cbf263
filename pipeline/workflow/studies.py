"""What the rules of the studies ask: which studies there are, the files of their cases, and what these depend on."""
from pipeline.base.digest import code_used, shortened
from pipeline.base.errors import UserError
from pipeline.studies.plan import Study, cached_study, study_names
from pipeline.studies.report import SO_FAR, outcomes_so_far, write_study
from pipeline.workflow.digest import stage_digest
from pipeline.workflow.scenes import OUTPUTS, Workflow, stop
from sim.cores import USEFUL_THREADS, available_cores

CASE_MEMORY = 2000  # MB: enough for 100,000 particles; what a family computes is not known before


class Studies:
    """The studies of one call of Snakemake; a study with errors matters to those only who ask for it.

    Parameters
    ----------
    flow : the scenes, some of which the cases of a study may read.
    """

    def __init__(self, flow: Workflow):
        self._flow = flow
        self.names = study_names()
        self._asked: dict[tuple[str, str], None] = {}  # study and level, in the order of the rules

    def study(self, name: str, level: str) -> Study:
        """Return a study by name; one with errors ends Snakemake with one sentence for each."""
        try:
            return cached_study(name, level)
        except UserError as error:
            stop(*error.messages)

    def case_folders(self, name: str, level: str) -> list[str]:
        """Return the folders that the cases of a study write, in the order of its file."""
        return [f"{OUTPUTS}/studies/{name}/{level}/cases/{case}" for case in self.study(name, level).cases]

    def pictures(self, name: str) -> list[str]:
        """Return the names of the PNG files of a study; none while its file has errors."""
        try:
            return cached_study(name, self._flow.accuracy).pictures()
        except UserError:
            return []

    def tables(self, name: str) -> list[str]:
        """Return the names of the CSV files of a study beside its table; none while its file has errors."""
        try:
            return cached_study(name, self._flow.accuracy).tables()
        except UserError:
            return []

    def inputs(self, name: str, level: str, case: str) -> list[str]:
        """Return the files that a case reads: of its scenes initial state, metrics, and what its family asks for.

        They are those of the study's own accuracy level.
        """
        asked = self._case(name, level, case)
        files = asked.files()
        for scene, folder in asked.folders().items():
            files += [f"{folder}/scene.json", f"{folder}/initial.npz", f"{folder}/metrics.csv"]
            files += [f"{folder}/{stage}" for stage in asked.family.reads if "." in stage]
            files += [f"{folder}/{stage}/segment_{segment}" for stage in asked.family.reads if "." not in stage
                      for segment in self._flow.segments(scene, asked.accuracy)]
        return files

    def threads(self, name: str, level: str, case: str, cores: int) -> int:
        """Return how many threads a case gets where Snakemake has a number of cores.

        The cases of a study share the cores: many run side by side, a few get several each. What only reads the results
        of scenes needs one.
        """
        asked = self._case(name, level, case)
        if asked.folders():
            return 1
        cores = cores if self._flow.elsewhere else min(cores, available_cores())
        share = min(cores // self.study(name, level).solving, USEFUL_THREADS)
        return min(max(asked.family.threads, share), cores)

    @staticmethod
    def memory(wildcards, attempt: int) -> int:
        """Return a resource: the memory, MB, that a case may take; one that is tried again gets more."""
        return attempt * CASE_MEMORY

    def depends(self, name: str, level: str, case: str) -> str:
        """Return a parameter that changes when the outcome of a case may change."""
        return self._case(name, level, case).digest()

    def report_depends(self, name: str, level: str) -> str:
        """Return a parameter that changes when table or figures of a study may change."""
        study = self.study(name, level)
        self._asked[name, level] = None
        page = code_used(study.page.module) if study.page else ""
        return (f"{shortened(stage_digest('study_report'), page)} {study.accuracy} {study.title} {study.description} "
                f"{study.figures()}")

    def tell_so_far(self) -> None:
        """Write and tell what is known of the studies of a run in which something has failed."""
        for name, level in self._asked:
            folder = OUTPUTS / "studies" / name / level
            study = self.study(name, level)
            outcomes = outcomes_so_far(study, folder)
            if any(outcome.failure for outcome in outcomes):
                write_study(study, outcomes, folder / SO_FAR, complete=False)
                print(f"{name} at {level}, as far as there are results: {folder / SO_FAR / 'table.html'}", flush=True)

    def _case(self, name: str, level: str, case: str):
        try:
            return self.study(name, level).case(case)
        except UserError as error:
            stop(*error.messages)
