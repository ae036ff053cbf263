"""Snakemake, called from Python: the same rules as on the command line, with a bar of progress and errors as one."""
import os
import re
import signal
import subprocess
from collections.abc import Sequence
from pathlib import Path

from tqdm import tqdm

from pipeline.base.errors import UserError
from pipeline.workflow.command import snakemake_command

_STEPS = re.compile(r"(\d+) of (\d+) steps")
_JOB = re.compile(r"Job \d+: (.+)")
_STAGE = re.compile(r"[^:]+: (.+): ([\d.]+)/([\d.]+) \w+, .*?(\d+) s left")
_KEPT = 30  # last lines, for a failure without a sentence


def make(folder: Path, targets: Sequence[str], *, cores: int, device: str | None, progress: bool) -> None:
    """Let Snakemake make files; what is there already is not made again.

    Parameters
    ----------
    folder : of the project.
    targets : files, relative to it.
    cores : that may be used. device : of the solver; None leaves that to the scene.
    progress : show a bar on standard error.

    Raises
    ------
    UserError : something could not be made, with the sentences of the stages.
    """
    options = [] if device is None else ["--config", f"device={device}"]
    command = snakemake_command(folder, "--nocolor", f"-j{cores}", *targets, *options)
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                               text=True, errors="replace", cwd=folder, start_new_session=True)
    assert process.stdout is not None  # it is a pipe
    bar = tqdm(total=1, disable=not progress, desc="planning",
               bar_format="{desc}: {percentage:3.0f} %|{bar:20}| {elapsed}{postfix}")
    try:
        with bar:
            lines = [line for line in map(str.rstrip, process.stdout) if not _show(line, bar)]
            code = process.wait()
            bar.set_postfix_str("", refresh=False)
            bar.n = bar.n if code else bar.total
            bar.set_description_str("failed" if code else "done")
    except BaseException:  # an interrupted notebook: let the stages end as by Ctrl-C
        os.killpg(process.pid, signal.SIGINT)
        process.wait()
        raise
    if code:
        errors = dict.fromkeys(line.removeprefix("error: ") for line in lines if line.startswith("error: "))
        raise UserError(*(errors or ["the run has failed; the last lines of Snakemake are:", *lines[-_KEPT:]]))


def _show(line: str, bar: tqdm) -> bool:
    """Show in the bar what a line of Snakemake or of a stage says of the progress; tell whether it did."""
    if match := _STEPS.search(line):
        bar.total, bar.n = int(match[2]), int(match[1])
        bar.refresh()
    elif match := _JOB.match(line):
        bar.set_description_str(match[1])
    elif match := _STAGE.match(line):
        bar.set_postfix_str(f"{match[1]}: {float(match[2]) / float(match[3]):.0%}, {match[4]} s left")
    return match is not None
