"""What was asked of Snakemake at its command line, where it would wait without end or speak of rules and metadata."""
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from pipeline.base.words import nearest
from pipeline.studies.plan import study_names
from pipeline.workflow.scenes import OUTPUTS, Workflow, scene_names, stop

SCENE_FILES = (".yaml", ".yml")
REPORT = "--report"


def refuse_impossible(flow: Workflow, cores: int | None, rules: Iterable[Any], arguments: Sequence[str]) -> None:
    """End Snakemake with a sentence: no cores, a file that no rule makes, or a report of what has not been made.

    Parameters
    ----------
    cores : that may be used; None where nothing is run.
    rules : of Snakemake. arguments : of its command line.
    """
    if cores == 0:
        stop("-j is 0, but must be the number of cores to use, 1 at least, or all")
    rules = list(rules)
    for target in _files(arguments):
        if not any(rule.is_producer(target) for rule in rules):
            _refuse(flow, target, rules)
    names = {rule.name for rule in rules} | {*scene_names(), *study_names()}
    if any(one.split("=")[0] == REPORT for one in arguments) and not names & {*arguments} and not _files(arguments):
        missing = [file for file in flow.wanted(flow.names) if not Path(file).exists()]
        if missing:
            more = f", and {len(missing) - 1} more" if missing[1:] else ""
            stop(f"{REPORT}: {missing[0]} is not made yet{more}: run snakemake -j2 all before, or name the scene that "
                 "was run")


def _files(arguments: Sequence[str]) -> list[str]:
    """Return the arguments that are files to make: those in the outputs, and scene files, which are none."""
    before = ("", *arguments)
    scenes = () if any(one.startswith("--configfile") for one in arguments) else SCENE_FILES
    return [one for last, one in zip(before, arguments, strict=False)
            if not last.startswith("--") and not one.startswith("-") and "=" not in one
            and (one.startswith(f"{OUTPUTS}/") or one.endswith(scenes))]


def _refuse(flow: Workflow, target: str, rules: Sequence[Any]) -> None:
    """End Snakemake with what may have been meant by a file that no rule makes."""
    path = Path(target)
    if path.suffix in SCENE_FILES and path.parts[0] != str(OUTPUTS):
        stop(f"{target}: is a scene file, but scenes are asked for by their names{nearest(path.stem, scene_names())}")
    folder = "/".join(path.parts[:3])
    if len(path.parts) > 3 and path.parts[2] in flow.levels:
        flow.scene(path.parts[1], path.parts[2])  # an unknown scene has a sentence of its own
        patterns = [str(file).rpartition("}/") for rule in rules for file in rule.output]
        made = sorted({name for before, _, name in patterns if before.startswith(f"{OUTPUTS}/{{scene")
                       and "{level" in before and before.count("{") == 2 and "{" not in name})
        stop(f"{target}: no rule makes this file{nearest('/'.join(path.parts[3:]), made)}; in {folder} there can be "
             f"{', '.join(made)}")
    stop(f"{target}: no rule makes this file; ask for a scene or a study by its name")
