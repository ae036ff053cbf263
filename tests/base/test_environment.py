"""What is installed: one lock file for all Pythons, what it must hold, and what is said of the packages."""
import itertools
import os
import re
import subprocess
import sys
import tomllib

import pytest
from conftest import ROOT
from helpers.cases import thorough
from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from pipeline import software
from pipeline.base.packages import Package, packages, packages_digest
from pipeline.web.scripts import LIBRARIES, VENDOR

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
PYTHONS = [line.rpartition(" ")[2] for line in PROJECT["classifiers"] if "Python :: 3." in line]
ENTRY = re.compile(r"^(?P<requirement>[^\s#][^\\]*?)(?: \\\n    --hash=sha256:[0-9a-f]{64})+$", re.MULTILINE)


def locked(python: str) -> dict[str, str]:
    """Return name -> version of what the lock file installs on a Python under Linux."""
    environment = default_environment() | {"python_version": python, "python_full_version": f"{python}.0"}
    found = [Requirement(match["requirement"]) for match in ENTRY.finditer((ROOT / "requirements.txt").read_text())]
    return {canonicalize_name(one.name): str(one.specifier).removeprefix("==") for one in found
            if one.marker is None or one.marker.evaluate(environment)}


def test_every_line_of_the_lock_file_is_an_exact_version_with_hashes():
    text = (ROOT / "requirements.txt").read_text()
    names = re.findall(r"^([A-Za-z0-9][\w.-]*)==", text, re.MULTILINE)
    assert len(names) == len(set(names)) == len(ENTRY.findall(text)) > 50
    left = ENTRY.sub("", text)
    assert not [line for line in left.splitlines() if line.strip() and not line.strip().startswith("#")]


@pytest.mark.parametrize("python", PYTHONS)
def test_lock_file_holds_what_the_project_asks_for(python):
    versions = locked(python)
    asked = [Requirement(one) for one in (*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["test"])]
    missing = [str(one) for one in asked if not one.specifier.contains(versions.get(canonicalize_name(one.name), "0"))]
    assert missing == []


def test_every_package_is_told_of():
    """What for, by whom, with what license and what instead."""
    rows = [line.strip("| ").split(" | ") for line in (ROOT / "docs" / "dependencies.md").read_text().splitlines()
            if re.match(r"\| (?!package)[a-z0-9-]+ \|", line)]
    asked = [*PROJECT["dependencies"], *itertools.chain(*PROJECT["optional-dependencies"].values())]
    assert sorted(row[0] for row in rows) == sorted({canonicalize_name(Requirement(one).name) for one in asked})
    assert all(len(row) == 5 and all(row) for row in rows)


def test_pythons_that_are_claimed_are_those_that_run_looks_for():
    names = re.search(r"for name in (.*); do", (ROOT / "run").read_text())[1]
    assert set(re.findall(r"python(3\.\d+)", names)) == set(PYTHONS) == {"3.11", "3.12", "3.13"}


def test_container_and_definition_call_the_same_installation():
    for name in ("Dockerfile", "apptainer.def", "in_debian"):
        assert re.search(r"^\s*(RUN |inside HOME=/root )?/tmp/eye-oil/container/install /opt/eye-oil",
                         (ROOT / "container" / name).read_text(), re.MULTILINE), name
    for name in ("container/install", "container/in_debian", "tests/of_wheel"):
        assert not subprocess.run(["bash", "-n", ROOT / name]).returncode


def test_container_gets_what_the_wheel_is_made_of():
    kept = re.findall(r"^!(.+)$", (ROOT / ".dockerignore").read_text(), re.MULTILINE)
    wheel = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert {name.strip("/") for name in wheel["include"]} | set(wheel["force-include"]) <= set(kept)
    assert all((ROOT / name).exists() for name in kept)


@pytest.mark.parametrize(("option", "words"), [
    ("--version", rf"eye-oil {PROJECT['version']}, Snakemake \d+[.\d]+\n"),
    thorough("--help", r"Snakemake with the rules of this project in any folder(.|\n)*usage: (.|\n)*--dry-run(.|\n)*")])
def test_the_installed_command_tells_what_it_is_and_copies_nothing(tmp_path, option, words):
    done = subprocess.run([sys.executable, "-m", "pipeline.workflow.command", option], cwd=tmp_path, text=True,
                          env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True)
    assert re.fullmatch(words, done.stdout) and not [*tmp_path.iterdir()], done.stdout + done.stderr


@pytest.mark.thorough
def test_packages_are_told_with_version_and_license(capsys):
    software.main([])
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "name,version,license" and len(lines) == 1 + len(packages()) + len(LIBRARIES)
    found = {one.name: one for one in packages()}
    assert found["numpy"].version == locked(f"3.{sys.version_info.minor}")["numpy"]
    assert "BSD" in found["numpy"].license and found["pyvista"].license == "MIT"


@pytest.mark.thorough
def test_packages_that_say_nothing_readable_are_told_too(tmp_path, monkeypatch):
    before = packages_digest()
    (tmp_path / "broken-1.0.dist-info").mkdir()
    info = tmp_path / "latin-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: latin\nVersion: 1.0\n")
    (info / "RECORD").write_text("latin-1.0.dist-info/LICENSE,,\nlatin-1.0.dist-info/LICENSE.lost,,\n")
    (info / "LICENSE").write_bytes("M\xfcller's license\n".encode("latin-1"))
    monkeypatch.syspath_prepend(tmp_path)
    assert [one for one in packages() if one.name == "latin"] == [Package("latin", "1.0", "M\ufffdller's license")]
    assert packages_digest() != before


def test_page_of_the_packages_escapes_them():
    page = software.page_of([Package("<b>", "1", "MIT"), Package("c", "2", "MIT")])
    assert "&lt;b&gt;" in page and "<b>" not in page


def test_libraries_in_pages_are_told_as_they_are(capsys):
    """Their versions stand in their files, their licenses beside them, and both come with the wheel."""
    told = {one.name: one for one in LIBRARIES}
    heads = {path.name: path.read_text(encoding="utf-8")[:60] for path in VENDOR.glob("*.min.js")}
    assert f"(v{told['uPlot'].version})" in heads["uplot.min.js"]
    assert f"r{told['three.js'].version.split('.')[1]}, {told['three.js'].license} " in heads["three.min.js"]
    assert len(heads) == len(told) == len([*VENDOR.glob("LICENSE.*")])
    for one in LIBRARIES:
        assert f"{one.version} | {one.license}," in (VENDOR / "README.md").read_text(encoding="utf-8")
    software.main([])
    assert "uPlot,1.6.32,MIT\n" in capsys.readouterr().out
    licenses = {path.resolve() for name in PROJECT["license-files"] for path in ROOT.glob(name)}
    assert {path.resolve() for path in VENDOR.glob("LICENSE.*")} <= licenses
