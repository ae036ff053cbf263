"""Run stages where the disk is full, memory is short, OpenGL is gone, or the folder, the home or the user is unusual.

    python benchmarks/faults/surroundings.py                     all of it; needs root, for mounts and other users
    python benchmarks/faults/surroundings.py disk memory         some of it
    python benchmarks/faults/surroundings.py --reference /tmp/unbroken --cores 1

Every trial must end in one sentence and a code other than 0, or well; afterwards the same command makes files with the
SHA-256 of the unbroken run.
"""
import argparse
import collections
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from copy_of_project import ROOT, SCENE, Copy, differences

sys.path[:0] = [str(ROOT)]

from pipeline.workflow.shell import PREFIX  # noqa: E402

GIB = 2**30
FREE = "/dev/null"
NO_LOCKS = """
#include <errno.h>
int flock(int descriptor, int operation) { errno = ENOLCK; return -1; }
"""
FULL = re.compile("the disk is full|No space left on device")  # of a stage; of the log beside it
TRACE = "Traceback (most recent call last)"


class Bench:
    """The unbroken run, a folder to work in, the cores of a run, the stages to spoil, and what was found."""

    def __init__(self, reference: Copy, work: Path, cores: int, stages: list[str]):
        self.reference, self.work, self.cores, self.stages, self.failed = reference, work, cores, stages, 0
        self.sums = reference.checksums()

    def copy(self, name: str, finished: bool = True) -> Copy:
        """Return a copy of the project, with the results of the unbroken run or without."""
        copy = Copy(self.work / name, self.cores)
        if finished and not copy.outputs.exists():
            shutil.copytree(self.reference.folder / "outputs", copy.folder / "outputs")
            shutil.copytree(self.reference.folder / ".snakemake", copy.folder / ".snakemake", symlinks=True)
        return copy

    def tell(self, what: str, good: bool, how: str) -> None:
        """Print how a trial ended."""
        self.failed += not good
        print(f"{'ok    ' if good else 'FAILED'} {what}: {how}", flush=True)

    def same(self, copy: Copy, names: tuple[str, ...] = ()) -> bool:
        """Whether what a copy has made, of files that begin with some names, is that of the unbroken run."""
        unlike = [path for path in differences(self.sums, copy.checksums()) if not names or path.startswith(names)]
        return not unlike


def commands(copy: Copy, stages: list[str]) -> dict[str, str]:
    """Shell commands of some stages or of all, by name, as Snakemake would run them."""
    _, printed = copy.run("-n", "-p", "--forceall", "all", cores=1)
    found = re.findall(r"^\s*(?:Shell command: )?((?:STAGE_USAGE=\S+ )?python -m pipeline\.(\w+) .*?tee \S+)$", printed,
                       re.MULTILINE)
    return {stage: command for command, stage in found if not stages or stage in stages}


def sh(copy: Copy, command: str, memory: int = 0, **environment: str) -> tuple[int, str]:
    """Run a shell command in a copy; return its exit code and what it printed."""
    limit = (lambda: resource.setrlimit(resource.RLIMIT_AS, (memory, memory))) if memory else None
    done = subprocess.run(["bash", "-c", f"{PREFIX}{command}"], cwd=copy.folder, capture_output=True,
                          text=True, preexec_fn=limit, stdin=subprocess.DEVNULL,
                          env=os.environ | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
                                            "PYTHONPATH": str(copy.folder), "OMP_NUM_THREADS": "1"} | environment)
    return done.returncode, done.stdout + done.stderr


def errors(printed: str) -> list[str]:
    """The sentences of a stage."""
    return [line for line in printed.splitlines() if line.startswith("error: ")]


def outputs_of(command: str) -> list[str]:
    """Paths that a command writes; what `index_run` calls frames it reads."""
    if "pipeline.index_run" in command:
        return re.findall(r"--output (outputs/\S+)", command)
    return re.findall(r"--(?:output|report|frames|checkpoint|costs|summary|plots|meanings|page|table|animation|poster|"
                      r"moments) (outputs/\S+)", command)


