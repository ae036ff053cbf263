"""What is kept of files that were parsed once: it changes no digest, and may be lost or damaged."""
import json

import pytest

from pipeline.base import digest


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
