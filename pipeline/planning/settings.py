"""What a plan assumes: ``config/plan.yaml``, with its liquids and the postures that there are."""
import dataclasses
import functools

import numpy as np

from pipeline.base.errors import UserError
from pipeline.base.words import nearest
from pipeline.scenes.load import PROJECT_CONFIG
from pipeline.scenes.materials import load_materials
from pipeline.scenes.model import LARGEST_ANGLE, SMALLEST_ANGLE, Material
from pipeline.scenes.reader import Errors, Reader
from pipeline.scenes.yaml_files import read_yaml
from sim.effects import REGISTRY
from sim.effects.effect import WEIGHS
from sim.parameters import parameter

FOR_DIGESTS = "runs effects"
ANGLE = "how strongly the retina prefers aqueous to oil"    # what a contact angle says, for readers


@dataclasses.dataclass(frozen=True)
class Settings:
    """What a plan assumes."""

    other_liquid: str = parameter(meaning="liquid that the oil displaces")
    oils: tuple[str, ...] = parameter(meaning="oils that can be asked for")
    tension: float = parameter(unit="N/m", exclusive_minimum=0.0, maximum=0.2, meaning="interface tension")
    contact_angle: float = parameter(unit="rad", minimum=SMALLEST_ANGLE, maximum=LARGEST_ANGLE,
                                     meaning="contact angle through the other liquid")
    other_angles: tuple[float, ...] = parameter(unit="rad", minimum=SMALLEST_ANGLE, maximum=LARGEST_ANGLE,
                                                meaning="contact angles that are possible too")
    largest_fill: float = parameter(minimum=0.5, maximum=0.99, meaning="largest share of the cavity that gets filled")
    confirming_scene: str = parameter(meaning="scene that a confirming one starts from")


def load_settings() -> tuple[Settings, dict[str, Material]]:
    """Return the settings, and all liquids by name.

    Raises
    ------
    UserError : with one sentence for every error of the files.
    """
    path = PROJECT_CONFIG / "plan.yaml"
    errors = Errors(path)
    settings = Reader(errors).record(Settings, read_yaml(path), ())
    errors.raise_any()
    materials = load_materials(PROJECT_CONFIG / "materials.yaml")
    for name in (settings.other_liquid, *settings.oils):
        if name not in materials:
            raise UserError(f"{path}: {name} is no liquid of materials.yaml{nearest(name, materials)}")
    return settings, materials


@functools.cache
def postures() -> dict[str, np.ndarray]:
    """Postures by name, and the direction (3,) of gravity in the eye in each."""
    weight = REGISTRY[weight_name()]
    field = next(field for field in dataclasses.fields(weight.Parameters) if field.name == "posture")
    return {name: weight.down_at_start(weight.Parameters(posture=name)) for name in field.metadata["choices"]}


def weight_name() -> str:
    """Return the name of the effect that knows postures."""
    return next(name for name, effect in REGISTRY.items() if WEIGHS in effect.does)