def disk(bench: Bench) -> None:
    """Every stage on a full disk."""
    copy = bench.copy("disk")
    files = [path for path in (copy.folder / "outputs").rglob("*") if path.is_file()]
    size = int(1.2 * sum(path.stat().st_size for path in files)) + 2**23
    kept = copy.folder / "kept"
    (copy.folder / "outputs").rename(kept)
    (copy.folder / "outputs").mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", copy.folder / "outputs"], check=True)
    try:
        shutil.copytree(kept, copy.folder / "outputs", dirs_exist_ok=True)
        for stage, command in commands(copy, bench.stages).items():
            for path in outputs_of(command):
                target = copy.folder / path
                shutil.rmtree(target) if target.is_dir() else target.unlink(missing_ok=True)
            before = copy.checksums()
            filler = copy.folder / "outputs" / "filler"
            subprocess.run(["dd", "if=/dev/zero", f"of={filler}", "bs=4k"], capture_output=True)
            code, printed = sh(copy, command)
            told = errors(printed) or [line for line in printed.splitlines() if line.startswith("tee: ")]
            left = [path for path in copy.outputs.rglob(".*") if path.name != ".snakemake_timestamp"]
            filler.unlink()
            now = copy.checksums()  # of several files of a stage the first may have got their names, whole
            kept_all = all(now.get(name) == one for name, one in before.items()) and all(
                one in (before.get(name), bench.sums.get(name)) for name, one in now.items())
            again, after = (0, "") if stage == "estimate" else sh(copy, command)
            good = (code != 0 and len(told) == 1 and FULL.search(told[0]) and TRACE not in printed and kept_all
                    and not left and again == 0 and (stage == "estimate" or bench.same(copy, (
                        *(str(Path(path).relative_to(f"outputs/{SCENE}/draft")) for path in outputs_of(command)
                          if "cost" not in path and "effects" not in path and "index" not in path), "/"))))
            bench.tell(f"full disk in {stage}", good, (told or printed.splitlines()[-1:] or ["no word"])[0]
                       + ("" if good else f" (code {code}, then {again} {after[-300:]}, left {left}, kept {kept_all})"))
            if stage == "estimate":
                shutil.copytree(kept, copy.folder / "outputs", dirs_exist_ok=True)
    finally:
        subprocess.run(["umount", copy.folder / "outputs"], check=True)


def memory(bench: Bench) -> None:
    """Stages with less address space than they need."""
    copy = bench.copy("memory")
    ended = collections.Counter()
    for stage, command in commands(copy, bench.stages).items():
        for limit in (0.25, 0.5, 1.0, 1.5, 2.0, 3.0):
            code, printed = sh(copy, command, memory=int(limit * GIB))
            good = code == 0 or (len(errors(printed)) == 1 and TRACE not in printed)
            ended["well" if code == 0 else "sentences" if good else "FAILED"] += 1
            bench.tell(f"{stage} with {limit:g} GiB of address space", good,
                       "ended well" if code == 0 else f"code {code}, {(errors(printed) or [printed[-300:]])[0]}")
    print(", ".join(f"{count} {how}" for how, count in sorted(ended.items())))
    code, printed = copy.run("all")
    bench.tell("the same run with memory", code == 0 and bench.same(copy), f"code {code}")


def killed(bench: Bench) -> None:
    """A stage that is killed with -9, as the system does where memory is full."""
    copy = bench.copy("killed")
    (copy.outputs / "metrics.csv").unlink()
    run, found = copy.start("all"), []
    while run.poll() is None and not found:
        found = copy.processes("-m", "pipeline.metrics")
        time.sleep(0.02)
    for process in found:
        os.kill(process, signal.SIGKILL)
    code, told = run.wait(), errors((copy.folder / "snakemake.log").read_text())
    good = code == 1 and len(set(told)) == 1 and told[0].startswith("error: not enough memory to run metrics, unless ")
    bench.tell("metrics killed with -9", good, (told or ["no word"])[0])
    code, _ = copy.run("all")
    bench.tell("the same run with memory", code == 0 and bench.same(copy), f"code {code}")


