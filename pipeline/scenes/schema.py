"""What scene files may say, for editors (JSON schema) and for readers (lists); both come from the declared fields."""
import dataclasses
import json
import types
import typing
from collections.abc import Mapping, Sequence
from typing import Any

from pipeline.scenes.model import SCENE_KEYS, Material, Scene
from pipeline.scenes.reader import allowed_range
from sim.effects import REGISTRY
from sim.schemes import REGISTRY as SCHEMES
from sim.settings import Numerics

_BOUNDS = {"minimum": "minimum", "maximum": "maximum", "exclusive_minimum": "exclusiveMinimum"}


def schema_text(materials: Mapping[str, Material]) -> str:
    """Return the JSON schema of scene files.

    Nothing is required, because a scene may inherit it, and null is allowed wherever it can remove what is inherited.
    """
    properties = {field.name: _field_schema(field, list(materials)) for field in dataclasses.fields(Scene)}
    properties["extends"] = {"type": "string", "description": "scene that this one varies, by its name"}
    properties["levels"] = {
        "description": "numerics that this scene changes of an accuracy level, by its name",
        "type": "object", "additionalProperties": _or_null(_record_schema(Numerics, list(materials)))}
    change = _record_schema(Material, list(materials))
    del change["properties"]["name"]
    properties["liquids"] = {
        "description": "liquids; the first is phase 0",
        "anyOf": [
            {"type": "array", "items": {"enum": list(materials)}, "minItems": 1, "uniqueItems": True},
            {"type": "object", "propertyNames": {"enum": list(materials)}, "additionalProperties": _or_null(change)},
        ],
    }
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Scene of the eye-oil pipeline",
        "type": "object",
        "properties": {key: properties[key] for key in SCENE_KEYS},
        "additionalProperties": False,
    }
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def list_text(materials: Mapping[str, Material], levels: Mapping[str, Numerics]) -> str:
    """Return effects and schemes with their parameters, liquids and accuracy levels, in words."""
    lines = ["Effects"]
    for name, effect in REGISTRY.items():
        lines += [f"  {name}", f"    {_first_line(effect.Parameters)}"]
        lines += [f"      {line}" for line in _field_lines(effect.Parameters)]
    lines += ["", "Schemes"]
    for name, scheme in SCHEMES.items():
        lines += [f"  {name}", f"    {_first_line(scheme.Parameters)}"]
        lines += [f"      {line}" for line in _field_lines(scheme.Parameters)]
    lines += ["", "Numerics"] + [f"  {line}" for line in _field_lines(Numerics)]
    lines += ["", "Accuracy levels"]
    lines += [f"  {name}: particle spacing {1000 * level.particle_spacing:g} mm" for name, level in levels.items()]
    lines += ["", "Liquids"]
    for material in materials.values():
        lines += [f"  {material.name}: {material.density:g} kg/m3, {1000 * material.dynamic_viscosity:g} mPa s",
                  f"      {material.source}"]
    return "\n".join(lines) + "\n"


def _field_lines(record: Any) -> list[str]:
    lines = []
    for field in dataclasses.fields(record):
        metadata = field.metadata
        default = "required" if field.default is dataclasses.MISSING else f"default {_shown(field.default)}"
        allowed = ", ".join(metadata["choices"]) if metadata["choices"] else allowed_range(metadata)
        unit = metadata["unit"].replace("**", "") if not allowed else ""
        lines.append(f"{field.name}: {metadata['meaning']} ({'; '.join(filter(None, (unit, allowed, default)))})")
        item = typing.get_args(field.type)
        if item and dataclasses.is_dataclass(item[0]):
            lines += [f"  - {line}" for line in _field_lines(item[0])]
    return lines


def _first_line(record: type) -> str:
    return record.__doc__.strip().split("\n")[0]


def _shown(value: Any) -> str:
    return "none" if value in (None, ()) else f"{value:g}" if isinstance(value, float) else str(value)


def _record_schema(record: Any, liquids: Sequence[str]) -> dict[str, Any]:
    properties = {field.name: _or_null(_field_schema(field, liquids)) for field in dataclasses.fields(record)}
    return {"type": "object", "properties": properties, "additionalProperties": False}


def _field_schema(field: dataclasses.Field, liquids: Sequence[str]) -> dict[str, Any]:
    metadata = field.metadata
    meaning = metadata["meaning"] + (f" [{metadata['unit'].replace('**', '')}]" if metadata.get("unit") else "")
    return {"description": meaning, **_type_schema(field.type, metadata, liquids)}


def _type_schema(kind: Any, metadata: Mapping[str, Any], liquids: Sequence[str]) -> dict[str, Any]:
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin is types.UnionType:
        return _or_null(_type_schema(arguments[0], metadata, liquids))
    if dataclasses.is_dataclass(kind):
        return _record_schema(kind, liquids)
    if "kinds" in metadata:
        kinds = {name: {"description": _first_line(record), **_or_null(_record_schema(record, liquids))}
                 for name, record in metadata["kinds"].items()}
        return {"type": "object", "properties": kinds, "additionalProperties": False}
    if metadata.get("file"):
        values = _type_schema(kind, {**metadata, "file": ""}, liquids)
        return {"anyOf": [{"type": "string", "description": "file beside the scene"}, values]}
    if origin is tuple:
        length = {} if arguments[-1] is Ellipsis else {"minItems": len(arguments), "maxItems": len(arguments)}
        return {"type": "array", "items": _type_schema(arguments[0], metadata, liquids), **length}
    if origin is dict:
        value = _type_schema(arguments[1], {**metadata, "liquid": False}, liquids)
        return {"type": "object", "propertyNames": {"enum": list(liquids)}, "additionalProperties": _or_null(value)}
    if kind is bool:
        return {"type": "boolean"}
    if kind is str:
        choices = liquids if metadata["liquid"] else metadata["choices"]
        return {"enum": list(choices)} if choices else {"type": "string"}
    bounds = {name: metadata[key] for key, name in _BOUNDS.items() if metadata[key] is not None}
    return {"anyOf": [{"type": "number", **bounds}, {"type": "string", "pattern": r"^\s*[+-]?[0-9.]"}]}


def _or_null(schema: dict[str, Any]) -> dict[str, Any]:
    return {"anyOf": [schema, {"type": "null"}]}
