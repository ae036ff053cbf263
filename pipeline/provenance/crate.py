"""The RO-Crate of a run: scene, code, computer, jobs with their times and digests, and a checksum of every result.

It follows the profile Provenance Run Crate 0.5 (https://w3id.org/ro/wfrun/provenance/0.5) of RO-Crate 1.1. Jobs, their
times and digests are those that Snakemake has noted, so that what was made by older code is told as such. Paths are
relative to the folder: it may be moved or packed.
"""
import dataclasses
import hashlib
import json
import os
import platform
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import version
from pathlib import Path, PurePosixPath
from typing import Any

from pipeline.base.computer import computer
from pipeline.base.errors import UserError
from pipeline.base.origin import NAME, changed, commit, release
from pipeline.base.packages import packages
from pipeline.base.project import PROJECT, SNAKEFILE
from pipeline.base.usage import read_usage
from pipeline.provenance.entities import (
    CRATE_VERSION,
    DONE,
    FORMATS,
    PROFILES,
    WORKFLOW_CRATE,
    Entities,
    Reference,
    each_once,
    file_id,
    folder_id,
    moment,
)
from pipeline.runs.contents import CRATE, is_result
from pipeline.runs.run_folder import RunFolder
from pipeline.workflow.notes import Job, kept_of, within

WORKFLOW = PurePosixPath("workflow")  # a copy of the rules by which the run was made
SCENE = PurePosixPath("scene.json")
OWN_RULE = "crate"
NO_LICENSE = "No license is stated for these results."
USED = {"wall": ("seconds on the clock", "SEC"), "cpu": ("seconds of all cores", "SEC"),
        "memory": ("largest memory", "AD")}  # with codes of UN/CEFACT


@dataclasses.dataclass(frozen=True)
class Measured:
    """A file of a run: its size, bytes, the time of its last change in ISO 8601, and its SHA-256."""

    size: int
    changed: str
    checksum: str


def measure(path: Path, before: Measured | None = None) -> Measured:
    """Return size, date and checksum of a file.

    Parameters
    ----------
    before : what an earlier crate says of it. A file of the same size and date is not read again: large runs would be,
        whenever a page is made anew.
    """
    with path.open("rb") as file:
        state = os.fstat(file.fileno())
        size, changed = state.st_size, moment(state.st_mtime)
        if before is not None and (size, changed) == (before.size, before.changed):
            return before
        return Measured(size, changed, hashlib.file_digest(file, "sha256").hexdigest())


def measured_before(path: Path) -> dict[str, Measured]:
    """Return what an earlier crate says of the files of a run, by their ids; nothing of one that cannot be read."""
    try:
        found = [one for one in json.loads(path.read_bytes())["@graph"] if "dateModified" in one]
        return {one["@id"]: Measured(int(one["contentSize"]), one["dateModified"], one["sha256"]) for one in found}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def copied_rules() -> dict[PurePosixPath, str]:
    """Return the texts of the Snakefile and its rules, as they are copied into a run."""
    files = [PROJECT / SNAKEFILE, *sorted((PROJECT / "rules").glob("*.smk"))]
    return {WORKFLOW / path.relative_to(PROJECT).as_posix(): path.read_text(encoding="utf-8") for path in files}


def code_version() -> str:
    """Return the version of this code, with the commit and whether it was changed where it is a checkout."""
    return release() + (f"+g{commit()}" if commit() else "") + (".changed" if changed() else "")


def crate_of(run: RunFolder, threads: int = 1) -> str:
    """Return the crate of a run as JSON.

    Parameters
    ----------
    run : its copy of the rules is in the folder already (:func:`copied_rules`).
    threads : that read files.

    Raises
    ------
    UserError : Snakemake has not noted how the run was made.
    """
    outputs = _outputs(run)
    if not outputs:
        raise UserError(f"{run.folder}: Snakemake has no notes of this run in {Path.cwd()}; make the crate in the "
                        "folder in which it was run, by snakemake -j2 "
                        f"outputs/{run.scene.name}/{run.level}/{CRATE}")
    return _Crate(run, outputs, threads).entities.text()


def _outputs(run: RunFolder) -> dict[Job, list[PurePosixPath]]:
    """The jobs of a run, each with the files and folders that it made and that are still there."""
    return {job: kept for job, kept in kept_of(run.folder, run.segments).items() if job.stage and job.rule != OWN_RULE}


