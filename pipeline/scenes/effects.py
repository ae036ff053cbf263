"""What the effects of a scene know and declare, whichever they are."""
from typing import Any

import numpy as np

from pipeline.scenes.fill import fill_at_start
from pipeline.scenes.model import Scene
from sim.effects import REGISTRY
from sim.effects.effect import MIXES

FOR_DIGESTS = "runs effects"
SOLVES = ("pressure", *(effect.solves for effect in REGISTRY.values() if effect.solves))  # iterative, in statistics
OFF = "To switch an effect off, even an inherited one, set it to null, as in effects: {NAME: null}"


def known_by_an_effect(scene: Scene, hook: str) -> Any:
    """Return what the first effect that knows it gives in a hook that takes its parameters; None where none does."""
    answers = (getattr(REGISTRY[name], hook)(parameters) for name, parameters in scene.effects.items())
    return next((one for one in answers if one is not None), None)


def oil_of(scene: Scene) -> int:
    """Return the phase index of the oil, or of the gas in its place.

    It is the most viscous liquid that is not clear, of those that form an interface.
    """
    oil = known_by_an_effect(scene, "interface_oil")
    if oil is not None:
        return [liquid.name for liquid in scene.liquids].index(oil)
    liquids = scene.liquids
    colored = not all(liquid.clear for liquid in liquids)
    return max((index for index, liquid in enumerate(liquids) if not (colored and liquid.clear)),
               key=lambda index: liquids[index].dynamic_viscosity)


def contact_angle_of(scene: Scene) -> float | None:
    """Return the contact angle at the wall, measured through the liquid that is not the oil, rad; None without one."""
    through_first = known_by_an_effect(scene, "contact_angle_of")
    if through_first is None:
        return None
    return float(np.pi - through_first if oil_of(scene) == 0 else through_first)


def sum_of_effects(scene: Scene, hook: str) -> float:
    """Return the sum of what the effects of a scene give in a hook that takes their parameters."""
    return sum(getattr(REGISTRY[name], hook)(parameters) for name, parameters in scene.effects.items())


def down_at_start(scene: Scene) -> np.ndarray | None:
    """Return the direction (3,) of gravity in the frame of the scene at its start; None without gravity."""
    return known_by_an_effect(scene, "down_at_start")


def effects_that(scene: Scene, declaration: str) -> list[str]:
    """Return the names of the effects of a scene that declare something, such as `turns_eye`."""
    return [name for name in scene.effects if getattr(REGISTRY[name], declaration)]


def does(scene: Scene, what: str) -> bool:
    """Whether an effect of a scene does something, in the words of ``sim.effects.effect``."""
    return any(what in REGISTRY[name].does for name in scene.effects)


def illustration_in_words(scene: Scene) -> str:
    """Return one sentence where the numbers of a scene only illustrate; empty where they mean what they say.

    In a time-lapse of liquids that mix only the mixing is sped up, not how they settle.
    """
    if scene.output.second_means is None or not does(scene, MIXES):
        return ""
    return ("Only the mixing is sped up here, after the picture of an emulsion by Song et al.: the numbers of this run "
            "illustrate that picture, and are no prediction")


def places_at_work(scene: Scene, time: float, cavity_volume: float) -> list[tuple[str, tuple[float, ...]]]:
    """Return names and points (m) of what works at a time (s) at a place in the cavity, such as a cannula.

    ``cavity_volume`` is in m3. How full a scene is that starts from another one is not known here: nothing is returned.
    """
    if scene.start_from is not None:
        return []
    found = []
    fill = fill_at_start(scene, lambda name: scene)
    for name, parameters in scene.effects.items():
        effect = REGISTRY[name]
        if any(begin <= time < end for _, begin, end in effect.spans(parameters, fill, cavity_volume)):
            found += [(key.replace("_", " "), getattr(parameters, key)) for key in effect.inside]
    return found


def droplets_of(scene: Scene) -> int | None:
    """Return the phase index of the liquid that is oil in droplets; None in a scene that makes none."""
    name = known_by_an_effect(scene, "droplet_liquid")
    return None if name is None else [liquid.name for liquid in scene.liquids].index(name)


def knows_films(scene: Scene) -> bool:
    """Whether theory tells where oil lies on films of aqueous: in an eye, where aqueous wets the wall.

    Two liquids are kept apart by a tension, and gravity acts.
    """
    angle = contact_angle_of(scene)
    return (scene.container is None and len(scene.liquids) == 2 and not does(scene, MIXES)
            and all(liquid.dynamic_viscosity > 0.0 for liquid in scene.liquids)
            and sum_of_effects(scene, "tension_of") > 0.0 and sum_of_effects(scene, "weight_of") > 0.0
            and angle is not None and 0.0 < angle < 0.5 * np.pi)
