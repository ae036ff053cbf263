"""Kill a run with -9 at random moments of all its stages, and compare what it makes in the end with an unbroken run.

    python benchmarks/faults/kills.py                 30 kills
    python benchmarks/faults/kills.py --kills 4 --reference /tmp/unbroken

Every stage is a victim in turn, at a random moment of its time: the stage alone, Snakemake alone, or both. The same
command then goes on. The unbroken run has two threads, the broken one has one.
"""
import argparse
import json
import os
import random
import signal
import sys
import tempfile
import time
from pathlib import Path

from copy_of_project import Copy, differences

# Stages in the order in which a run needs them, with what each makes.
STAGES = {
    "scene": "scene.json", "eye": "eye.vtp", "voxelize": "initial.npz", "advise": "advice.html",
    "estimate": "estimate.json", "simulate": "checkpoints/segment_001.npz", "reconstruct": "surfaces/segment_001",
    "render": "images/segment_001", "metrics": "metrics.csv", "movie": "movie.mp4", "index_run": "run.pvd",
    "effect_costs": "effects.csv", "cost": "cost.html", "page": "index.html"}
VICTIMS = ("everything", "the stage", "Snakemake")
PATIENCE = 900.0  # s, until a stage must have begun


def duration_of(reference: Copy, stage: str) -> float:
    """Time that a stage took in the unbroken run, s; 5 s of one that does not tell."""
    found = sorted((reference.outputs / "logs").glob(f"{stage}*.log.json"))
    return json.loads(found[0].read_text())["wall"] if found else 5.0


def kill(copy: Copy, stage: str, victim: str, after: float) -> str:
    """Start a run, wait for a stage and some seconds more, and kill; return what was hit."""
    run = copy.start(str((copy.outputs / STAGES[stage]).relative_to(copy.folder)), cores=1)
    end = time.monotonic() + PATIENCE
    while not copy.processes("-m", f"pipeline.{stage}"):
        if run.poll() is not None or time.monotonic() > end:
            copy.kill_all()
            return ""
        time.sleep(0.02)
    time.sleep(after)
    hit = [word.removeprefix("pipeline.") for process in copy.processes("-m") for word in
           Path(f"/proc/{process}/cmdline").read_text().split("\0") if word.startswith("pipeline.")]
    if victim == "everything":
        copy.kill_all()
    elif victim == "Snakemake":  # the stage lives on, while the next run begins
        os.kill(run.pid, signal.SIGKILL)
    else:
        for process in copy.processes("-m", f"pipeline.{stage}"):
            os.kill(process, signal.SIGKILL)
    run.wait()
    return ", ".join(sorted(set(hit))) or "between stages"


def main() -> int:
    """Kill, go on, compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--reference", type=Path, help="copy of the project with an unbroken run (made where missing)")
    options = parser.parse_args()
    chance = random.Random(options.seed)
    with tempfile.TemporaryDirectory(prefix="kills_") as work:
        reference, copy = Copy((options.reference or Path(work) / "unbroken").resolve()), Copy(Path(work) / "broken")
        code, printed = reference.run()
        if code:
            print(printed)
            return code
        done = 0
        for number in range(options.kills):
            stage = list(STAGES)[number * len(STAGES) // options.kills]
            victim, after = chance.choice(VICTIMS), chance.uniform(0.0, duration_of(reference, stage))
            hit = kill(copy, stage, victim, after)
            done += bool(hit)
            print(f"kill {number + 1}: {victim}, {after:.1f} s after {stage} began: hit {hit or 'nothing'}", flush=True)
        code, printed = copy.run(cores=1)
        copy.kill_all()
        again, idle = copy.run("-n", cores=1)
        unlike = differences(reference.checksums(), copy.checksums())
        left = [str(path) for path in copy.outputs.rglob(".*") if path.name != ".snakemake_timestamp"]
        files = len(reference.checksums())
        print(f"{done} kills; the same command then ended with {code}; nothing to be done afterwards: "
              f"{'Nothing to be done' in idle}; {files - len(unlike)} of {files} files have the SHA-256 of the "
              f"unbroken run; left over: {', '.join(left) or 'nothing'}")
        if unlike:
            print("different:", *unlike)
        if code:
            print(printed)
        return int(bool(code or again or unlike or left))


if __name__ == "__main__":
    sys.exit(main())
