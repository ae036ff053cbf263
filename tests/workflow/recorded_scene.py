"""Stages that tell what they read of their scene.

    python tests/workflow/recorded_scene.py commands.json read.json

`commands.json` is a list of commands as Snakemake notes them; each is run here, in one process, on a scene that records
which of its keys are read. `read.json` gets, for every stage, the keys as `pipeline.workflow.digest.UNREAD` names them.
What a stage prints before its work does not count, as in its digest.
"""
import dataclasses
import functools
import json
import re
import runpy
import shlex
import sys
from collections import defaultdict
from pathlib import Path
from types import FrameType
from typing import Any

from pipeline.base import digest
from pipeline.scenes import load

# Callers that take a record over into a new one: that is no use of its values.
COPIES = {("dataclasses", "replace"), ("dataclasses", "_replace"), ("copy", "_reconstruct"), ("copy", "__deepcopy__")}

FOLDER_OF = re.compile(r"\$\(dirname (\S+?)\)")


def recorded(value: Any, path: str, seen: set[str]) -> Any:
    """Return a record that notes in ``seen`` which of its keys are read; of others the value itself.

    Parameters
    ----------
    path : its key in the scene; empty for the scene. Records in effects and schemes count as a whole.
    """
    if isinstance(value, tuple) and value and all(map(dataclasses.is_dataclass, value)):
        return tuple(recorded(one, path, seen) for one in value)
    if not dataclasses.is_dataclass(value) or path.count(".") > 0:
        return value
    kind = _kind(type(value), path, _Seen(seen))
    copy = object.__new__(kind)
    for field in dataclasses.fields(value):
        name = f"{path}.{field.name}" if path else field.name
        object.__setattr__(copy, field.name, recorded(getattr(value, field.name), name, seen))
    return copy


class _Seen:
    """A set that is itself, whatever it holds: for a cache."""

    def __init__(self, found: set[str]):
        self.found = found

    def __hash__(self) -> int:
        return id(self.found)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Seen) and self.found is other.found


@functools.cache
def _kind(kind: type, path: str, seen: _Seen) -> type:
    names = {field.name for field in dataclasses.fields(kind)}

    def read(self, name: str) -> Any:
        value = object.__getattribute__(self, name)
        if name in names:
            caller = sys._getframe(1)
            record = dataclasses.is_dataclass(value) or (isinstance(value, tuple) and value
                                                         and all(map(dataclasses.is_dataclass, value)))
            whole = not record or path
            copied = (caller.f_globals.get("__name__"), caller.f_code.co_name) in COPIES
            if whole and not copied and not _beside(caller):
                seen.found.add(f"{path}.{name}" if path else name)
        return value

    def equal(self, other: object) -> bool:
        return isinstance(other, kind) and all(getattr(self, name) == getattr(other, name) for name in names)

    def hashed(self) -> int:
        return hash(tuple(repr(object.__getattribute__(self, name)) for name in sorted(names)))

    return dataclasses.dataclass(frozen=True, eq=False, init=False)(type(kind.__name__, (kind,), {
        "__getattribute__": read, "__eq__": equal, "__hash__": hashed, "__module__": kind.__module__}))


def _beside(frame: FrameType | None) -> bool:
    """Whether a stage that is run prints what it will do, by a module that its digest leaves out."""
    beside = _printing(sys.argv[0])
    while beside and frame is not None:
        if frame.f_globals.get("__name__") == beside:
            return True
        frame = frame.f_back
    return False


@functools.cache
def _printing(stage: str) -> str:
    """The module by which a stage prints what it will do, empty where there is none."""
    return digest._after(digest.BESIDE, digest._file(stage))


def main() -> None:
    """Run the commands; see the head of the file."""
    commands, result = map(Path, sys.argv[1:])
    read: dict[str, set[str]] = defaultdict(set)
    present: list[str] = []
    plain = load.load_resolved
    load.load_resolved = lambda *arguments, **options: recorded(plain(*arguments, **options), "", read[present[-1]])
    for command in json.loads(commands.read_text()):
        words = shlex.split(FOLDER_OF.sub(lambda match: str(Path(match[1]).parent), command.partition(" 2>&1")[0]))
        begin = words.index("-m")
        module = words[begin + 1]
        present.append(module.removeprefix("pipeline."))
        sys.argv = [module, *words[begin + 2:]]
        try:
            runpy.run_module(module, run_name="__main__")
        except SystemExit as ended:
            if ended.code:
                raise
    result.write_text(json.dumps({stage: sorted(keys) for stage, keys in read.items()}))


if __name__ == "__main__":
    main()
