"""Scene files as plain data: strict YAML, and scenes that extend others."""
import re
from collections import Counter
from pathlib import Path
from typing import Any

import yaml

from pipeline.base.errors import UserError
from pipeline.base.words import nearest, printable
from pipeline.scenes.folders import LISTED, scene_path, scene_paths, scenes_folder
from pipeline.scenes.reader import Errors, Key, describe

MOST_BYTES = 200_000  # of a file: parsed in some seconds
MOST_DEPTH = 20  # of lists and mappings in each other
MOST_IN_A_ROW = 30  # scenes that extend each other, or start from each other
CHANGE_THE_STORY = ("start_from", "container", "initial", "blocks", "effects")
MOST_DIGITS = 300  # of a whole number; a longer one is beyond the range of floats


FULL_WIDTH = dict(zip("：｛｝［］，", ":{}[],", strict=True))
# What the reader of YAML says, and what it means for who has written a scene.
IN_WORDS = ((r"'\\t' that cannot start", "a tab, but lines are indented by blanks, and words parted by them"),
            (r"character '.' that cannot start|expected alphabetic or numeric",
             "text that begins with a sign such as @, % or * must be in quotes"),
            (r"mapping values are not allowed", "a colon where none can be: text with a colon must be in quotes, a key "
             "begins a line of its own, and keys of one mapping are indented alike"),
            (r"unexpected end of stream", "the quotes of a text are not closed"),
            (r"but got '<stream end>'", "a bracket is not closed before the end of the file"),
            (r"^(expected|did not find expected) <block end>|expected ',' or '[}\]]'",
             "does not fit to what stands before: look at indentation, colons, commas and brackets"),
            (r"could not find expected ':'", "a line without the colon and the blank that a key is followed by"))


class _StrictLoader(yaml.SafeLoader):
    """YAML without its traps.

    Plain words are read as YAML 1.2 does: yes, no, on and off are words, 010 is ten, 1:30 and dates are text. A key
    that is given twice, an anchor, an alias (scenes have ``extends``), a tag, or endless nesting is an error.
    """

    yaml_implicit_resolvers: dict = {}  # noqa: RUF012
    depth = 0

    def compose_node(self, parent: Any, index: Any) -> yaml.Node:
        event = self.peek_event()
        if getattr(event, "anchor", None) is not None:
            raise _at(event, "anchors (&name) and aliases (*name) are not supported")
        if getattr(event, "tag", None) is not None:
            raise _at(event, "tags (!name) are not supported")
        if self.depth > MOST_DEPTH:
            raise _at(event, f"lists and mappings lie in each other more than {MOST_DEPTH} deep")
        self.depth += 1
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        seen = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise _at(key, "a key must be a word")
            if key.value in seen:
                raise _at(key, f"{printable(key.value)} is given twice")
            seen.add(key.value)
        return {str(key.value): self.construct_object(value, deep=True) for key, value in node.value}

    def construct_yaml_int(self, node: yaml.ScalarNode) -> float:
        return int(node.value) if len(node.value) <= MOST_DIGITS else float(node.value)


def _at(place: Any, problem: str) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=place.start_mark)


