"""The tutorials work as they are written: their files are written, their commands run, and what they show comes out."""
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT, Project

TUTORIALS = sorted(path.stem for path in (ROOT / "docs" / "tutorials").glob("*.md") if path.stem != "README")
BLOCK = re.compile(r"(?<=\n)```(\w+)\n(.*?\n)```\n", re.DOTALL)


def blocks(name: str) -> list[tuple[str, str, str]]:
    """Return the blocks of a tutorial: line before it, kind and text."""
    page = (ROOT / "docs" / "tutorials" / f"{name}.md").read_text(encoding="utf-8")
    return [(page[:match.start()].rstrip().rpartition("\n")[2], match[1], match[2]) for match in BLOCK.finditer(page)]


def file_named(before: str) -> Path | None:
    """Return the file that a line says the next block is, as ``In `config/scenes/mine.yaml`:``."""
    match = re.fullmatch(r"In `([\w./]+)`(?:, [\w ]+)?:", before)
    return Path(match[1]) if match else None


def changed(text: str, difference: str) -> str:
    """Return a text with the lines of a difference added; parts of it are separated by three dots."""
    for part in difference.split("...\n"):
        lines = part.splitlines(keepends=True)
        old = "".join(line[1:] or "\n" for line in lines if line[0] in " \n")
        new = "".join(line[1:] or "\n" for line in lines)
        assert text.count(old) == 1, f"the file has changed around:\n{old}"
        text = text.replace(old, new)
    return text


def run(project: Project, line: str) -> str:
    """Run a line of a tutorial as its reader would; return what it prints."""
    words = shlex.split(line, comments=True)
    program = {"./run": [sys.executable, "-m", "snakemake", "-j2"], "snakemake": [sys.executable, "-m", "snakemake"],
               "python": [sys.executable]}.get(words[0], [words[0]])
    done = subprocess.run([*program, *words[1:]], cwd=project.folder, stdin=subprocess.DEVNULL, text=True,
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                          env=os.environ | {"PYTHONPATH": str(project.folder)})
    assert done.returncode == 0, f"{line}\n{done.stdout}"
    return done.stdout


@pytest.mark.parametrize("name", TUTORIALS)
def test_files_of_a_tutorial_are_where_its_words_say(name):
    """Every block is a file that is named, a difference to one, a command, or what a command shows."""
    kinds = []
    for before, kind, text in blocks(name):
        named = file_named(before)
        assert (named is not None) == (kind not in ("sh", "text")), f"{before}\n{text}"
        if named and kind == "diff":
            changed((ROOT / named).read_text(encoding="utf-8"), text)
        elif named:
            assert not (ROOT / named).exists(), named
        kinds.append(kind)
    assert "sh" in kinds and kinds[0] != "text"


@pytest.mark.thorough
@pytest.mark.parametrize("name", TUTORIALS)
def test_a_tutorial_works(project, name):
    steps = blocks(name)
    written = [file_named(before) for before, _, _ in steps]
    for package in {path.parts[0] for path in written if path} & {"pipeline", "sim", "studies"}:
        project.own_code(package)
    if any(path and path.parts[0] == "tests" for path in written):
        shutil.copytree(ROOT / "tests", project.folder / "tests", ignore=shutil.ignore_patterns("__pycache__"))
        shutil.copy(ROOT / "pyproject.toml", project.folder)
    printed = ""
    for path, (_, kind, text) in zip(written, steps, strict=True):
        if kind == "sh":
            printed = "".join(run(project, line) for line in text.splitlines())
        elif kind == "text":
            assert [line for line in text.splitlines() if line not in printed] == [], printed
        elif kind == "diff":
            file = project.folder / path
            file.write_text(changed(file.read_text(encoding="utf-8"), text), encoding="utf-8")
        else:
            (project.folder / path).write_text(text, encoding="utf-8")
