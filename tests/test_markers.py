"""What is left to CI: the cases that markers name exist, and what finds the planted faults is not among them.

And the faults can be planted.
"""
import re
import subprocess
import sys

import pytest
from conftest import NOT_FOUND, ROOT, SHORT
from fault_table import FAULTS


def test_cases_that_are_left_to_ci_exist(pytestconfig):
    """Seen where all tests are collected, as by `./run test`."""
    assert pytestconfig.stash.get(NOT_FOUND, []) == []


@pytest.fixture(scope="module")
def short(pytestconfig) -> set[str]:
    """Names of the tests of `./run test`."""
    if SHORT in pytestconfig.stash:
        return pytestconfig.stash[SHORT]
    done = subprocess.run([sys.executable, "-m", "pytest", "--collect-only", "-q", "-n", "0", "-p", "no:cacheprovider"],
                          cwd=ROOT, capture_output=True, text=True)
    return {line.rpartition("::")[2] for line in done.stdout.splitlines() if "::" in line}


def test_every_planted_fault_is_found_without_what_is_left_to_ci(short):
    page = (ROOT / "docs" / "planted_faults.md").read_text(encoding="utf-8")
    finders = set(re.findall(r"`(test_[^`]+)` \|$", page, re.MULTILINE))
    assert len(finders) > 60
    assert finders <= short | {name.partition("[")[0] for name in short}


def test_every_planted_fault_has_its_place_in_the_code():
    code = "\n".join(path.read_text(encoding="utf-8") for room in ("sim", "pipeline", "studies")
                     for path in (ROOT / room).rglob("*.py"))
    assert {fault.name: count for fault in FAULTS if (count := code.count(fault.snippet)) != 1} == {}
