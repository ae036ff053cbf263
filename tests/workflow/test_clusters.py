"""Jobs on other computers: what they ask for, the profiles, and what a submitting computer does not decide for them."""
import importlib.util
import json
import os
import subprocess
import sys
from types import SimpleNamespace

import pytest
import yaml
from conftest import ROOT
from snakemake.cli import get_argument_parser

from pipeline.scenes.load import load_scene
from pipeline.scenes.volume import liquid_volume
from pipeline.workflow import scenes as workflow
from pipeline.workflow.memory import memory_of_stage
from sim.cores import available_cores
from sim.memory import needed_bytes

PROFILES = sorted(path.name for path in (ROOT / "profiles").iterdir())
SOLVING = ("voxelize", "estimate", "simulate", "reconstruct")


def resources(project, *arguments: str) -> dict[str, dict]:
    """Return what the jobs of a plan ask for, by rule."""
    done = subprocess.run([sys.executable, ROOT / "tests/workflow/planned_resources.py", *arguments],
                          cwd=project.folder, env=os.environ | {"PYTHONPATH": str(project.folder)}, text=True,
                          capture_output=True)
    plan = [line for line in done.stdout.splitlines() if line.startswith("PLAN ")]
    assert plan, done.stdout + done.stderr
    return json.loads(plan[0].removeprefix("PLAN "))


@pytest.mark.thorough
def test_jobs_ask_for_threads_memory_and_a_gpu(project):
    project.write_scene("greedy", "extends: tiny\nnumerics: {threads: 32, device: cuda}\n")  # more than there are here
    asked = resources(project, "greedy", "48") | resources(project, "outputs/greedy/draft/estimate.html", "48")
    assert {rule: asked[rule]["_cores"] for rule in SOLVING} == {
        "voxelize": 32, "simulate": 32, "estimate": 32, "reconstruct": 1}
    assert {rule for rule, one in asked.items() if one["gpu"]} == set(SOLVING)
    assert all(asked[rule]["mem_mb"] >= 1000 for rule in (*SOLVING, "render", "still", "metrics", "page"))
    assert asked["render"]["mem_mb"] > asked["simulate"]["mem_mb"]


@pytest.mark.thorough
def test_cases_of_a_study_ask_for_a_gpu_where_one_is_chosen(project):
    (project.folder / "config/studies/small.yaml").write_text(
        "cases: {taylor_green: {reynolds: [5, 10], resolutions: [8]}}\n")
    assert resources(project, "small", "8", "device=cuda")["study_case"] == {"_cores": 4, "mem_mb": 2000, "gpu": 1}


def test_memory_is_that_of_the_solver_and_doubles_when_a_job_is_tried_again(monkeypatch):
    monkeypatch.chdir(ROOT)
    flow = workflow.Workflow({"scenes": ["tiny"], "accuracy": "draft"}, elsewhere=True)
    asked = flow.memory("simulate")
    one = SimpleNamespace(scene="tamponade", level="standard")
    assert asked(one, attempt=2) == 2 * asked(one, attempt=1)
    for level, measured in (("draft", 405), ("standard", 860), ("fine", 2200)):  # MB, docs/results/costs.md
        scene = load_scene(ROOT / "config/scenes/tamponade.yaml", level)
        particles = liquid_volume(scene) / scene.numerics.particle_spacing**3
        assert memory_of_stage("simulate", scene) >= max(measured, needed_bytes(scene.settings(), particles) / 1e6)


@pytest.mark.parametrize("text", [
    "extends: tiny\neye: {model: mesh, path: ../eye.stl}\n",
    "extends: pbf_dam\n",
])
def test_memory_is_known_before_the_cavity_is_made(project, text):
    (project.folder / "config/eye.stl").touch()
    project.write_scene("other", text)
    scene = load_scene(project.folder / "config/scenes/other.yaml", "draft")
    volume = liquid_volume(scene)
    assert volume == (12e-6 if scene.container is None else pytest.approx(sum(block.volume for block in scene.blocks)))


def test_submitting_computer_does_not_decide_on_threads_and_devices(project, monkeypatch):
    monkeypatch.chdir(project.folder)
    project.write_scene("greedy", f"extends: tiny\nnumerics: {{threads: {available_cores() + 1}, device: cuda}}\n")
    with pytest.raises(SystemExit):
        workflow.Workflow({"scenes": ["tiny"], "accuracy": "draft"}).scene("greedy", "draft")
    flow = workflow.Workflow({"scenes": ["tiny"], "accuracy": "draft", "device": "cuda"}, elsewhere=True)
    assert flow.threads("greedy", "draft", 64) == available_cores() + 1


@pytest.mark.parametrize("name", PROFILES)
def test_profile_has_options_of_snakemake_only(name):
    """Those of an executor are known where it is installed."""
    profile = yaml.safe_load((ROOT / "profiles" / name / "config.yaml").read_text())
    executor = profile.get("executor")
    options = set(get_argument_parser()._option_string_actions)
    unknown = {key for key in profile if f"--{key}" not in options}
    if executor and importlib.util.find_spec(f"snakemake_executor_plugin_{executor}") is None:
        unknown = {key for key in unknown if not key.startswith(f"{executor}-")}
    assert not unknown
    assert (executor is None) == ("max-threads" not in profile)  # by which the pipeline knows of other computers
