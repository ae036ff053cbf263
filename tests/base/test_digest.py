"""What is kept of files that were parsed once: it changes no digest, and may be lost or damaged."""
import ast
import json

import pytest

from pipeline.base import digest
from pipeline.workflow.digest import UNREAD


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """A place of its own for what is kept, and nothing known."""
    monkeypatch.setattr(digest, "KNOWN", tmp_path / "known.json")
    monkeypatch.setattr("sys.dont_write_bytecode", False)
    digest._known.cache_clear()
    yield tmp_path / "known.json"
    digest._known.cache_clear()


@pytest.mark.parametrize("damage", [None, "", "{", "[]"])
def test_digests_are_the_same_with_what_was_kept_and_without(kept, damage, monkeypatch):
    fresh = digest.code_used("pipeline.movie")
    assert len(json.loads(kept.read_text())) >= len(digest.modules_used("pipeline.movie")) > 10
    if damage is not None:
        kept.write_text(damage)
    else:
        monkeypatch.setattr(digest, "_read", lambda code: pytest.fail("a file was parsed again"))
    digest._known.cache_clear()
    assert digest.code_used("pipeline.movie") == fresh


# Modules that use the effects of scenes otherwise than by running code that their results depend on.
WITHOUT_CODE_OF_EFFECTS = {
    "advice.rules": "advice counts all effects, see ADVICE",
    **dict.fromkeys(("scenes.checks", "scenes.container_checks", "cavity.voxels"), "only speak: what is wrong"),
    **dict.fromkeys(("scenes.description", "scenes.load", "scenes.model", "scenes.schema"), "a scene is its values"),
    "metrics": "asks measures.metric, which counts them",
    "planning.sequence": "no rule makes plans",
}


def test_modules_that_run_the_code_of_effects_are_known_to():
    """One that uses REGISTRY, does not say so and is not in the list would go stale in silence."""
    using = {name for name, code in modules("pipeline") if uses_effects(ast.parse(code))}
    saying = {name for name in using if said(name) == digest.RUNS_EFFECTS}
    assert using - saying == {f"pipeline.{name}" for name in WITHOUT_CODE_OF_EFFECTS}


def said(module):
    """What a module says of itself."""
    return digest._says(digest._file(module))


def uses_effects(tree):
    """Whether a module asks classes of effects for more than what their parameters are."""
    names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module == "sim.effects"
             for alias in node.names if alias.name == "REGISTRY" and not alias.asname}
    parents = {child: node for node in ast.walk(tree) for child in ast.iter_child_nodes(node)}
    uses = [node for node in ast.walk(tree) if isinstance(node, ast.Name) and node.id in names]
    classes = [parents[parents[one]] for one in uses if isinstance(parents[one], ast.Subscript)]
    return (any(getattr(node, "attr", "") != "Parameters" for node in classes)
            or any(getattr(parents[one], "attr", "") in ("items", "values") for one in uses))


def modules(package):
    """Names and code of the modules of a package."""
    for path in (digest.ROOT / package).rglob("*.py"):
        yield ".".join(path.relative_to(digest.ROOT).with_suffix("").parts), path.read_text(encoding="utf-8")


def test_what_modules_say_of_themselves_is_understood():
    """And every module that they or the digests name is there."""
    says = {name: said(name) for package in digest.PACKAGES for name, _ in modules(package) if said(name)}
    assert set(says.values()) >= {digest.NO_INFLUENCE, digest.RUNS_EFFECTS, digest.ALL_SPEAK}
    words = [one.partition(" ")[::2] for one in says.values()
             if one not in (digest.NO_INFLUENCE, digest.RUNS_EFFECTS, digest.ALL_SPEAK)]
    assert {f"{word} " for word, _ in words} == {digest.INSTEAD, digest.BESIDE}
    named = {*(name for _, name in words), *digest.ADVICE, *digest.CHOICES, *digest.NAMES_ONLY}
    assert not [name for name in named if digest._file(name) is None]
    assert not [stage for stage in UNREAD if digest._file(f"pipeline.{stage}") is None]