for _tag, _pattern, _first in (
        ("null", r"~|null|Null|NULL|", ("~", "n", "N", "")),
        ("bool", r"true|True|TRUE|false|False|FALSE", tuple("tTfF")),
        ("int", r"[-+]?[0-9]+", tuple("-+0123456789")),
        ("float", r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.inf|\.nan", tuple("-+.0123456789"))):
    _StrictLoader.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(rf"(?:{_pattern})\Z"), _first)
_StrictLoader.add_constructor("tag:yaml.org,2002:int", _StrictLoader.construct_yaml_int)


def read_yaml(path: Path) -> dict[str, Any]:
    """Return the mapping in a YAML file.

    Raises
    ------
    UserError
        The file is missing, not YAML (with line and column), empty, too large, or not a mapping.
    """
    if not path.is_file():
        names = [other.name for other in path.parent.glob("*.yaml")]
        raise UserError(f"{path}: no such file{nearest(path.name, names)}")
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise UserError(f"{path}: has {size} bytes, but must have at most {MOST_BYTES}")
    try:
        data = yaml.load(path.read_text(encoding="utf-8"), _StrictLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f"{path}: line {mark.line + 1}, column {mark.column + 1}"
        raise UserError(f"{place}: {_in_words(str(error.problem), path, mark.line)}") from None
    except (yaml.YAMLError, UnicodeDecodeError):
        raise UserError(f"{path}: not a text file in UTF-8") from None
    except (RecursionError, ValueError) as error:  # a character beyond Unicode, such as "\U00110000"
        raise UserError(f"{path}: not valid YAML ({error})") from None
    if not isinstance(data, dict):
        raise UserError(f"{path}: is {describe(data)}, but must hold `name: value` lines")
    return data


def _in_words(problem: str, path: Path, line: int) -> str:
    """What is wrong with a line of YAML, where its reader speaks of tokens and blocks."""
    lines = path.read_text(encoding="utf-8").splitlines()
    wide = next((sign for one in lines[max(line - 1, 0):line + 1] for sign in one if sign in FULL_WIDTH), "")
    if wide:
        return f"the full-width sign {wide} is text here (did you mean {FULL_WIDTH[wide]}?)"
    return next((words for pattern, words in IN_WORDS if re.search(pattern, problem)), problem)


def read_extended(path: Path, errors: Errors, chain: tuple[Path, ...] = ()) -> dict[str, Any]:
    """Return a scene file merged over the scenes that it extends.

    Mappings are merged key by key, anything else replaces what was inherited, and null removes it. A list of liquids
    replaces the inherited liquids; a mapping changes or adds some. The description of another story is not inherited: a
    scene that changes how it begins or its effects has its own, or one that is told from these.

    Parameters
    ----------
    errors : learns in which file every key was written.
    chain : files that extend this one.
    """
    data = read_yaml(path)
    parent = data.pop("extends", None)
    inherited = {}
    if parent is not None:
        chain = (*chain, path)
        inherited = read_extended(sibling(path, "extends", parent, chain), errors, chain)
    if any(key in data for key in CHANGE_THE_STORY):
        inherited.pop("description", None)
    if isinstance(data.get("liquids"), list):
        data["liquids"] = _named_once(data["liquids"], path, errors)
    return _merge(inherited, data, (), path, errors)


def scene_files(path: Path) -> dict[str, str]:
    """Return a scene file and those that it extends, name -> text.

    Raises
    ------
    UserError : one is missing.
    """
    found: dict[str, str] = {}
    while path.name not in found:
        if not path.is_file():
            raise UserError(f"{path}: no such file")
        found[path.name] = path.read_text(encoding="utf-8")
        extended = read_yaml(path).get("extends")
        if extended is None:
            break
        path = scene_path(extended, scenes_folder(path))
    return found


def sibling(path: Path, key: str, name: Any, chain: tuple[Path, ...]) -> Path:
    """Return the file of the scene ``name`` that ``key`` of the file ``path`` refers to.

    Parameters
    ----------
    chain : files that lead to this reference; a reference to one of them is a cycle.
    """
    known = scene_paths(scenes_folder(path))
    if not isinstance(name, str) or name not in known:
        raise UserError(f"{path}: {key} is {describe(name)}, but must be the name of a scene{nearest(name, known)}; "
                        f"{LISTED}")
    other = known[name]
    if len(chain) > MOST_IN_A_ROW:
        raise UserError(f"{chain[0]}: more than {MOST_IN_A_ROW} scenes follow each other by `{key}`")
    if other in chain:
        circle = " -> ".join(file.stem for file in (*chain[chain.index(other):], other))
        raise UserError(f"{path}: {key} leads back to the same scene ({circle})")
    return other


class _Replacing(dict):
    """A mapping that takes the place of what it extends."""


def _named_once(names: list, path: Path, errors: Errors) -> _Replacing:
    errors.origins["liquids",] = path
    counts = Counter(name if isinstance(name, str) else describe(name) for name in names)
    for name, count in counts.items():
        if count > 1:
            errors.add(("liquids",), f"names {printable(name)} more than once, but every liquid is one phase")
    return _Replacing((name, {}) for name in counts)


def _merge(base: Any, change: Any, key: Key, file: Path, errors: Errors) -> Any:
    if not isinstance(change, dict):
        return change
    merged = dict(base) if isinstance(base, dict) and not isinstance(change, _Replacing) else {}
    for name, value in change.items():
        errors.origins[*key, name] = file
        if value is not None:
            merged[name] = _merge(merged.get(name), value, (*key, name), file, errors)
        elif name in merged:
            del merged[name]
        elif re.match(r"\d", str(name)):  # {contact_angle: 18,2 deg} is two entries to YAML
            errors.add((*key, name), "is no key, and a comma ends the entry before it (did you mean a decimal point?)")
        else:
            errors.add((*key, name), "is empty, which removes what is inherited, but nothing is inherited; "
                                     "write {} for an entry that has only defaults")
    return merged
