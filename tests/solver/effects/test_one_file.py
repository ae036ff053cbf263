"""All that is known of an effect or of a scheme is in its file: no other file knows it by name."""
import ast
from pathlib import Path

import pytest
from conftest import ROOT

from sim import effects, schemes

PACKAGES = {"effects": effects.REGISTRY, "schemes": schemes.REGISTRY}
NAMES = {name: folder for folder, registry in PACKAGES.items() for name in registry}
REGISTRIES = ("sim/effects/__init__.py", "sim/schemes/__init__.py")
# File and name that it may know, with the reason.
ALLOWED = {
    # One physics in two forms: one is replaced by the other where that is cheaper.
    ("sim/effects/viscosity_implicit.py", "viscosity"),
    # One scheme in two files: with and without a free surface.
    ("sim/schemes/volume_incompressible_clamped.py", "volume_incompressible"),
    ("sim/schemes/volume_incompressible.py", "volume_incompressible_clamped"),
    # Words, not the effect: a vector in the files of frames, and what is written beside its arrow.
    ("pipeline/base/frame_files.py", "gravity"),
    ("pipeline/pictures/section_panel.py", "gravity"),
    ("pipeline/pictures/container_panel.py", "gravity"),
    ("pipeline/illustration/lettering.py", "gravity"),
}


def known_in(code: str) -> set[str]:
    """Return the effects and schemes that a file knows: as a word of a key, by an import or as an attribute."""
    found = set()
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " not in node.value.strip():
            found |= NAMES.keys() & set(node.value.split("."))
        elif isinstance(node, ast.ImportFrom) and node.module:
            modules = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            found |= set().union(*map(in_module, modules))
        elif isinstance(node, ast.Import):
            found |= set().union(*(in_module(alias.name) for alias in node.names))
    return found


def in_module(module: str) -> set[str]:
    """Return the effect or scheme whose file a module is, also a part of a scheme such as that of free surfaces."""
    parts = module.split(".")
    files = {path.stem for folder in PACKAGES for path in (ROOT / "sim" / folder).glob("*.py")}
    own = files - {"__init__", "effect", "scheme"}
    return {parts[2]} & own if parts[0] == "sim" and len(parts) > 2 and parts[1] in PACKAGES else set()


def files() -> list[Path]:
    found = [path for package in ("pipeline", "sim") for path in (ROOT / package).rglob("*.py")]
    return [path for path in found if not str(path.relative_to(ROOT)).startswith(REGISTRIES)]


@pytest.mark.thorough
def test_no_other_file_knows_an_effect_or_a_scheme_by_name():
    known = {(str(path.relative_to(ROOT)), name) for path in files() for name in known_in(path.read_text())
             if not (path.stem == name and path.parent.name in PACKAGES)}
    assert known <= ALLOWED
    assert known >= ALLOWED, "an exception that is none"


@pytest.mark.parametrize("code", [
    'scene.effects.get("gravity")', 'limits["effects.interface_tension"] = 1.0',
    "from sim.effects.drift import rise_speed", "import sim.schemes.wcsph", "from sim.schemes import wcsph",
    'if numerics.scheme == "dfsph": pass', 'state |= {"injection.finished": True}'])
def test_a_name_is_found_however_it_is_written(code):
    assert len(known_in(code)) == 1


@pytest.mark.parametrize("folder", PACKAGES)
def test_an_effect_or_a_scheme_is_in_the_file_of_its_name(folder):
    """Whether a stage runs again after a change is told by the files that a scene calls for."""
    for name, kind in PACKAGES[folder].items():
        assert kind.__module__ == f"sim.{folder}.{name}" and kind.Parameters.__module__.startswith(f"sim.{folder}.")
