"""From plain data (YAML, JSON) to the dataclasses that declare their fields with ``sim.parameters.parameter``.

Nothing is raised on the way: every error is collected with its file and key, so that the user sees all of them at once.
"""
import dataclasses
import math
import types
import typing
import unicodedata
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from pipeline.base.errors import UserError
from pipeline.base.words import nearest, printable
from pipeline.scenes.units import is_bare, likely, looks_like_degrees, parse_quantity
from pipeline.scenes.value_files import READERS

Key = tuple[str | int, ...]
Find = Callable[[str, Key], Path | None]
SMALLEST, LARGEST = 1e-30, 1e30  # of a number in SI units: its powers stay numbers
_LONG = 0.1  # m, from which a length without a unit may be meant in mm
MOST_PLACES = 3  # of a key that are told
MOST_MESSAGES = 20  # that are shown of one file
UNWRITABLE = ("Cc", "Cs")  # kinds of characters: controls, and halves of a pair (surrogates)
_SWITCHES = {"true": ("yes", "on", "1", "ja", "oui"), "false": ("no", "off", "0", "nein", "non")}
FAILED = object()  # stands for a value that could not be read; its error is collected


class NotRead(Exception):
    """A field of an incomplete record was asked for."""


class Incomplete:
    """A record with fields that could not be read: the others can still be checked, before the errors are raised."""

    def __init__(self, values: Mapping[str, Any]):
        vars(self).update((name, value) for name, value in values.items() if value is not FAILED)

    def __getattr__(self, name: str) -> Any:
        raise NotRead(name)


class Errors:
    """The errors of one scene, one sentence each; of many the first ones are kept, and their number.

    Parameters
    ----------
    file : file to name.

    Attributes
    ----------
    messages : the first of them, each once. count : of all.
    origins : file in which a key was written, where that can be another one because of ``extends``.
    bare : lengths in m, too long for an eye, that were written without a unit, by their keys.
    """

    def __init__(self, file: str | Path):
        self.messages: dict[str, None] = {}
        self.count = 0
        self.origins: dict[Key, Path] = {}
        self.bare: dict[Key, Any] = {}
        self._file = file

    def add(self, key: Key, message: str) -> None:
        """Collect "<file>: <key> <message>", and what was probably meant by lengths that carry no unit."""
        bare = next((value for one, value in self.bare.items() if one[:len(key)] == key and len(one) <= len(key) + 1),
                    None) if key else None
        if bare is not None and "did you mean" not in message:
            message += likely(bare, "m")
        parents = (key[:length] for length in range(len(key), 0, -1))
        origin = next((self.origins[parent] for parent in parents if parent in self.origins), self._file)
        file = self._file if origin == self._file else f"{self._file} (inherited from {origin})"
        message = printable(message, len(message))  # it may list names that the file has
        self.take(f"{file}: {dotted(key)} {message}" if key else f"{file}: {message}")

    def take(self, sentence: str) -> None:
        """Collect a whole sentence."""
        if sentence not in self.messages:
            self.count += 1
            if len(self.messages) < MOST_MESSAGES:
                self.messages[sentence] = None

    def raise_any(self) -> None:
        """Raise the collected errors, if any, as one UserError."""
        more = self.count - len(self.messages)
        if self.messages:
            raise UserError(*self.messages, *([f"{self._file}: and {more} more errors"] if more else []))


