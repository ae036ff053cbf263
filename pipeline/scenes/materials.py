"""Named liquids: those of ``config/materials.yaml`` and what a scene changes about them."""
import contextlib
import dataclasses
import functools
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pipeline.base.words import nearest
from pipeline.scenes.model import Material
from pipeline.scenes.reader import FAILED, Errors, Incomplete, Key, Reader, describe
from pipeline.scenes.units import is_bare, is_kinematic_viscosity, likely, parse_quantity
from pipeline.scenes.yaml_files import read_yaml

UNLIKELY = 30.0  # factor off the liquid's own number from which one without a unit is asked back
PROPERTIES = tuple(field.name for field in dataclasses.fields(Material) if field.name != "name")


def load_materials(path: Path) -> dict[str, Material]:
    """Return the liquids of ``materials.yaml`` by name.

    Raises
    ------
    UserError
        With one sentence for every error of the file.
    """
    errors = Errors(path)
    reader = Reader(errors)
    materials = {name: _read_material(name, data, (name,), reader) for name, data in read_yaml(path).items()}
    errors.raise_any()
    return materials


def read_liquids(data: Any, materials: Mapping[str, Material], reader: Reader, errors: Errors) -> Any:
    """Return the tuple of liquids that ``liquids`` of a scene names, in its order, with the scene's changes."""
    key = ("liquids",)
    if not isinstance(data, dict):
        errors.add(key, f"is {describe(data)}, but must be a list of liquids, or a mapping of them to changes")
        return FAILED
    for name in [name for name in data if name not in materials]:
        errors.add((*key, name), f"is no liquid of materials.yaml{nearest(name, materials)}; known are "
                                 f"{', '.join(materials)}; add a new one to config/materials.yaml, with density and "
                                 "dynamic_viscosity")
    liquids = tuple(_read_material(name, change, (*key, name), reader, materials[name])
                    for name, change in data.items() if name in materials)
    doubtful = [liquid for liquid in liquids if isinstance(liquid, Material) and _asked_back(
        data[liquid.name], materials[liquid.name], (*key, liquid.name), errors)]
    return liquids if len(liquids) == len(data) and not doubtful else FAILED


def _read_material(name: str, data: Any, key: Key, reader: Reader, base: Material | None = None) -> Any:
    if not reader.is_mapping(data, key):
        return Incomplete({"name": name})
    reader.refuse_unknown(data, PROPERTIES, key)
    properties = {"name": name} | {name: data[name] for name in PROPERTIES if name in data}
    if is_kinematic_viscosity(properties.get("dynamic_viscosity")):
        density = properties.get("density", base.density if base else None)
        properties["dynamic_viscosity"] = _dynamic(properties["dynamic_viscosity"], density)
    return reader.record(Material, properties, key, base)


def _asked_back(change: Any, base: Material, key: Key, errors: Errors) -> bool:
    """Collect an error for a number without a unit that fits the liquid in another unit only; tell whether there is."""
    asked = False
    for name, unit in (("density", "kg/m**3"), ("dynamic_viscosity", "Pa*s")):
        with contextlib.suppress(ValueError, AttributeError):
            number, usual = parse_quantity(change.get(name), unit), getattr(base, name)
            if number <= 0.0 or usual <= 0.0 or not is_bare(change[name]):
                continue
            nearer = functools.partial(_is_nearer, number, usual)
            if meant := _off(number, usual) > UNLIKELY and likely(change[name], unit, nearer):
                spelled = unit.replace("**", "").replace("*", " ")
                errors.add((*key, name), f"is {change[name]} without a unit, but {base.name} has {usual:g} {spelled}"
                                         f"{meant}; write {change[name]} {spelled} if that is meant")
                asked = True
    return asked


def _is_nearer(number: float, usual: float, other: float) -> bool:
    """Whether another number is nearer to the usual one than a number is."""
    return _off(other, usual) < _off(number, usual)


def _off(number: float, usual: float) -> float:
    """Factor by which a number is off another one, in either direction."""
    return math.exp(abs(math.log(number / usual)))


def _dynamic(kinematic_viscosity: str, density: Any) -> float:
    """Return the dynamic viscosity in Pa s; oils are sold by their kinematic viscosity ("5000 cSt")."""
    try:
        value = parse_quantity(kinematic_viscosity, "m**2/s") * parse_quantity(density, "kg/m**3")
    except ValueError:
        return 0.0  # the density is wrong, which is an error of its own
    return float(f"{value:.15g}")
