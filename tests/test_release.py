"""What names the version of the project names the same one."""
import re
import tomllib

import yaml
from conftest import ROOT

VERSION = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
CHANGES = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_citation_and_bibtex_have_the_version_of_the_package():
    assert CITATION["version"] == CITATION["preferred-citation"]["version"] == VERSION
    bibtex = (ROOT / "docs" / "cite.md").read_text(encoding="utf-8")
    assert re.findall(r"version = \{(.*)\}", bibtex) == [VERSION]
    assert re.findall(r"year    = \{(.*)\}", bibtex) == [str(CITATION["preferred-citation"]["year"])]
    assert f"title   = {{{CITATION['preferred-citation']['title']}}}" in bibtex.replace("{SPH}", "SPH")


def test_changes_of_the_version_are_told_with_its_date():
    headings = re.findall(r"^## \[(.+?)\](?: - (\S+))?$", CHANGES, re.MULTILINE)
    assert headings[0] == ("Unreleased", "") and headings[1] == (VERSION, str(CITATION["date-released"]))


def test_changes_are_short_enough_to_read():
    unreleased = CHANGES.partition("## [Unreleased]")[2].partition("\n## [")[0]
    assert len(unreleased.splitlines()) <= 100
