"""Scene files as plain data: strict YAML, and scenes that extend others."""
from pathlib import Path
from typing import Any

import yaml

from pipeline.base.errors import UserError
from pipeline.scenes.reader import Errors, Key, describe, nearest


class _StrictLoader(yaml.SafeLoader):
    """YAML without its traps: a key given twice is an error, and there are no aliases (scenes have ``extends``)."""

    def compose_node(self, parent: Any, index: Any) -> yaml.Node:
        if self.check_event(yaml.AliasEvent):
            mark = self.peek_event().start_mark
            raise yaml.MarkedYAMLError(problem="aliases (*name) are not supported", problem_mark=mark)
        return super().compose_node(parent, index)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        seen = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise yaml.MarkedYAMLError(problem="a key must be a word", problem_mark=key.start_mark)
            if key.value in seen:
                raise yaml.MarkedYAMLError(problem=f"{key.value} is given twice", problem_mark=key.start_mark)
            seen.add(key.value)
        return {str(key.value): self.construct_object(value, deep=True) for key, value in node.value}


def read_yaml(path: Path) -> dict[str, Any]:
    """Return the mapping in a YAML file.

    Raises
    ------
    UserError
        The file is missing, not YAML (with line and column), empty, or not a mapping.
    """
    if not path.is_file():
        names = [other.name for other in path.parent.glob("*.yaml")]
        raise UserError(f"{path}: no such file{nearest(path.name, names)}")
    try:
        data = yaml.load(path.read_text(encoding="utf-8"), _StrictLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        raise UserError(f"{path}: line {mark.line + 1}, column {mark.column + 1}: {error.problem}") from None
    except (yaml.YAMLError, UnicodeDecodeError):
        raise UserError(f"{path}: not a text file in UTF-8") from None
    except (RecursionError, ValueError) as error:  # endless nesting; a date such as 2024-13-45
        raise UserError(f"{path}: not valid YAML ({error})") from None
    if not isinstance(data, dict):
        raise UserError(f"{path}: is {describe(data)}, but must hold `name: value` lines")
    return data


def read_extended(path: Path, errors: Errors, chain: tuple[Path, ...] = ()) -> dict[str, Any]:
    """Return a scene file merged over the scenes that it extends.

    Mappings are merged key by key, anything else replaces what was inherited, and null removes it. A list of liquids
    replaces the inherited liquids; a mapping changes or adds some.

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
    if isinstance(data.get("liquids"), list):
        data["liquids"] = _named_once(data["liquids"], path, errors)
    return _merge(inherited, data, (), path, errors)


def sibling(path: Path, key: str, name: Any, chain: tuple[Path, ...]) -> Path:
    """Return the file of the scene ``name`` that ``key`` of the file ``path`` refers to.

    Parameters
    ----------
    chain : files that lead to this reference; a reference to one of them is a cycle.
    """
    names = sorted(other.stem for other in path.parent.glob("*.yaml"))
    if name not in names:
        raise UserError(f'{path}: {key} is "{name}", but must be the name of a scene in this folder'
                        f"{nearest(name, names)}: {', '.join(names)}")
    other = path.parent / f"{name}.yaml"
    if other in chain:
        circle = " -> ".join(file.stem for file in (*chain[chain.index(other):], other))
        raise UserError(f"{path}: {key} leads back to the same scene ({circle})")
    return other


class _Replacing(dict):
    """A mapping that takes the place of what it extends."""


def _named_once(names: list, path: Path, errors: Errors) -> _Replacing:
    errors.origins["liquids",] = path
    for name in dict.fromkeys(str(name) for name in names if names.count(name) > 1):
        errors.add(("liquids",), f"names {name} more than once, but every liquid is one phase")
    return _Replacing((str(name), {}) for name in names)


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
        else:
            errors.add((*key, name), "is empty, which removes what is inherited, but nothing is inherited; "
                                     "write {} for an entry that has only defaults")
    return merged
