"""Snakemake through a real SLURM, which the test starts on this computer with a configuration of its own, and stops.

`./run test -m slow tests/workflow/test_slurm.py`; needs the Debian packages `slurm-wlm` and `munge`, and the extra
`slurm` of this project. It takes some minutes.
"""
import contextlib
import importlib.util
import os
import shutil
import signal
import socket
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

from pipeline.base.frame_files import find_frames, read_frame

DAEMONS = ("munged", "slurmctld", "slurmd")
COMMANDS = ("sbatch", "squeue", "scontrol", "sinfo", "srun")
PATH = os.pathsep.join([os.environ["PATH"], "/usr/sbin", "/sbin"])
LONGEST = 3000  # s, of the whole run
CONFIGURATION = """
ClusterName=test
SlurmctldHost={host}
SlurmctldPort={controller}
SlurmdPort={node}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
CredType=cred/munge
SlurmUser={user}
SlurmdUser={user}
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/none
MinJobAge=3600
KillWait=5
ReturnToService=2
NodeName={host} CPUs={cores} RealMemory={memory}
PartitionName=main Nodes=ALL Default=YES State=UP
"""


def missing() -> str:
    """Why there can be no SLURM here, empty where there can."""
    programs = [name for name in (*DAEMONS, *COMMANDS) if not shutil.which(name, path=PATH)]
    if programs:
        return f"there is no {', '.join(programs)}: install slurm-wlm and munge"
    if importlib.util.find_spec("snakemake_executor_plugin_slurm") is None:
        return "there is no snakemake-executor-plugin-slurm: pip install -r requirements-clusters.txt"
    return "" if os.geteuid() == 0 else "only root may start jobs of other users, which slurmd and munged insist on"


