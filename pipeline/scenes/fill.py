"""Which shares of the cavity the liquids of a scene hold at its start and at its end, as far as the scene tells."""
from collections.abc import Callable

from pipeline.scenes.model import Scene
from sim.effects import REGISTRY

FOR_DIGESTS = "runs effects"
Fill = dict[str, float]


def fill_at_start(scene: Scene, load: Callable[[str], Scene]) -> Fill | None:
    """Return the share of the cavity that each liquid holds at the start, by name; None for blocks.

    Parameters
    ----------
    load : returns a scene by name. Where one starts from another one, its start is what that one ends with, unmixed.
    """
    if scene.blocks:
        return None
    if scene.start_from is not None:
        return fill_at_end(load(scene.start_from), load)
    return scene.initial.fill or {scene.initial.liquid or scene.liquids[0].name: 1.0}


def fill_at_end(scene: Scene, load: Callable[[str], Scene]) -> Fill | None:
    """Return the same for the end of a scene, when all is injected that will be."""
    fill = fill_at_start(scene, load)
    for name, parameters in scene.effects.items() if fill else ():
        fill = REGISTRY[name].fill_at(parameters, fill)
    return fill
