"""What the documents tell to type can be typed."""
import re
import shlex
from pathlib import Path

import pytest
from helpers import forked

from pipeline.scenes.folders import scene_paths
from pipeline.studies.plan import study_names

ROOT = Path(__file__).parents[1]
DOCUMENTS = [path for path in (*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("benchmarks/**/*.md"))
             if path.name != "CHANGELOG.md" and "_build" not in path.parts]
TEXT = {path.relative_to(ROOT): path.read_text(encoding="utf-8") for path in DOCUMENTS}
CODE = re.compile(r"^```\w*\n(.*?)^```$|`([^`\n]+)`", re.MULTILINE | re.DOTALL)
MODULE = re.compile(r"python -m ((?:pipeline|studies)(?:\.\w+)+)(.*)")
TARGET = re.compile(r"outputs/([\w-]+)/(\w+)/")


def commands() -> list[str]:
    """Lines of code in all documents, without their comments."""
    found = ("\n".join(block or inline for block, inline in CODE.findall(text)) for text in TEXT.values())
    return [line.partition(" #")[0].strip() for text in found for line in text.replace("\\\n", " ").splitlines()]


STAGES = sorted({match[1] for line in commands() if (match := MODULE.search(line))})


@pytest.mark.thorough
@pytest.mark.parametrize("module", STAGES)
def test_stages_of_the_documents_have_the_options_that_they_name(module):
    done = forked.run(module, "--help")
    assert done.returncode == 0 and done.stdout.startswith("usage: "), done.stderr
    for line in commands():
        match = MODULE.search(line)
        if match and match[1] == module:
            for option in re.findall(r"--[a-z][a-z-]*", match[2]):
                assert option in done.stdout, line


@pytest.mark.thorough
@pytest.mark.parametrize("module", STAGES)
def test_options_that_there_are_not_end_in_one_sentence(module):
    done = forked.run(module, "--no-such-option")
    assert done.returncode == 2 and done.stdout == ""
    assert re.fullmatch(rf"error: python -m {module}: [^\n]+; --help lists what it takes\n", done.stderr), done.stderr


def test_code_of_the_documents_is_whole():
    for path, text in TEXT.items():
        assert len(re.findall(r"^```", text, re.MULTILINE)) % 2 == 0, path
    for line in commands():
        if line.startswith(("./run", "snakemake", "python")):
            assert shlex.split(line)


def test_targets_of_the_documents_are_scenes_and_levels_that_there_are():
    written = re.findall(r"`config/(?:scenes|studies)/(\w+)\.yaml`:", "\n".join(TEXT.values()))  # by a tutorial
    scenes = {*scene_paths(ROOT / "config/scenes"), "studies", *written}
    found = {match[1] for line in commands() for match in TARGET.finditer(line)}
    assert len(found) > 3 and found <= scenes
    runs = [line.split()[2] for line in commands() if re.match(r"snakemake -j\d+ \w+$", line)]
    assert runs and set(runs) <= {"all", "explorer", "results", "results_small", *study_names(), *scenes}