class Cluster:
    """A SLURM of one node, this computer."""

    def __init__(self, folder: Path):
        self.folder, self.host, self.running = folder, socket.gethostname().partition(".")[0], []
        for name in ("state", "spool", "bin"):
            (folder / name).mkdir()
        (folder / "munge.key").write_bytes(os.urandom(128))
        (folder / "munge.key").chmod(0o400)
        # A folder of its own keeps the path of the socket short, as the kernel asks for.
        (folder / "slurm.conf").write_text(CONFIGURATION.format(
            folder=folder, host=self.host, user=os.environ.get("USER", "root"), controller=free_port(),
            node=free_port(), cores=len(os.sched_getaffinity(0)),
            memory=os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2**20 * 3 // 4))
        self.environment = os.environ | {"SLURM_CONF": str(folder / "slurm.conf"), "PATH": f"{folder}/bin:{PATH}"}
        # Inside a job the executor removes all variables of SLURM, for clusters have their configuration in /etc.
        srun = folder / "bin" / "srun"
        srun.write_text(f'#!/bin/sh\nSLURM_CONF={folder}/slurm.conf exec {shutil.which("srun", path=PATH)} "$@"\n')
        srun.chmod(0o755)

    def start(self) -> None:
        """Start the daemons, and wait until the node can be used."""
        files = {"socket": "munge.socket", "key-file": "munge.key", "pid-file": "munged.pid", "seed-file": "munge.seed",
                 "log-file": "munge.log"}
        self._daemon("munged", "--foreground", "--force",
                     *(f"--{option}={self.folder / name}" for option, name in files.items()))
        wait_for((self.folder / "munge.socket").exists)
        for name in ("slurmctld", "slurmd"):
            self._daemon(name, "-D", "-f", str(self.folder / "slurm.conf"))
        wait_for(lambda: self.asked("sinfo", "-h", "-o", "%T", fails="") == "idle")

    def _daemon(self, name: str, *arguments: str) -> None:
        with (self.folder / f"{name}.out").open("w") as log:
            self.running.append(subprocess.Popen([shutil.which(name, path=PATH), *arguments], stdin=subprocess.DEVNULL,
                                                 stdout=log, stderr=log, env=self.environment))

    def stop(self) -> None:
        """Cancel what runs, and end the daemons."""
        self.asked("scancel", "--full", "--signal=KILL", "--partition=main", fails="")
        for process in reversed(self.running):
            process.terminate()
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def asked(self, *command: str, fails: str | None = None) -> str:
        """Return what a command of SLURM prints, or `fails` where it fails."""
        done = subprocess.run(command, env=self.environment, capture_output=True, text=True)
        if done.returncode and fails is None:
            raise AssertionError(f"{' '.join(command)}: {done.stderr}")
        return fails if done.returncode else done.stdout.strip()

    def jobs(self, rule: str, state: str) -> list[str]:
        """Return the numbers of the jobs of a rule in a state."""
        lines = [line.split("|") for line in self.asked("squeue", "-h", "--states=all", "-o", "%i|%T|%k").splitlines()]
        return [number for number, found, comment in lines if found == state and comment.startswith(f"rule_{rule}_")]


def free_port() -> int:
    """Return a port that nobody listens on."""
    with socket.socket() as one:
        one.bind(("", 0))
        return one.getsockname()[1]


def wait_for(condition, timeout: float = 900.0, run: subprocess.Popen | None = None, every: float = 0.5):
    """Wait until a condition is true, and return what it returns; no longer than a run lasts."""
    end = time.monotonic() + timeout
    while not (found := condition()):
        assert time.monotonic() < end, "waited too long"
        assert run is None or run.poll() is None, "the run has ended"
        time.sleep(every)
    return found


def processes_of(stage: str, folder: Path) -> list[int]:
    """Return the processes of a stage that work in a folder."""
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            if (path / "cwd").resolve() == folder and f"pipeline.{stage}".encode() in (
                    path / "cmdline").read_bytes().split(b"\0"):
                found.append(int(path.name))
        except OSError:
            continue
    return found


@pytest.fixture
def cluster(tmp_path_factory):
    """Return a running SLURM."""
    if reason := missing():
        pytest.skip(reason)
    one = Cluster(tmp_path_factory.mktemp("slurm"))
    try:
        one.start()
        yield one
    finally:
        one.stop()


@pytest.mark.slow
def test_all_runs_on_a_cluster_whatever_happens_to_its_jobs_and_its_node(cluster, project, opengl):
    said = []

    def say(text: str) -> None:
        said.append(f"{time.strftime('%H:%M:%S')} {text}")

    arguments = ["all", "--config", "scenes=[tiny]"]
    run = project.start("--profile", "profiles/slurm", "--max-threads", str(len(os.sched_getaffinity(0))), *arguments,
                        "--slurm-status-command", "squeue",  # there is no database for sacct
                        "--seconds-between-status-checks", "2", "--slurm-init-seconds-before-status-checks", "2",
                        environment=cluster.environment)
    try:
        # The node is taken out of service before the cavity is filled: the job waits for it.
        wait_for(lambda: cluster.jobs("eye", "RUNNING"), run=run)
        cluster.asked("scontrol", "update", f"NodeName={cluster.host}", "State=DRAIN", "Reason=test")
        say("node drained while rule eye runs")
        waiting = wait_for(lambda: cluster.jobs("voxelize", "PENDING"), run=run)[0]
        time.sleep(10)
        assert cluster.jobs("voxelize", "PENDING") == [waiting] and not cluster.jobs("voxelize", "RUNNING")
        say(f"job {waiting} (voxelize) waits: " + cluster.asked("squeue", "-h", "-j", waiting, "-o", "%r"))
        cluster.asked("scontrol", "update", f"NodeName={cluster.host}", "State=RESUME")
        say("node back")

        # SLURM ends the first segment and queues it again.
        first = wait_for(lambda: processes_of("simulate", project.folder) and cluster.jobs("simulate", "RUNNING"),
                         run=run)[0]
        cluster.asked("scontrol", "requeue", first)
        wait_for(lambda: not processes_of("simulate", project.folder), run=run)
        say(f"job {first} (simulate) killed and queued again by SLURM")
        cluster.asked("scontrol", "update", f"JobId={first}", "StartTime=now")  # it would wait two minutes
        wait_for(lambda: first in cluster.jobs("simulate", "COMPLETED"), run=run)
        assert "Restarts=1" in cluster.asked("scontrol", "show", "job", first)
        say(f"job {first} (simulate) completed")

        # The second is killed as a kernel without memory does it: Snakemake submits another one.
        second = wait_for(lambda: processes_of("simulate", project.folder) and cluster.jobs("simulate", "RUNNING"),
                          run=run)[0]
        for process in processes_of("simulate", project.folder):
            with contextlib.suppress(ProcessLookupError):  # it has ended in the meantime
                os.kill(process, signal.SIGKILL)
        wait_for(lambda: second in cluster.jobs("simulate", "FAILED"), run=run)
        say(f"job {second} (simulate) killed with -9")
        third = wait_for(lambda: set(cluster.jobs("simulate", "COMPLETED")) - {first}, run=run).pop()
        say(f"job {third} (simulate) completed in its place")
        assert run.wait(LONGEST) == 0, (project.folder / "snakemake.log").read_text()
        say("run ended well")
    finally:
        if run.poll() is None:
            os.killpg(run.pid, signal.SIGKILL)
        kept = os.environ.get("SLURM_LOG")  # where a log is to be kept
        if kept:
            Path(kept).write_text("\n".join([
                *said, "", (project.folder / "snakemake.log").read_text(), cluster.asked(
                    "squeue", "-h", "--states=all", "-S", "i", "-o", "%i %T %C cores %m MB %l %k", fails="")]))
    made = project.outputs("tiny")
    assert all((made / name).exists() for name in ("index.html", "movie.mp4", "metrics.csv", "run.pvd", "cost.html"))

    # The same scene on this computer alone has the same particles.
    alone = type(project)(cluster.folder / "alone")
    code, output = alone.snakemake(*[f"outputs/tiny/draft/frames/segment_{number:03d}" for number in (0, 1)])
    assert code == 0, output
    for number in (0, 1):
        for path in find_frames(made / "frames" / f"segment_{number:03d}"):
            other = alone.outputs("tiny") / "frames" / f"segment_{number:03d}" / path.name
            assert np.array_equal(read_frame(path).position, read_frame(other).position), path.name