class _Crate:
    """Adds to the entities of a crate what there is to say of a run."""

    def __init__(self, run: RunFolder, outputs: dict[Job, list[PurePosixPath]], threads: int):
        self.run, self.outputs, self.entities = run, outputs, Entities()
        paths = sorted({path for made in ([SCENE, WORKFLOW], *outputs.values()) for one in made
                        for path in self._files(one)})
        before = measured_before(run.folder / CRATE)
        with ThreadPoolExecutor(threads) as pool:
            self.measured = dict(zip(paths, pool.map(
                lambda path: measure(run.folder / path, before.get(file_id(path))), paths), strict=True))
        self.inside: dict[PurePosixPath, set[PurePosixPath]] = {}  # folder -> what is directly in it
        for path in paths:
            for one in (path, *path.parents[:-1]):
                self.inside.setdefault(one.parent, set()).add(one)
        self._describe()

    def _files(self, path: PurePosixPath) -> list[PurePosixPath]:
        """A file, or the files in a folder."""
        place = self.run.folder / path
        found = [path] if place.is_file() else [
            PurePosixPath(one.relative_to(self.run.folder).as_posix()) for one in place.rglob("*") if one.is_file()]
        return [one for one in found if is_result(one)]

    def _describe(self) -> None:
        run, add, begun, ended = self.run, self.entities.add, *self._span()
        add(CRATE, "CreativeWork", about={"@id": "./"}, conformsTo=[{"@id": CRATE_VERSION}, {"@id": WORKFLOW_CRATE}])
        add("./", "Dataset", name=f"{run.title} ({run.scene.name} at {run.level})", description=run.scene.description,
            datePublished=moment(ended), license=NO_LICENSE, conformsTo=[{"@id": one} for one in PROFILES],
            hasPart=self._parts(PurePosixPath()),
            mainEntity={"@id": file_id(WORKFLOW / SNAKEFILE)},
            mentions=[{"@id": "#engine"}, {"@id": "#run"}, {"@id": "#computer"},
                      *({"@id": f"#job-{job.name}"} for job in self.outputs)])
        for name, title in PROFILES.items():
            add(name, "CreativeWork", name=title, version=name.rpartition("/")[2])
        self._describe_run(begun, ended)
        self._describe_workflow()
        for job in self.outputs:
            self._describe_job(job)
        self._describe_surroundings()
        for folder in sorted(self.inside.keys() - {PurePosixPath()}):
            add(folder_id(folder), "Dataset", name=f"{folder}", hasPart=self._parts(folder))
        for path in self.measured:
            add(file_id(path), "File", name=path.name, encodingFormat=FORMATS.get(path.suffix, "text/plain"),
                **self._measured(path))

    def _measured(self, path: PurePosixPath) -> dict[str, str]:
        """The properties of a file that were measured."""
        one = self.measured[path]
        return {"contentSize": str(one.size), "dateModified": one.changed, "sha256": one.checksum}

    def _parts(self, folder: PurePosixPath) -> list[Reference]:
        return [self._reference(path) for path in sorted(self.inside[folder])]

    def _span(self) -> tuple[float, float]:
        return min(job.start for job in self.outputs), max(job.end for job in self.outputs)

    def _reference(self, path: PurePosixPath) -> Reference:
        return {"@id": file_id(path) if path in self.measured else folder_id(path)}

    def _describe_run(self, begun: float, ended: float) -> None:
        scene, add = self.run.scene, self.entities.add
        values = {"accuracy": scene.accuracy, "dimension": scene.dimension, "scheme": scene.numerics.scheme,
                  "particle_spacing": scene.numerics.particle_spacing, "duration": scene.output.duration,
                  "frame_interval": scene.output.frame_interval, "liquids": ", ".join(
                      liquid.name for liquid in scene.liquids), "effects": ", ".join(scene.effects),
                  "device": ", ".join(dict.fromkeys(one["device"] for one in self._costs() if "device" in one))}
        units = {"particle_spacing": "MTR", "duration": "SEC", "frame_interval": "SEC"}
        level = {"exampleOfWork": {"@id": "#parameter-accuracy"}}
        given = [add(f"#value-{name}", "PropertyValue", name=name, value=value, unitCode=units.get(name),
                     **(level if name == "accuracy" else {})) for name, value in values.items() if value != ""]
        add("scene.json", "File", name="scene.json", exampleOfWork={"@id": "#parameter-scene"},
            description="The scene with every default, in SI units", encodingFormat=FORMATS[".json"],
            **self._measured(SCENE))
        results = [self._reference(path) for made in self.outputs.values() for path in made]
        add("#engine", "OrganizeAction", name="Run of Snakemake", instrument={"@id": "#Snakemake"},
            object=[{"@id": f"#step-{job.name}"} for job in self.outputs], result={"@id": "#run"},
            startTime=moment(begun), endTime=moment(ended), actionStatus=DONE)
        add("#run", "CreateAction", name=f"Run of {scene.name} at {scene.accuracy}",
            description=f"snakemake -j2 outputs/{scene.name}/{scene.accuracy}/index.html",
            instrument={"@id": file_id(WORKFLOW / SNAKEFILE)}, object=[{"@id": "scene.json"}, *given],
            result=each_once(results), startTime=moment(begun), endTime=moment(ended), actionStatus=DONE)

    def _costs(self) -> list[dict[str, Any]]:
        """What the solver says of the segments; nothing where its files are not there."""
        return self.run.costs if all(path.is_file() for path in self.run.cost_files) else []

    def _describe_workflow(self) -> None:
        add = self.entities.add
        rules = list(dict.fromkeys(job.rule for job in self.outputs))
        stages = {job.rule: job.stage for job in self.outputs}
        language = add("https://w3id.org/workflowhub/workflow-ro-crate#snakemake", "ComputerLanguage", name="Snakemake",
                       identifier={"@id": "https://doi.org/10.1093/bioinformatics/bts480"},
                       url={"@id": "https://snakemake.github.io"})
        path = WORKFLOW / SNAKEFILE
        parameters = [add("#parameter-scene", "FormalParameter", name="scene", additionalType="File"),
                      add("#parameter-accuracy", "FormalParameter", name="accuracy", additionalType="Text")]
        used = [add(f"#package-{one.name}", "SoftwareApplication", name=one.name, softwareVersion=one.version)
                for one in packages() if one.name.lower().replace("_", "-") != NAME]
        python = add("#Python", "SoftwareApplication", name="Python", softwareVersion=platform.python_version())
        add(file_id(path), ["File", "SoftwareSourceCode", "ComputationalWorkflow", "HowTo"], name=NAME,
            version=code_version(), programmingLanguage=language, license={"@id": "https://spdx.org/licenses/MIT"},
            conformsTo={"@id": "https://bioschemas.org/profiles/ComputationalWorkflow/1.0-RELEASE"},
            hasPart=[{"@id": f"#pipeline.{stage}"} for stage in dict.fromkeys(stages.values())],
            step=[{"@id": f"{file_id(path)}#{rule}"} for rule in rules], input=parameters,
            softwareRequirements=[python, *used], encodingFormat="text/plain", **self._measured(path))
        add("https://bioschemas.org/profiles/ComputationalWorkflow/1.0-RELEASE", "CreativeWork",
            name="ComputationalWorkflow", version="1.0")
        add("https://spdx.org/licenses/MIT", "CreativeWork", name="MIT license")
        for position, rule in enumerate(rules):
            add(f"{file_id(path)}#{rule}", "HowToStep", name=rule, position=str(position),
                workExample={"@id": f"#pipeline.{stages[rule]}"})
        for stage in dict.fromkeys(stages.values()):
            add(f"#pipeline.{stage}", "SoftwareApplication", name=f"python -m pipeline.{stage}",
                softwareVersion=code_version())

    def _describe_job(self, job: Job) -> None:
        add = self.entities.add
        add(f"#step-{job.name}", "ControlAction", name=f"Step {job.name}", object={"@id": f"#job-{job.name}"},
            instrument={"@id": f"{file_id(WORKFLOW / SNAKEFILE)}#{job.rule}"}, actionStatus=DONE)
        given = [self._input(name) for name in job.inputs]
        if job.digests:
            digests = " ".join(job.digests)
            given.append(add(f"#digest-{job.rule}-{digests.replace(' ', '-')}", "PropertyValue", value=digests,
                             name="digest of the code and of what it reads of the scene"))
        add(f"#job-{job.name}", "CreateAction", name=job.name, description=job.command,
            instrument={"@id": f"#pipeline.{job.stage}"}, object=each_once(given),
            result=each_once(self._reference(path) for path in self.outputs[job]), startTime=moment(job.start),
            endTime=moment(job.end), actionStatus=DONE, resourceUsage=self._usage(job))

    def _input(self, name: str) -> Reference:
        """What a job read: of the run, or from elsewhere, such as the mesh of an eye, which the crate does not hold."""
        path = within(self.run.folder, name)
        if path in self.measured or path in self.inside:
            return self._reference(path)
        place = Path(name)
        return self.entities.add(f"#{name}" if not place.is_absolute() else f"#{place.name}", "CreativeWork",
                                 name=place.name, sha256=measure(place).checksum if place.is_file() else None)

    def _usage(self, job: Job) -> list[Reference]:
        path = self.run.folder / "logs" / f"{job.name}.log.json"
        taken = read_usage(path) if path.is_file() else {}
        return [self.entities.add(f"#job-{job.name}-{kind}", "PropertyValue", name=name, propertyID=kind,
                                  unitCode=unit, value=taken[kind])
                for kind, (name, unit) in USED.items() if kind in taken]

    def _describe_surroundings(self) -> None:
        add = self.entities.add
        add("#computer", "IndividualProduct", name=computer(),
            description="The computer that wrote this crate; jobs of a cluster ran on others")
        add("#Snakemake", "SoftwareApplication", name="Snakemake", softwareVersion=version("snakemake"),
            url={"@id": "https://snakemake.github.io"})
