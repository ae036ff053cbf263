"""Documents lead somewhere: citations, equations, labels, links, and the names that the pages on methods give.

Of Python files comments and strings are read, of all others the whole text.
"""
import ast
import calendar
import io
import os
import re
import tokenize
import unicodedata
from functools import cache
from pathlib import Path

import pytest

from sim.effects import REGISTRY as EFFECTS
from sim.schemes import REGISTRY as SCHEMES

ROOT = next(folder for folder in Path(__file__).parents if (folder / "pyproject.toml").is_file())
METHODS = ROOT / "docs" / "methods"
BIBLIOGRAPHY = ROOT / "docs" / "references.bib"
FOLDERS = ("sim", "pipeline", "studies", "tests", "benchmarks", "config", "rules", "docs", "profiles")
CODE = ("sim", "pipeline", "studies")
KINDS = {".py", ".yaml", ".json", ".smk", ".md", ".rst"}
HEADINGS = ["What it does", "Equations", "Source", "What differs, and why", "Validated by"]

KEY = r"[a-z]+(?:\d{4,}[a-z]?)?"
LOCATOR = r"(?:eqs?\.|figs?\.|sections?|table|algorithm|abstract|page|chapter)(?!\w)"
BRACKET = re.compile(r"\[([^\[\]]{3,200})\]")
YEARS = re.compile(r"([A-Z][\w'’-]+)(?: et al\.)?,? \(?(18\d\d|19\d\d|20[0-2]\d)\)?(?![\d.,]*\d)")
NO_AUTHORS = {"Siluron", "OpenFOAM", *calendar.month_name[1:]}    # followed by a number that looks like a year
EQUATION = re.compile(r"\(([A-Z]\d{1,2})\)")
NUMBERED = re.compile(r"\\qquad \(([A-Z]\d{1,2})\) \$\$")
# What pointed into documents that are not in the project: numbered papers, tests, errata, facts and sections.
LABEL = re.compile(r"(?<![\w.#/\\-])(?:S[1-3]|[EFT][1-9]\d?)(?![\w-])|\bmethods,? (?:section )?[E\d]|\bseed S"
                   r"|\b[Tt]he recipe\b|\b[Ee]rrat(?:a|um)\b|\b[Ss]ections? (?:[IVX]+\b|\d)")


@cache
def files() -> tuple[Path, ...]:
    """Text files of the project, this one left out, which holds examples of what it looks for."""
    found = [path for path in ROOT.iterdir() if path.suffix == ".md" or path.name == "Snakefile"]
    for folder in FOLDERS:
        found += [path for path in (ROOT / folder).rglob("*") if path.suffix in KINDS
                  and not {".venv", "_build"} & set(path.parts)
                  and ROOT / "pipeline" / "project" not in path.parents]  # what a wheel has beside the code
    return tuple(sorted(path for path in found if path != Path(__file__)))


@cache
def words(path: Path) -> str:
    """Text of a file; of Python its comments and strings, one below the other."""
    text = path.read_text()
    if path.suffix != ".py":
        return text
    kinds = {tokenize.COMMENT, tokenize.STRING, getattr(tokenize, "FSTRING_MIDDLE", tokenize.STRING)}
    return "\n".join(token.string for token in tokenize.generate_tokens(io.StringIO(text).readline)
                     if token.type in kinds)


@cache
def bibliography() -> dict[str, tuple[frozenset[str], str]]:
    """Surnames without accents, and year, of every key."""
    entries = {}
    for key, body in re.findall(r"^@\w+\{(\w+),\n(.*?)^\}", BIBLIOGRAPHY.read_text(), re.DOTALL | re.MULTILINE):
        authors = re.search(r"author\s*= \{(.*?)\},\n", body, re.DOTALL)
        surnames = [name.split(",")[0].split()[-1] for name in re.split(r"\s+and\s+", authors[1])] if authors else []
        year = re.search(r"year\s*= \{(\d{4})\}", body)
        entries[key] = frozenset(map(plain, surnames)), year[1] if year else ""
    return entries


def plain(name: str) -> str:
    return "".join(letter for letter in unicodedata.normalize("NFD", name) if not unicodedata.combining(letter))


def parts(bracket: str) -> list[str]:
    """Citations in a bracket, as `key, place`: none where it is something else."""
    found = [" ".join(re.sub(r"\n\s*#?", " ", part).split()) for part in bracket.split(";")]
    cites = any(re.fullmatch(rf"[a-z]+\d{{4,}}[a-z]?(, .+)?|[a-z]+, {LOCATOR}.*", part) for part in found)
    return found if cites else []


def citations(text: str) -> list[str]:
    return [part for bracket in BRACKET.findall(text) for part in parts(bracket)]


@cache
def pages() -> dict[str, Path]:
    return {path.stem: path for path in sorted(METHODS.glob("*.md")) if path.name != "README.md"}


@cache
def equations() -> dict[str, str]:
    """Page of every equation."""
    return {number: name for name, path in pages().items() for number in NUMBERED.findall(path.read_text())}


@cache
def code_names() -> frozenset[str]:
    """Every name in the code, fields and keys that are strings among them."""
    names = set()
    for folder in CODE:
        for path in (ROOT / folder).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text())):
                names |= {value for value in (getattr(node, "id", None), getattr(node, "attr", None),
                                              getattr(node, "arg", None), getattr(node, "name", None),
                                              getattr(node, "value", None)) if isinstance(value, str)}
    return frozenset(names)


