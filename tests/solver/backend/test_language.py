"""Kernels are written in words that every fork has, and nothing but the room of the library knows more of it."""
import ast
import functools
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import ROOT

from sim.backend import private, ti
from sim.backend.choice import LIBRARIES, library
from sim.backend.language import WORDS

ROOM = ROOT / "sim" / "backend"
FOLDERS = ("sim", "pipeline", "studies", "tests", "benchmarks", "docs")
MODULES = {one.module for one in LIBRARIES.values()}
NAMES = {*LIBRARIES, *MODULES}
PREFIXES = tuple({f"{one.prefix}_" for one in LIBRARIES.values()} | {"ENABLE_TAICHI", "ENABLE_QUADRANTS"})
# What is read in the room of objects of the library, and is not promised by it.
INSIDES = {"_cell_size_bytes", "_finalized_roots", "_is_classkernel", "_primal", "cell_size_bytes", "compiled_kernels",
           "compile_kernel", "get_snode_tree_id", "launch_kernel", "make_launch_context", "materialized_kernels",
           "offset_bytes_in_parent_cell", "prog", "snode"}


def files() -> Iterator[Path]:
    """Yield the files in Python outside the room and its tests."""
    for folder in FOLDERS:
        for path in (ROOT / folder).rglob("*.py"):
            if not path.is_relative_to(ROOM) and path.parent != Path(__file__).parent:
                yield path


@functools.cache
def nodes(path: Path) -> tuple[ast.AST, ...]:
    """Return all that a file is made of; programs in strings are read too."""
    found = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    for text in [node.value for node in found if isinstance(node, ast.Constant) and isinstance(node.value, str)]:
        if "import" in text and "\n" in text:
            try:
                found += ast.walk(ast.parse(text.replace("{{", "{").replace("}}", "}").replace("{threads}", "1")))
            except SyntaxError:
                continue  # prose
    return tuple(found)


def chain(node: ast.AST) -> str:
    """Return names with dots between them as they stand in code; empty for other expressions."""
    if isinstance(node, ast.Name):
        return node.id
    head = chain(node.value) if isinstance(node, ast.Attribute) else ""
    return f"{head}.{node.attr}" if head else ""


def words_in(path: Path) -> set[str]:
    """Return the words of the language in a file: of `ti.Vector.field` the longest, not what is on the way."""
    found = {chain(node).removeprefix("ti.") for node in nodes(path)
             if isinstance(node, ast.Attribute) and chain(node).startswith("ti.")}
    return {word for word in found if not any(other.startswith(f"{word}.") for other in found) or word in WORDS}


def imported(path: Path) -> set[str]:
    """Return the heads of the modules that a file imports, anywhere in it."""
    heads = [alias.name for node in nodes(path) if isinstance(node, ast.Import) for alias in node.names]
    heads += [node.module for node in nodes(path) if isinstance(node, ast.ImportFrom) and node.module]
    return {head.partition(".")[0] for head in heads}


def test_nothing_else_imports_the_library():
    assert [path for path in files() if imported(path) & MODULES] == []


def test_kernels_are_written_in_the_words_of_the_language():
    used = {path: words_in(path) for path in files()}
    assert {path: words - WORDS for path, words in used.items() if words - WORDS} == {}
    assert set().union(*used.values()) == WORDS  # and none is left over


def test_nothing_else_looks_inside_the_library():
    assert {(path, node.attr) for path in files() for node in nodes(path)
            if isinstance(node, ast.Attribute) and node.attr in INSIDES} == set()
    modules = {name for name, value in vars(private).items() if type(value).__name__ == "module"}
    assert not [path for path in files() for node in nodes(path)
                if isinstance(node, ast.ImportFrom) and node.module == "sim.backend.private"
                and {alias.name for alias in node.names} & modules]


def test_nothing_else_knows_its_name_or_its_settings():
    """But for tests, of which many ask for the fixture `taichi`."""
    texts = {(path, node.value) for path in files() for node in nodes(path)
             if isinstance(node, ast.Constant) and isinstance(node.value, str)}
    assert {(path, text) for path, text in texts if text.startswith(PREFIXES)
            or (text in NAMES and not path.is_relative_to(ROOT / "tests"))} == set()


@pytest.mark.parametrize("word", sorted(WORDS))
def test_the_library_has_every_word(word):
    functools.reduce(getattr, word.split("."), ti)


def test_files_with_kernels_get_the_language_by_one_import():
    """As `ti`: a file that calls it by another name would not be looked at above."""
    ways = {ast.unparse(node) for path in files() for node in nodes(path)
            if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("sim.backend.language")}
    renamed = [path for path in files() for node in nodes(path) if isinstance(node, ast.ImportFrom)
               and node.module == "sim.backend" and any(one.name == "ti" and one.asname for one in node.names)]
    assert ways == set() and renamed == []
    assert ti.__name__ == library().module