def test_what_a_module_says_of_itself_changes_no_digest_but_what_counts_for_it(kept, tmp_path, monkeypatch):
    monkeypatch.setattr(digest, "ROOT", tmp_path)
    (tmp_path / "pipeline").mkdir()
    (tmp_path / "pipeline" / "stage.py").write_text("from pipeline import words\n")
    said = []
    for code in ("A = 1\n", 'FOR_DIGESTS = "runs effects"\nA = 1\n', 'FOR_DIGESTS = "no influence"\nA = 1\n'):
        (tmp_path / "pipeline" / "words.py").write_text(code)
        said.append(digest.code_used("pipeline.stage"))
    assert said[0] == said[1] != said[2] and "words.py" not in said[2]


@pytest.mark.parametrize("line", ["from . import law", "from .law import A", "from ..pipeline import law"])
def test_relative_imports_are_followed(kept, tmp_path, monkeypatch, line):
    monkeypatch.setattr(digest, "ROOT", tmp_path)
    (tmp_path / "studies" / "pipeline").mkdir(parents=True)
    (tmp_path / "studies" / "pipeline" / "law.py").write_text("A = 1\n")
    (tmp_path / "studies" / "pipeline" / "fall.py").write_text(f"{line}\n")
    assert [path.name for path in digest.modules_used("studies.pipeline.fall")] == ["fall.py", "law.py"]


def test_a_folder_that_cannot_be_written_is_no_error(kept, monkeypatch):
    monkeypatch.setattr(digest, "KNOWN", kept.parent / "file" / "known.json")
    (kept.parent / "file").write_text("no folder")
    assert digest.code_used("pipeline.movie") == digest.code_used("pipeline.movie")


def test_code_that_changes_is_read_anew(kept, tmp_path, monkeypatch):
    monkeypatch.setattr(digest, "ROOT", tmp_path)
    file = tmp_path / "pipeline" / "stage.py"
    file.parent.mkdir()
    said = []
    for code in ("A = 1\n", "A = 2\n", '"""Of a stage."""\nA = 1  # one\n'):
        file.write_text(code)
        said.append(digest.code_used("pipeline.stage"))
    assert said[0] == said[2] != said[1]


def test_digests_are_the_same_with_every_version_of_python():
    """A new Python neither simulates anything again nor tells that the code of a run has changed."""
    code = ('''"""Of a module."""
import numpy as np
from .law import (A, B as C)
WORDS = "é—\\U0001f441" f"{A:>{C}}{B!r:{C}}{{}}", b"\\0", None, ..., 1e-3, 2j, 10**400, r"\\d"
class Law(A, metaclass=C):
    """Of a class."""
    @property
    def value(self, a: int, /, *b, c=None, **d) -> float:
        """Of a function."""
        try:
            return {**d, "a": [*b, (x := lambda: 1)]}[c:]
        except* ValueError as error:
            raise error from None
    async def later(self):
        match self:
            case {"a": None, **rest} | [Law(value=1), *_] if rest:
                yield await self
def _advice(scene): return ""
''')
    read = digest._read(code)
    assert (read["all"], read["work"]) == ("56d552a6d797256b", "3790a30e283192b5")
    for old, new in (("é", "e"), ("10**400", "10**401"), ("None", "0"), ("B!r", "B!s"), ("{{}}", "{{"), ("{C}", "{B}")):
        assert digest._read(code.replace(old, new, 1))["all"] != read["all"], old


def test_another_library_of_kernels_changes_what_is_computed_with_it(monkeypatch):
    stages = ("voxelize", "simulate", "reconstruct", "movie")
    before = {stage: digest.code_used(f"pipeline.{stage}") for stage in stages}
    changed = set()
    for version in ("taichi 1.7.5", "quadrants 1.7.4"):
        monkeypatch.setattr(digest, "backend_version", lambda version=version: version)
        changed |= {stage for stage in stages if digest.code_used(f"pipeline.{stage}") != before[stage]}
    assert changed == {"voxelize", "simulate", "reconstruct"}
