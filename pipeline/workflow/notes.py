"""What Snakemake notes of every file that it makes: the rule, the command, what was read, and when."""
import base64
import binascii
import dataclasses
import json
import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path, PurePosixPath
from typing import Any

from pipeline.runs.contents import left_over

NOTES = Path(".snakemake/metadata")
DIGEST = re.compile(r"\b[0-9a-f]{16}\b")  # as pipeline.base.digest makes them
STAGE = re.compile(r"python -m pipeline\.(\w+)")


def notes() -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the name of every file that was made in this folder, as Snakemake calls it, and the note of it.

    What this version of Snakemake would not read either is left out.
    """
    for path in NOTES.rglob("*"):
        if path.is_file():
            try:
                name = "".join(part.removeprefix("@") for part in path.relative_to(NOTES).parts)
                note = json.loads(path.read_text(encoding="utf-8"))
                made = os.fsdecode(base64.urlsafe_b64decode(name))
            except (binascii.Error, ValueError):
                continue
            if isinstance(note, dict):
                yield made, note


@dataclasses.dataclass(frozen=True)
class Job:
    """A job of Snakemake that has ended well.

    Attributes
    ----------
    name : that of its log, such as ``simulate_000``.
    stage : what it called, ``python -m pipeline.<stage>``.
    digests : of the code and of what the stage read of the scene, as they were when it ran.
    inputs, outputs : names of files and folders, as Snakemake calls them.
    start, end : seconds since 1970.
    """

    name: str
    rule: str
    stage: str
    command: str
    digests: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    start: float
    end: float


def jobs_of(folder: Path) -> list[Job]:
    """Return the jobs that made what is in ``outputs/<scene>/<level>``, in the order in which they began."""
    below = "/".join(folder.resolve().parts[-3:]) + "/"
    found: dict[str, Job] = {}
    for name, note in sorted(notes(), key=lambda one: one[0]):
        if f"/{name}".rpartition(f"/{below}")[1]:
            job = _job(name, note)
            before = found.get(job.name)
            found[job.name] = job if before is None else dataclasses.replace(
                before, outputs=(*before.outputs, name), start=min(before.start, job.start),
                end=max(before.end, job.end))
    return sorted(found.values(), key=lambda job: (job.start, job.name))


def kept_of(folder: Path, segments: Iterable[str]) -> dict[Job, list[PurePosixPath]]:
    """Return the jobs of a run, each with the files and folders in it that it made and that are still there.

    Parameters
    ----------
    segments : that the run has; jobs of others are those of a longer run.
    """
    made, own = {}, list(segments)
    for job in jobs_of(folder):
        paths = [path for name in job.outputs if (path := within(folder, name))]
        others = {path for found in left_over(paths, own).values() for path in found}
        if kept := [path for path in paths if path not in others and (folder / path).exists()]:
            made[job] = kept
    return made


def within(folder: Path, name: str) -> PurePosixPath | None:
    """Return a file of a run relative to its folder, by Snakemake's name for it; None of one that is elsewhere."""
    _, found, inside = f"/{name}".rpartition("/" + "/".join(folder.resolve().parts[-3:]) + "/")
    return PurePosixPath(inside) if found else None


def _job(name: str, note: dict[str, Any]) -> Job:
    """The job of a note, with the one file that the note is of."""
    command, end = note.get("shellcmd") or "", float(note.get("endtime") or 0.0)
    stages = STAGE.findall(command)
    logs = note.get("log") or [note.get("rule") or name]
    return Job(Path(logs[0]).stem, note.get("rule") or "", stages[0] if stages else "", command,
               tuple(dict.fromkeys(DIGEST.findall(" ".join(map(str, note.get("params") or ()))))),
               tuple(note.get("input") or ()), (name,), float(note.get("starttime") or end), end)
