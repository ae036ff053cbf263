"""Threads: the cores that can be used, what every job is given and told, and numbers that are refused."""
import math
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT
from helpers import forked

from pipeline.base import threads
from pipeline.base.errors import UserError
from pipeline.scenes import threads as scene_threads
from pipeline.scenes.load import load_scene
from pipeline.workflow import scenes as workflow
from pipeline.workflow import studies as study_workflow
from sim import cores

TOO_MANY = cores.available_cores() + 1


# The cores of this process

@pytest.mark.parametrize(("files", "expected"), [
    ({}, math.inf),
    ({"proc/self/cgroup": "0::/\n"}, math.inf),
    ({"proc/self/cgroup": "0::/\n", "sys/fs/cgroup/cpu.max": "max 100000\n"}, math.inf),
    ({"proc/self/cgroup": "0::/\n", "sys/fs/cgroup/cpu.max": "150000 100000\n"}, 1.5),
    ({"proc/self/cgroup": "0::/a/b\n", "sys/fs/cgroup/a/b/cpu.max": "400000 100000", "sys/fs/cgroup/a/cpu.max": "2 1"},
     2.0),
    ({"proc/self/cgroup": "5:memory:/x\n1:cpu,cpuacct:/x\n0::/\n", "sys/fs/cgroup/cpu/cpu.cfs_quota_us": "300000\n",
      "sys/fs/cgroup/cpu/cpu.cfs_period_us": "100000\n"}, 3.0),
    ({"proc/self/cgroup": "1:cpu:/\n", "sys/fs/cgroup/cpu/cpu.cfs_quota_us": "-1\n",
      "sys/fs/cgroup/cpu/cpu.cfs_period_us": "100000\n"}, math.inf),
    ({"proc/self/cgroup": "0::/\n", "sys/fs/cgroup/cpu.max": "damaged\n"}, math.inf),
])
def test_quota_of_a_container_is_read(tmp_path, files, expected):
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    assert cores.granted_cores(tmp_path) == expected


@pytest.mark.parametrize(("bound", "granted", "available", "useful"), [
    (8, math.inf, 8, 8), (8, 1.5, 2, 2), (8, 0.2, 1, 1), (2, 12.0, 2, 2), (64, math.inf, 64, cores.USEFUL_THREADS)])
def test_cores_are_those_of_the_affinity_and_of_the_quota(monkeypatch, bound, granted, available, useful):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(bound)))
    monkeypatch.setattr(cores, "granted_cores", lambda: granted)
    assert (cores.available_cores(), cores.useful_threads()) == (available, useful)


@pytest.mark.thorough
def test_zero_threads_keep_those_that_run():
    code = ("from sim.backend.runtime import initialize\ninitialize('f32', 1)\ninitialize('f32')\n"
            "try:\n    initialize('f32', 2)\nexcept RuntimeError as error:\n    print(error)")
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "a process of its own" in done.stdout


WHO_WORKS = """
import contextlib
import os
from sim.backend.runtime import initialize
initialize("f32", {threads})
from sim.backend import ti

def seconds():
    found = {{}}
    for t in os.listdir("/proc/self/task"):
        with contextlib.suppress(FileNotFoundError):  # one that only started Taichi may end meanwhile
            found[t] = int(open(f"/proc/self/task/{{t}}/schedstat").read().split()[0])
    return found

x = ti.field(ti.f32, 200000)

@ti.kernel
def work():
    for i in x:
        for k in range(300):
            x[i] += ti.sqrt(ti.cast(k + i, ti.f32))

work()
before = seconds()
work()
worked = [t for t, s in seconds().items() if s - before.get(t, 0) > 2e6 and int(t) != os.getpid()]
print(sorted(len(os.sched_getaffinity(int(t))) for t in worked), len(os.sched_getaffinity(0)))
"""


def who_works(folder: Path, threads: int) -> tuple[list[int], int]:
    """Return the number of cores that every worker of that many threads may use, and that of the main thread."""
    script = folder / "who.py"  # Taichi wants to read the kernel's source
    script.write_text(WHO_WORKS.format(threads=threads))
    done = subprocess.run([sys.executable, script], cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)},
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    workers, main = done.stdout.splitlines()[-1].rsplit(maxsplit=1)
    return [int(n) for n in workers.strip("[]").split(",")], int(main)


@pytest.mark.thorough
def test_every_worker_has_a_core_of_its_own_where_they_take_all(tmp_path):
    """And the main thread, whose children do other things, has all of them still."""
    every = len(os.sched_getaffinity(0))
    workers, main = who_works(tmp_path, every)
    assert set(workers) == {1} and main == every
    if every > 1:  # cores are left to others: the system places the workers
        workers, main = who_works(tmp_path, every - 1)
        assert set(workers) == {every} and main == every


KEEP = """
import os, sys
from pathlib import Path
from sim.cores import keep_to_one_core
print(keep_to_one_core(Path(sys.argv[1])), len(os.sched_getaffinity(0)), flush=True)
input()
"""


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="this system does not bind processes to cores")
def test_processes_keep_to_different_cores_until_all_are_taken(tmp_path):
    def process():
        return subprocess.Popen([sys.executable, "-c", KEEP, tmp_path], cwd=ROOT, text=True, stdin=subprocess.PIPE,
                                stdout=subprocess.PIPE)

    every = os.sched_getaffinity(0)
    keeping = [process() for _ in every]
    held = [one.stdout.readline().split() for one in keeping]
    assert {int(core) for core, _ in held} == every and {bound for _, bound in held} == {"1"}
    late = process()
    assert late.communicate("\n")[0].split() == ["None", str(len(every))]
    keeping[0].communicate("\n")  # ends, and its core is free again
    late = process()
    assert late.communicate("\n")[0].split() == [held[0][0], "1"]
    for one in keeping[1:]:
        one.communicate("\n")