def opengl(bench: Bench) -> None:
    """A driver that vanishes before the pictures are drawn, and comes back."""
    copy = bench.copy("opengl")
    shutil.rmtree(copy.outputs / "images")
    for name in ("movie.mp4", "movie.gif", "poster.png", "moments.png", "index.html"):
        (copy.outputs / name).unlink()
    libraries = subprocess.run("ls /usr/lib/*/lib{OSMesa,EGL,GL,GLX,OpenGL}.so* 2>/dev/null", shell=True,
                               executable="/bin/bash", capture_output=True, text=True).stdout.split()
    hide = "; ".join(f"mount --bind {FREE} {path}" for path in libraries)
    run = f"{hide}; exec {sys.executable} -m snakemake -j{bench.cores} all --config 'scenes=[{SCENE}]'"
    done = subprocess.run(["unshare", "-m", "bash", "-c", run], cwd=copy.folder, capture_output=True, text=True,
                          env=os.environ | {"PYTHONPATH": str(copy.folder)})
    printed = done.stdout + done.stderr
    good = done.returncode == 1 and bool(errors(printed)) and TRACE not in printed
    bench.tell("no OpenGL in the middle of a run", good, (errors(printed) or [printed[-300:]])[0])
    code, _ = copy.run("all")
    bench.tell("the same run with OpenGL again", code == 0 and bench.same(copy), f"code {code}, same files")


def folder(bench: Bench) -> None:
    """A folder whose name has spaces, letters of other languages and signs of the shell."""
    copy = bench.copy("Ölauge – 眼 $HOME 'a' (1) & more", finished=False)
    code, printed = copy.run("all")
    bench.tell("spaces, unicode and signs in the folder's name", code == 0 and bench.same(copy),
               f"code {code}" + ("" if code == 0 else f", {(errors(printed) or [printed[-500:]])[0]}"))


def home(bench: Bench) -> None:
    """A home that is not there or cannot be written, with the cache that `./run` and `eye-oil` then choose."""
    copy = bench.copy("home")
    with_run = f"source <(sed -n '/^find_cache()/,/^}}/p' {ROOT / 'run'}); find_cache; exec \"$@\""
    starts = {"./run": ["bash", "-c", with_run, "run", sys.executable, "-m", "snakemake"],
              "eye-oil": [sys.executable, "-m", "pipeline.workflow.command"]}
    (bench.work / "locked").mkdir(exist_ok=True)
    os.chmod(bench.work, 0o755)
    for name, start in ((name, start) for name in ("/nonexistent", str(bench.work / "locked")) for start in starts):
        for path in (copy.outputs / "metrics.csv", copy.outputs / "movie.mp4"):
            path.unlink(missing_ok=True)
        os.chmod(bench.work / "locked", 0o555)
        user = as_user(copy, 54321)
        done = subprocess.run([*user, *starts[start], f"-j{bench.cores}", "all", "--config", f"scenes=[{SCENE}]"],
                              cwd=copy.folder, capture_output=True, text=True,
                              env={"PATH": os.environ["PATH"], "HOME": name, "PYTHONPATH": str(copy.folder)})
        printed = done.stdout + done.stderr
        good = TRACE not in printed and done.returncode == 0 and bench.same(copy)
        bench.tell(f"{start} with the home {name}, which cannot be written", good,
                   f"code {done.returncode}" + ("" if good else f", {printed[-600:]}"))


def as_user(copy: Copy, number: int) -> list[str]:
    """Give a copy to a user without a name, and return what runs a command as that user."""
    subprocess.run(["chown", "-R", "--no-dereference", str(number), copy.folder], check=True)
    return ["setpriv", f"--reuid={number}", "--clear-groups", "--inh-caps=-all"]


