"""What a process takes: seconds on the clock and of all cores, its children's included, and memory.

A stage that ends well writes it where the environment variable STAGE_USAGE says. The kernel counts, so that nothing is
missed however short or long a stage is.
"""
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path

from pipeline.base.errors import UserError
from pipeline.base.files import write_text
from pipeline.base.memory import sentence_of_signal
from sim.cores import available_cores

ASKED = "STAGE_USAGE"
LIBRARIES = ("OMP_NUM_THREADS", "VTK_SMP_MAX_THREADS", "LP_NUM_THREADS")  # what tells them their threads
KINDS = ("wall", "cpu")  # seconds on the clock, seconds of all cores
OF_A_FRAME = tuple(f"frame_{kind}" for kind in KINDS)
_frames: list[dict[str, float]] = []  # what this process had taken when it had finished each of its frames


def usage() -> dict[str, float]:
    """Return what this process has taken since its start: wall, cpu (s) and memory (bytes, the largest)."""
    own, children = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    cpu = sum(one.ru_utime + one.ru_stime for one in (own, children))
    unit = 1.0 if sys.platform == "darwin" else 1024.0  # of ru_maxrss
    return {"wall": at_least(_since_start(), cpu), "cpu": cpu, "memory": unit * max(own.ru_maxrss, children.ru_maxrss)}


def _since_start() -> float:
    """Seconds since this process has started, by a clock that nobody sets where the system (Linux) has one."""
    if sys.platform == "linux":
        ticks = float(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19])
        return time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK")
    import psutil  # which Snakemake brings

    return time.time() - psutil.Process().create_time()


def at_least(wall: float, cpu: float) -> float:
    """Return a time on the clock, s, that is not below what all cores together need: clocks count in ticks."""
    return max(wall, cpu / available_cores())


def frame_done() -> None:
    """Note that this process has finished a frame, where its environment asks for what it takes."""
    if ASKED in os.environ:
        _frames.append(usage())


def of_a_frame() -> dict[str, float]:
    """Return what a frame took: frame_wall and frame_cpu, s; nothing of fewer than two frames.

    The mean of all but the first, with which a process loads what it needs.
    """
    if len(_frames) < 2:
        return {}
    return {name: (_frames[-1][kind] - _frames[0][kind]) / (len(_frames) - 1)
            for name, kind in zip(OF_A_FRAME, KINDS, strict=True)}


def write_if_asked() -> None:
    """Write what this process has taken, where its environment asks for it."""
    if ASKED in os.environ:
        write_text(os.environ[ASKED], json.dumps(usage() | of_a_frame()) + "\n")


def read_usage(path: Path) -> dict[str, float]:
    """Read what a stage has written: wall, cpu (s), memory (bytes), and where it knows them frame_wall, frame_cpu (s).

    Raises
    ------
    UserError : the file holds nothing of the kind.
    """
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        return {key: float(found[key]) for key in (*KINDS, "memory", *(set(OF_A_FRAME) & set(found)))}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UserError(f"{path}: does not hold what a stage took ({error}); run the stage again") from error


def usage_files(folder: Path, segments: Iterable[str]) -> list[Path]:
    """Return the files beside the logs in a folder in which the stages of a run say what they took.

    A longer scene of before may have left some of segments that this one does not have.
    """
    known = (None, *segments)
    return [path for path in sorted(folder.glob("*.log.json")) if segment_of(path) in known]


def taken_by(paths: Iterable[Path]) -> dict[str, dict[str, float]]:
    """Return what the stages took: stage -> wall, cpu (s, sums over the segments) and memory (bytes, the largest).

    Raises
    ------
    UserError : a file does not say so.
    """
    found: dict[str, dict[str, float]] = {}
    for path in paths:
        taken = read_usage(path)
        sums = found.setdefault(path.name.partition(".")[0].partition("_")[0], {"wall": 0.0, "cpu": 0.0, "memory": 0.0})
        for kind in KINDS:
            sums[kind] += taken[kind]
        sums["memory"] = max(sums["memory"], taken["memory"])
    return found


def segment_of(path: Path) -> str | None:
    """Return the segment that a log is of; None for a stage that has none."""
    last = path.name.partition(".")[0].rpartition("_")[2]
    return last if last.isdecimal() else None


def run_stage(stage: str, *arguments: object, threads: int | None = None, quiet: bool = True) -> dict[str, float]:
    """Run a stage in a process of its own, and return what it took.

    Parameters
    ----------
    threads : of libraries, as Snakemake tells them; None leaves that as it is.
    quiet : do not pass its progress on to standard error.

    Raises
    ------
    UserError : the stage has failed; with its own sentences.
    """
    with tempfile.TemporaryDirectory(prefix="usage_") as folder:
        path = Path(folder) / f"{stage}.json"
        command = [sys.executable, "-m", f"pipeline.{stage}", *map(str, arguments)]
        told = {} if threads is None else dict.fromkeys(LIBRARIES, str(threads))
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
                                   env=os.environ | told | {ASKED: str(path)})
        errors, last = [], ""
        for line in process.stderr:
            if line.startswith("error: "):
                errors.append(line.removeprefix("error: ").strip())
            elif not quiet:
                sys.stderr.write(line)
                sys.stderr.flush()
            last = line.strip() or last
        if code := process.wait():
            raise UserError(*(errors or [sentence_of_signal(-code, stage) or f"the stage {stage} has failed ({last})"]))
        return read_usage(path)