def test_libraries_get_the_threads_of_the_job(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    assert threads.library_threads() == 3
    for text in ("", "0", "4,2"):
        monkeypatch.setenv("OMP_NUM_THREADS", text)
        assert threads.library_threads() == cores.available_cores()


# What users ask for

@pytest.mark.parametrize(("asked", "where"), [(TOO_MANY, "--threads"), (-1, "scene.json: numerics.threads")])
def test_threads_beyond_the_cores_are_refused(asked, where):
    with pytest.raises(UserError) as caught:
        threads.checked_threads(asked, where)
    assert str(caught.value) == (f"{where} is {asked}, but must be at least 0 (as many as are useful) and at most "
                                 f"{cores.available_cores()}, the cores that can be used here")


@pytest.mark.thorough
@pytest.mark.parametrize("stage", [
    ["simulate", "scene.json", "initial.npz", "--frames", "frames", "--checkpoint", "end.npz"],
    ["voxelize", "scene.json", "eye.vtp", "--output", "initial.npz", "--report", "voxelize.json"],
    ["reconstruct", "scene.json", "initial.npz", "frames", "--output", "surfaces"],
    ["study", "validation", "--case", "dam_break"],
])
def test_stages_refuse_threads_beyond_the_cores_before_all_else(tmp_path, stage):
    (tmp_path / "scene.json").write_text(load_scene(ROOT / "config/scenes/tiny.yaml", "draft").to_json())
    folder = ROOT if stage[0] == "study" else tmp_path
    done = forked.run(f"pipeline.{stage[0]}", *stage[1:], "--threads", TOO_MANY, folder=folder)
    assert done.returncode == 2
    assert done.stderr.startswith(f"error: --threads is {TOO_MANY}, but must be") and done.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["scene.json"]


# Snakemake

@pytest.fixture
def flow(project, monkeypatch, nothing_planned):
    """Return the workflow of a project on a computer with 64 cores."""
    monkeypatch.chdir(project.folder)
    for module in (study_workflow, scene_threads, threads):
        monkeypatch.setattr(module, "available_cores", lambda: 64)
    project.write_scene("four", "extends: tiny\nnumerics: {threads: 4}\n")
    return workflow.Workflow({"scenes": ["tiny"], "accuracy": "draft"})


@pytest.mark.parametrize(("given", "open_number", "four"), [
    (1, 1, 1), (2, 2, 2), (3, 2, 3), (8, 7, 4), (17, 16, 4), (64, 16, 4), (1000, 16, 4)])
def test_simulation_leaves_a_core_for_drawing_where_there_are_three(flow, given, open_number, four):
    assert flow.threads("tamponade", "standard", given) == open_number
    assert flow.threads("four", "draft", given) == four


def test_a_small_simulation_takes_no_more_threads_than_pay(flow, project):
    """One for every 4,000 particles, of 64 cores: 5,100 make one, 24,000 six."""
    project.write_scene("between", "extends: tamponade\nnumerics: {particle_spacing: 0.595 mm}\n")
    assert flow.threads("tamponade", "draft", 64) == 1
    assert flow.threads("between", "draft", 64) == 6


def test_cases_of_a_study_share_the_cores(flow, project):
    (project.folder / "config/studies/small.yaml").write_text(
        "cases: {taylor_green: {reynolds: [5, 10], resolutions: [8]}, determinism: {scheme: wcsph},\n"
        "        oil_shape: {scenes: [tiny], liquids: [silicone_oil_1000]}}\n")
    studies = study_workflow.Studies(flow)
    given = {case: [studies.threads("small", "draft", case, number) for number in (1, 2, 9, 64)]
             for case in studies.study("small", "draft").cases}
    assert given == {"taylor_green-5": [1, 1, 3, 16], "taylor_green-10": [1, 1, 3, 16], "determinism": [1, 2, 3, 16],
                     "oil_shape": [1, 1, 1, 1]}


@pytest.mark.thorough
@pytest.mark.parametrize("jobs", [1, 2])
def test_solver_is_told_the_threads_that_snakemake_counts(project, jobs):
    """A dry run takes no notice of -j."""
    code, output = project.snakemake("-n", "-p", "--cores", str(jobs), "outputs/tamponade/standard/movie.mp4")
    assert code == 0, output
    told = dict.fromkeys(("voxelize", "simulate", "reconstruct"))
    for stage in told:
        told[stage] = {int(number) for number in re.findall(rf"pipeline\.{stage} .* --threads (\d+)", output)}
    solver = {min(jobs, cores.available_cores())}
    assert told == {"voxelize": solver, "simulate": solver, "reconstruct": {1}}


@pytest.mark.thorough
def test_scene_with_threads_beyond_the_cores_is_not_begun(project):
    project.write_scene("greedy", f"extends: tiny\nnumerics: {{threads: {TOO_MANY}}}\n")
    code, output = project.snakemake("outputs/greedy/draft/movie.mp4")
    assert code == 2 and "Traceback" not in output
    assert f"error: config/scenes/greedy.yaml: numerics.threads is {TOO_MANY}, but must be at least 0" in output
    assert not project.outputs("greedy").exists()