@cache
def file_names() -> frozenset[str]:
    return frozenset(path.name for path in files()) | {Path(__file__).name}


def place(path: Path) -> str:
    return str(path.relative_to(ROOT))


@pytest.mark.thorough
def test_citations_are_in_the_bibliography():
    wrong = []
    for path in files():
        for citation in citations(words(path)):
            match = re.fullmatch(rf"({KEY})(?:, ({LOCATOR}.*))?", citation)
            if not match or match[1] not in bibliography() or not (match[2] or match[1][-1].isdigit()):
                wrong.append(f"{place(path)}: [{citation}]")
    assert wrong == []


@pytest.mark.thorough
def test_authors_with_a_year_are_in_the_bibliography():
    known = {(name, year) for names, year in bibliography().values() for name in names}
    wrong = [f"{place(path)}: {name} {year}" for path in files() for name, year in YEARS.findall(words(path))
             if name not in NO_AUTHORS and (plain(name), year) not in known]
    assert wrong == []


def test_every_source_is_cited():
    text = "\n".join(map(words, files()))
    cited = {re.match(KEY, citation)[0] for citation in citations(text)}
    named = {(plain(name), year) for name, year in YEARS.findall(text)}
    idle = [key for key, (names, year) in bibliography().items()
            if key not in cited and not any((name, year) in named for name in names)]
    assert idle == []


def test_no_label_of_another_document_is_left():
    wrong = []
    for path in files():
        text = BRACKET.sub(lambda match: "" if parts(match[1]) else match[0], words(path))
        wrong += [f"{place(path)}: {match[0]}" for match in LABEL.finditer(text)]
    assert wrong == []


def test_equations_have_numbers_of_their_own():
    for name, path in pages().items():
        numbers = NUMBERED.findall(path.read_text())
        assert path.read_text().count("\n$$") == len(numbers), name
        assert numbers == [f"{numbers[0][0]}{k}" for k in range(1, len(numbers) + 1)], name
    prefixes = [next(number for number, page in equations().items() if page == name)[0] for name in pages()]
    assert len(set(prefixes)) == len(pages())


def test_equations_that_are_cited_exist_on_the_page_that_is_named():
    wrong = []
    for path in files():
        if path.suffix == ".py" and path.parts[len(ROOT.parts)] in CODE:
            text = words(path)
            wrong += [f"{place(path)}: ({number})" for number in EQUATION.findall(text)
                      if number not in equations() or f"docs/methods/{equations()[number]}.md" not in text]
        elif path.parent == METHODS:
            wrong += [f"{place(path)}: ({number})" for number in EQUATION.findall(path.read_text())
                      if number not in equations()]
    assert wrong == []


def test_every_equation_is_cited_where_it_is_computed():
    cited = {number for path in files() if path.suffix == ".py" for number in EQUATION.findall(words(path))}
    assert sorted(set(equations()) - cited) == []


def anchors(path: Path) -> set[str]:
    headings = re.findall(r"^#+ (.+)$", path.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_relative_links_lead_somewhere():
    wrong = []
    for path in (path for path in files() if path.suffix == ".md"):
        for target in re.findall(r"\]\(([^)\s]+)\)", path.read_text()):
            if re.match(r"\w+:", target):
                continue
            name, _, anchor = target.partition("#")
            linked = Path(os.path.normpath(path.parent / name)) if name else path  # of folders that may be links
            if not linked.exists() or (anchor and linked.suffix == ".md" and anchor not in anchors(linked)):
                wrong.append(f"{place(path)}: {target}")
    assert wrong == []


@pytest.mark.parametrize("name", pages())
def test_page_has_all_sections(name):
    assert re.findall(r"^## (.+)$", pages()[name].read_text(), re.MULTILINE) == HEADINGS


def test_index_lists_every_page():
    assert set(re.findall(r"\]\((\w+)\.md\)", (METHODS / "README.md").read_text())) == set(pages())


def test_every_effect_and_scheme_is_on_a_page():
    text = "\n".join(path.read_text() for path in pages().values())
    assert [name for name in (*EFFECTS, *SCHEMES) if f"`{name}`" not in text] == []


def code_column(text: str) -> list[str]:
    """Names in backticks in the columns headed `name in code`."""
    names, column = [], None
    for line in text.splitlines():
        if not line.startswith("|"):
            column = None
            continue
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        if "name in code" in cells:
            column = cells.index("name in code")
        elif column is not None:
            names += re.findall(r"`([^`]+)`", cells[column])
    return names


@pytest.mark.thorough_cases("cohesion", "collision")
@pytest.mark.parametrize("name", [*pages(), "README"])
def test_names_in_tables_exist(name):
    assert [one for one in code_column((METHODS / f"{name}.md").read_text()) if one not in code_names()] == []


@pytest.mark.parametrize("name", [*pages(), "README"])
def test_files_and_families_exist(name):
    text = (METHODS / f"{name}.md").read_text()
    stems = {Path(file).stem for file in file_names()}
    named = re.findall(r"`([\w/]+\.(?:py|yaml|md))`", text)
    assert [one for one in named if Path(one).name not in file_names()] == []
    evidence = text.partition("## Validated by")[2]
    assert [one for one in re.findall(r"`(\w+)`", evidence) if one not in stems | code_names()] == []
