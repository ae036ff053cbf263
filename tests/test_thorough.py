"""The list of tests that are left to CI: what it names exists, and what finds the planted faults is not in it."""
import ast
import re

from conftest import NOT_FOUND, ROOT, thorough


def names_of(path) -> set[str]:
    """Return the names of the tests of a file."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")}


def test_what_is_left_to_ci_exists(pytestconfig):
    """Down to the case; seen where all tests are collected, as by `./run test`."""
    assert pytestconfig.stash.get(NOT_FOUND, []) == []


def test_every_planted_fault_is_found_without_what_is_left_to_ci():
    page = (ROOT / "docs" / "planted_faults.md").read_text(encoding="utf-8")
    finders = set(re.findall(r"`(test_[^`]+)` \|$", page, re.MULTILINE))
    assert len(finders) > 60
    left = thorough()
    kept = {(f"{path.relative_to(ROOT)}::{name}", name) for path in (ROOT / "tests").rglob("test_*.py")
            for name in names_of(path)}
    for finder in finders:
        test, bracket, case = finder.partition("[")
        assert any(node not in left and node + bracket + case not in left
                   for node, name in kept if name == test), finder