class Reader:
    """Reads values as their declared types.

    Parameters
    ----------
    errors : collects what is wrong.
    liquids : what a parameter that names a liquid may be; anything if there are none, which is an error of its own.
    find : returns the file that a parameter names in place of its values, or collects an error; none can be named
        without it.
    written : whether people have written the values: what looks like another unit is asked back.
    places : where keys stand, by their names, for those that are written elsewhere.
    """

    def __init__(self, errors: Errors, liquids: Iterable[str] = (), find: Find | None = None, written: bool = True,
                 places: Mapping[str, list[str]] | None = None):
        self._errors = errors
        self._places = places or {}
        self._written = written
        self._find = find
        self._liquids = tuple(liquids) or None

    def record(self, cls: Any, data: Any, key: Key = (), base: Any = None) -> Any:
        """Return an instance of the dataclass ``cls``, or an ``Incomplete`` one.

        What ``data`` leaves out is taken from ``base``, if given.
        """
        if not self.is_mapping(data, key):
            return Incomplete({})
        fields = {field.name: field for field in dataclasses.fields(cls)}
        self.refuse_unknown(data, fields, key)
        values = {name: self.field(field, data.get(name, dataclasses.MISSING), (*key, name), base)
                  for name, field in fields.items()}
        return Incomplete(values) if FAILED in values.values() else cls(**values)

    def field(self, field: Any, data: Any, key: Key, base: Any = None) -> Any:
        """Return the value of one field of a dataclass: from ``data``, from ``base`` or its default."""
        if data is not dataclasses.MISSING:
            return self._value(field.type, field.metadata, data, key)
        if base is not None:
            return getattr(base, field.name)
        if field.default is not dataclasses.MISSING:
            return field.default
        if field.default_factory is not dataclasses.MISSING:
            return field.default_factory()
        reason = field.metadata["reason"]
        self._errors.add(key, f"is missing ({field.metadata['meaning']})" + (f": {reason}" if reason else ""))
        return FAILED

    def is_mapping(self, data: Any, key: Key) -> bool:
        """Tell whether ``data`` is a mapping; collect an error if not."""
        if not isinstance(data, dict):
            self._fail(key, data, "must be a mapping (`name: value` lines)")
        return isinstance(data, dict)

    def refuse_unknown(self, data: Mapping, names: Iterable[str], key: Key) -> None:
        """Collect an error for every key of ``data`` that is not in ``names``."""
        names = list(names)
        for name in [name for name in data if name not in names]:
            known = f"known here are {', '.join(names)}" if names else "nothing can be set here"
            places = self._places.get(str(name), []) if len(key) < 2 else []
            meant = f" (did you mean {' or '.join(places)}?)" if 0 < len(places) <= MOST_PLACES else \
                nearest(name, names)
            self._errors.add((*key, name), f"is not known{meant}; {known}")

    def _value(self, kind: Any, metadata: Mapping, data: Any, key: Key) -> Any:
        origin, arguments = typing.get_origin(kind), typing.get_args(kind)
        if origin is types.UnionType:  # X | None
            return None if data is None else self._value(arguments[0], metadata, data, key)
        if metadata.get("file") and isinstance(data, str) and self._find is not None:
            return self._from_file(kind, metadata, data, key)
        if dataclasses.is_dataclass(kind):
            return self.record(kind, data, key)
        if "kinds" in metadata:
            return self._chosen_records(metadata["kinds"], data, key)
        if origin is tuple:
            return self._tuple(arguments, metadata, data, key)
        if origin is dict:
            return self._dict(arguments[1], metadata, data, key)
        return {float: self._number, int: self._number, bool: self._bool, str: self._text}[kind](
            kind, metadata, data, key)

    def _from_file(self, kind: Any, metadata: Mapping, name: str, key: Key) -> Any:
        """Read the values of a parameter from a file that stands in their place."""
        path = self._find(name, key)
        if path is None:
            return FAILED
        try:
            values = READERS[metadata["file"]](path)
        except UserError as error:
            for sentence in error.messages:
                self._errors.add(key, f"is {describe(name)}, but {sentence}")
            return FAILED
        return self._value(kind, metadata, values, key)

    def _chosen_records(self, kinds: Mapping[str, type], data: Any, key: Key) -> Any:
        """Read a mapping whose keys choose the dataclass."""
        if not self.is_mapping(data, key):
            return FAILED
        self.refuse_unknown(data, kinds, key)
        return {name: self.record(kinds[name], data[name], (*key, name)) for name in kinds if name in data}

    def _tuple(self, kinds: tuple, metadata: Mapping, data: Any, key: Key) -> Any:
        if not isinstance(data, (list, tuple)):
            return self._fail(key, data, f"must be a list{_meaning(metadata)}")
        if kinds[-1] is Ellipsis:
            kinds = kinds[:1] * len(data)
        elif len(data) != len(kinds):
            self._errors.add(key, f"has {len(data)} entries, but must have {len(kinds)}{_meaning(metadata)}")
            return FAILED
        values = tuple(self._value(kind, metadata, item, (*key, index))
                       for index, (kind, item) in enumerate(zip(kinds, data, strict=True)))
        return FAILED if FAILED in values else values

    def _dict(self, kind: Any, metadata: Mapping, data: Any, key: Key) -> Any:
        if not self.is_mapping(data, key):
            return FAILED
        if metadata["liquid"] and self._liquids:
            self.refuse_unknown(data, self._liquids, key)
        values = {name: self._value(kind, {**metadata, "liquid": False}, item, (*key, name))
                  for name, item in data.items()}
        return FAILED if FAILED in values.values() else values

    def _number(self, kind: type, metadata: Mapping, data: Any, key: Key) -> Any:
        try:
            number = parse_quantity(data, metadata["unit"])
        except ValueError as error:
            self._errors.add(key, f"is {error}{_meaning(metadata)}")
            return FAILED
        if kind is int and not number.is_integer():
            return self._fail(key, data, f"must be a whole number{_meaning(metadata)}")
        unit = metadata["unit"]
        if not _in_range(number, metadata):
            is_share = metadata["maximum"] is not None and metadata["maximum"] <= 1.0
            meant = likely(data, unit, lambda one: _in_range(one, metadata)) if unit or is_share else ""
            return self._fail(key, data, f"must be {allowed_range(metadata)}{meant}{_meaning(metadata)}")
        if self._written and looks_like_degrees(data, unit):
            self._errors.add(key, f"is {describe(data)} without a unit, which would be {math.degrees(number):.4g} deg, "
                                  f"but must be in deg or rad{likely(data, unit)}{_meaning(metadata)}")
            return FAILED
        if unit == "m" and abs(number) >= _LONG and is_bare(data):
            self._errors.bare[key] = data
        if number and not SMALLEST <= abs(number) <= LARGEST:
            return self._fail(key, data, f"must be 0, or from {SMALLEST:g} to {LARGEST:g} in size{_meaning(metadata)}")
        return kind(number)

    def _bool(self, kind: type, metadata: Mapping, data: Any, key: Key) -> Any:
        meant = next((f" (did you mean {word}?)" for word, others in _SWITCHES.items()
                      if str(data).lower() in (word, *others)), "")
        return data if isinstance(data, bool) else self._fail(
            key, data, f"must be true or false{meant}{_meaning(metadata)}")

    def _text(self, kind: type, metadata: Mapping, data: Any, key: Key) -> Any:
        choices = self._liquids if metadata["liquid"] else metadata["choices"]
        if choices is not None and data not in choices:
            return self._fail(key, data, f"must be one of {', '.join(choices)}{nearest(data, choices)}")
        if not isinstance(data, str):
            return self._fail(key, data, f"must be text, in quotes if it looks like a number{_meaning(metadata)}")
        if metadata["longest"]:
            data = " ".join(data.split())  # a line break is a space: pictures and plots have one line for it
            if len(data) > metadata["longest"]:
                return self._fail(key, data, f"must have at most {metadata['longest']} characters{_meaning(metadata)}")
        if any(unicodedata.category(letter) in UNWRITABLE for letter in data):
            return self._fail(key, data, f"must be made of characters that can be written{_meaning(metadata)}")
        return data

    def _fail(self, key: Key, data: Any, message: str) -> Any:
        self._errors.add(key, f"is {describe(data)}, but {message}")
        return FAILED


