"""Settings of a user for other programs neither break a stage nor change what it makes."""
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT

from pipeline.base.surroundings import behind_installed

PLOT = """
import sys
from pipeline.base.canvas import empty_figure
canvas = empty_figure((3, 2))
axes = canvas.subplots()
axes.plot([0, 1], [1, 2], label="oil")
axes.set_xlabel("time [s]")
canvas.legend()
canvas.savefig(sys.argv[1], format="png")
"""
SETTINGS = "text.usetex: True\nfont.size: 30\nfigure.dpi: 300\naxes.facecolor: black\nbackend: Qt4Agg\nno.such.key: 1\n"


def stage(*arguments, folder=ROOT, **environment) -> subprocess.CompletedProcess:
    path = os.pathsep.join([str(ROOT), *filter(None, [environment.pop("PYTHONPATH", "")])])
    if environment.pop("foreign_first", False):
        path = os.pathsep.join(reversed(path.split(os.pathsep)))
    return subprocess.run([sys.executable, *map(str, arguments)], cwd=folder, capture_output=True, text=True,
                          env=os.environ | {"PYTHONPATH": path} | environment)


def test_matplotlibrc_changes_no_plot(tmp_path):
    """In the folder of the run, and in that of the settings."""
    (tmp_path / "home").mkdir()
    made = []
    for name, text in (("without", None), ("with", SETTINGS)):
        if text:
            (tmp_path / "matplotlibrc").write_text(text)
            (tmp_path / "home/matplotlibrc").write_text(text)
        done = stage("-c", PLOT, tmp_path / f"{name}.png", folder=tmp_path, MPLCONFIGDIR=str(tmp_path / "home"))
        assert done.returncode == 0 and not done.stderr, done.stderr
        made.append((tmp_path / f"{name}.png").read_bytes())
    assert made[0] == made[1]


@pytest.mark.parametrize("backend", ["Qt4Agg", "nonsense", "TkAgg"])
def test_the_backend_of_a_user_ends_no_stage(backend):
    done = stage("-m", "pipeline.eye", "--help", MPLBACKEND=backend)
    assert done.returncode == 0 and not done.stderr, done.stderr


def test_warnings_of_libraries_are_no_errors():
    done = stage("-m", "pipeline.scene", "tiny", "--check", PYTHONWARNINGS="error")
    assert done.returncode == 0 and not done.stderr, done.stderr


def test_no_home_is_that_of_the_account():
    """Taichi ended the process, without a word that helps."""
    done = subprocess.run(["env", "-u", "HOME", sys.executable, "-m", "pipeline.metrics", "--list"], cwd=ROOT,
                          capture_output=True, text=True)
    assert done.returncode == 0 and "time [s]: " in done.stdout, done.stderr


@pytest.mark.parametrize(("name", "code"), [("tiny", 0), ("nowhere", 2)])
def test_a_closed_output_ends_no_stage(name, code):
    done = subprocess.run(["bash", "-c", f'"{sys.executable}" -m pipeline.scene {name} --check >&-'], cwd=ROOT,
                          capture_output=True, text=True)
    assert done.returncode == code and "Traceback" not in done.stderr
    assert ("no such file" in done.stderr) == (code == 2)


def test_packages_of_pythonpath_take_the_place_of_no_installed_ones(tmp_path):
    """As modules of clusters do, with another NumPy, YAML or Matplotlib."""
    for package in ("numpy", "yaml", "matplotlib", "pyvista"):
        (tmp_path / package).mkdir()
        (tmp_path / package / "__init__.py").write_text("raise ImportError('of another Python')\n")
    done = stage("-m", "pipeline.scene", "tiny", "--check", PYTHONPATH=str(tmp_path), foreign_first=True)
    assert done.returncode == 0 and not done.stderr, done.stderr


def test_folders_of_pythonpath_are_still_found():
    installed = Path("/env/site-packages")
    path = ["", "/module", str(ROOT), "/usr/lib/python3", str(installed), "/env/more"]
    assert behind_installed(path, [Path("/module"), ROOT], installed) == [
        "", str(ROOT), "/usr/lib/python3", str(installed), "/module", "/env/more"]
    assert behind_installed(["/module", "/usr/lib"], [Path("/module")], installed) == ["/module", "/usr/lib"]


def test_cdpath_leads_run_nowhere_else(tmp_path):
    (tmp_path / "elsewhere" / "project").mkdir(parents=True)
    done = subprocess.run(["bash", f"{ROOT.name}/run", "--help"], cwd=ROOT.parent, capture_output=True, text=True,
                          env=os.environ | {"CDPATH": str(tmp_path / "elsewhere")})
    assert done.returncode == 0 and done.stdout.startswith("usage: ./run"), done.stdout + done.stderr


@pytest.mark.parametrize("locale", ["de_DE.ISO-8859-1", "C", "tr_TR.UTF-8"])
def test_the_locale_changes_no_scene(locale):
    done = [stage("-m", "pipeline.scene", "tiny", "--accuracy", "draft", LC_ALL=one, LANG=one)
            for one in ("C.UTF-8", locale)]
    assert [one.returncode for one in done] == [0, 0] and done[0].stdout == done[1].stdout


def test_plots_have_one_owner():
    """Nothing but pipeline/base/canvas.py makes a figure of Matplotlib, whose settings are a user's elsewhere."""
    found = [path.name for room in ("pipeline", "studies") for path in (ROOT / room).rglob("*.py")
             if re.search(r"matplotlib\.figure import|FigureCanvas|pyplot", path.read_text())]
    assert found == ["canvas.py"]
