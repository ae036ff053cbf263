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
    assert len(json.loads(kept.read_text())) == len(digest.modules_used("pipeline.movie")) > 10
    if damage is not None:
        kept.write_text(damage)
    else:
        monkeypatch.setattr(digest, "_read", lambda code: pytest.fail("a file was parsed again"))
    digest._known.cache_clear()
    assert digest.code_used("pipeline.movie") == fresh


# Modules that use the effects of scenes otherwise than by running code that their results depend on.
WITHOUT_CODE_OF_EFFECTS = {
    **dict.fromkeys(("advice.dimensionless_numbers", "advice.rules"), "advice counts all effects, see ADVICE"),
    **dict.fromkeys(("scenes.checks", "scenes.container_checks", "cavity.voxels"), "only speak: what is wrong"),
    **dict.fromkeys(("scenes.description", "scenes.load", "scenes.model", "scenes.schema"), "a scene is its values"),
    "metrics": "asks measures.metric, which counts them",
    "planning.sequence": "no rule makes plans",
}


def test_modules_that_run_the_code_of_effects_are_known_to():
    """One that uses REGISTRY and is in neither list would go stale in silence."""
    using = {name for name, code in modules("pipeline") if uses_effects(ast.parse(code))}
    assert using - {*digest.ASKING} == {f"pipeline.{name}" for name in WITHOUT_CODE_OF_EFFECTS}


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


def test_every_module_that_digests_know_by_name_is_there():
    named = {*digest.WITHOUT_INFLUENCE, *digest.ADVICE, *digest.BESIDE_ITS_WORK, *digest.BESIDE_ITS_WORK.values(),
             *digest.INSTEAD, *digest.INSTEAD.values(), *digest.CHOICES, *digest.NAMES_ONLY, *digest.ASKING}
    assert not [name for name in named if digest._file(name) is None]
    assert not [stage for stage in UNREAD if digest._file(f"pipeline.{stage}") is None]


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


def test_another_library_of_kernels_changes_what_is_computed_with_it(monkeypatch):
    stages = ("voxelize", "simulate", "reconstruct", "movie")
    before = {stage: digest.code_used(f"pipeline.{stage}") for stage in stages}
    changed = set()
    for version in ("taichi 1.7.5", "quadrants 1.7.4"):
        monkeypatch.setattr(digest, "backend_version", lambda version=version: version)
        changed |= {stage for stage in stages if digest.code_used(f"pipeline.{stage}") != before[stage]}
    assert changed == {"voxelize", "simulate", "reconstruct"}