def users(bench: Bench) -> None:
    """A second user in the checkout of a first one."""
    copy = bench.copy("users")
    os.chmod(bench.work, 0o755)
    as_user(copy, 54321)
    (copy.outputs / "metrics.csv").unlink()
    command = ["-m", "snakemake", f"-j{bench.cores}", "all", "--config", f"scenes=[{SCENE}]"]
    environment = {"PATH": os.environ["PATH"], "HOME": "/tmp", "USER": "other", "PYTHONPATH": str(copy.folder)}
    done = subprocess.run(["setpriv", "--reuid=54322", "--clear-groups", "--inh-caps=-all", sys.executable, *command],
                          cwd=copy.folder, capture_output=True, text=True, env=environment)
    printed = done.stdout + done.stderr
    good = done.returncode == 2 and len(errors(printed)) == 1 and TRACE not in printed
    bench.tell("a second user who may not write", good, (errors(printed) or [printed[-600:]])[0])
    subprocess.run(["chmod", "-R", "a+rwX", copy.folder / "outputs", copy.folder / ".snakemake"], check=True)
    done = subprocess.run(["setpriv", "--reuid=54322", "--clear-groups", "--inh-caps=-all", sys.executable, *command],
                          cwd=copy.folder, capture_output=True, text=True, env=environment)
    printed = done.stdout + done.stderr
    bench.tell("a second user who may write", done.returncode == 0 and bench.same(copy),
               f"code {done.returncode}" + ("" if done.returncode == 0 else f", {printed[-600:]}"))


def locks(bench: Bench) -> None:
    """A disk on which no file can be locked."""
    copy = bench.copy("locks")
    source, library = bench.work / "locks.c", bench.work / "locks.so"
    source.write_text(NO_LOCKS)
    subprocess.run(["gcc", "-shared", "-fPIC", "-o", library, source], check=True)
    (copy.outputs / "metrics.csv").unlink()
    code, printed = copy.run("all", LD_PRELOAD=str(library))
    good = code == 0 and "this disk has no locks" in printed and bench.same(copy)
    bench.tell("a disk without locks", good, f"code {code}, the run is warned" if good else printed[-500:])


def clock(bench: Bench) -> None:
    """A clock that was a year ahead while half of the run was made, and one that was a year behind."""
    for what, shift in (("ahead", 365 * 86400.0), ("behind", -365 * 86400.0)):
        copy = bench.copy(f"clock_{what}")
        for path in copy.outputs.rglob("*"):
            if path.is_file() and path.relative_to(copy.outputs).parts[0] in ("eye.vtp", "initial.npz", "checkpoints"):
                os.utime(path, (path.stat().st_atime, path.stat().st_mtime + shift))
        runs = 0
        while runs < 4:
            code, printed = copy.run("all")
            runs += 1
            if code or "Nothing to be done" in printed:
                break
        good = code == 0 and "Nothing to be done" in printed and bench.same(copy)
        bench.tell(f"results dated a year {what}", good,
                   f"nothing to be done in run {runs}" if good else printed[-500:])


TRIALS = {trial.__name__: trial for trial in (disk, memory, killed, opengl, folder, home, users, locks, clock)}


def main() -> int:
    """Run the trials."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("trials", nargs="*", metavar="TRIAL", help=f"which of {', '.join(TRIALS)} (default: all)")
    parser.add_argument("--cores", type=int, default=2, help="of every run (default 2)")
    parser.add_argument("--stages", nargs="+", default=[], help="of the trials of disk and memory (default: all)")
    parser.add_argument("--reference", type=Path, help="copy of the project with an unbroken run (made where missing)")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="surroundings_") as work:
        reference = Copy((options.reference or Path(work) / "unbroken").resolve(), options.cores)
        code, printed = reference.run()
        if code:
            print(printed)
            return code
        bench = Bench(reference, Path(work), options.cores, options.stages)
        for name in options.trials or TRIALS:
            TRIALS[name](bench)
    return int(bench.failed > 0)


if __name__ == "__main__":
    sys.exit(main())