def dotted(key: Key) -> str:
    """Return a key as users write it.

    >>> dotted(("effects", "gravity", "turns", 0, "to"))
    'effects.gravity.turns[0].to'
    """
    return "".join(f"[{part}]" if isinstance(part, int) else f".{printable(part)}" for part in key).removeprefix(".")


def describe(data: Any) -> str:
    """Return data of a user's file as an error message names it."""
    if isinstance(data, (dict, list, tuple)):
        return "a mapping" if isinstance(data, dict) else "a list"
    if data is None:
        return "empty"
    return str(data).lower() if isinstance(data, bool) else f'"{printable(data)}"' if isinstance(data, str) else \
        printable(str(data))


def allowed_range(metadata: Mapping) -> str:
    """Return the range of a number in words, "" if it has none."""
    unit = f" {metadata['unit'].replace('**', '').replace('*', ' ')}" if metadata["unit"] else ""
    bounds = (("above", "exclusive_minimum"), ("at least", "minimum"), ("at most", "maximum"))
    in_degrees = (lambda bound: f" ({math.degrees(bound):g} deg)") if metadata["unit"] == "rad" else lambda bound: ""
    return " and ".join(f"{words} {metadata[name]:g}{unit}{in_degrees(metadata[name])}" for words, name in bounds
                        if metadata[name] is not None)


def _in_range(number: float, metadata: Mapping) -> bool:
    low, above, high = (metadata[name] for name in ("minimum", "exclusive_minimum", "maximum"))
    return (low is None or number >= low) and (above is None or number > above) and (high is None or number <= high)


def _meaning(metadata: Mapping) -> str:
    return f" ({metadata['meaning']})"
