"""What a scene shows, told from its liquids and effects: for scenes whose file does not say it, and for logs."""
from collections.abc import Callable

from pipeline.scenes.fill import fill_at_start
from pipeline.scenes.model import AT_REST, Scene
from sim.effects import REGISTRY

MOST_POSTURES = 8  # in a sentence


def postures_in_words(scene: Scene) -> str:
    """Return the postures of an eye over time; empty where nothing has a weight.

    Times are simulated seconds: "supine until 2.3 s, upright from 2.8 s".
    """
    if scene.eye is None:
        return ""
    held = [one for name, parameters in scene.effects.items()
            for one in REGISTRY[name].held(parameters, scene.output.duration)]
    names = [f"{'on the ' if '_side' in name else ''}{_pretty(name)}" for *_, name in held]
    if len(held) == 1:
        return f"{names[0]} throughout"
    if len(held) > MOST_POSTURES:
        return f"{len(held)} postures, {names[0]} at first and {names[-1]} at the end"
    spans = [f"until {end:.4g} s" if not begin else f"from {begin:.4g} s" if index == len(held) - 1 else
             f"from {begin:.4g} to {end:.4g} s" for index, (begin, end, *_) in enumerate(held)]
    return ", ".join(f"{name} {span}" for name, span in zip(names, spans, strict=True))


def description_of(scene: Scene, load: Callable[[str], Scene]) -> str:
    """Return what the liquids of a scene are, how they begin, what flows in, postures over time, and the effects.

    Parameters
    ----------
    load : returns a scene by its name: one that starts from another one has its liquids.
    """
    fill = fill_at_start(scene, load)
    if scene.start_from is not None:
        said = [f"goes on from the end of {scene.start_from}"]
    elif fill is None or len(fill) == 1:
        within = fill or [liquid.name for liquid in scene.liquids]
        said = [f"{' and '.join(map(_pretty, within))} in {'an eye' if scene.eye else 'a container'}"]
    else:
        shares = " and ".join(f"{100.0 * share:g} % {_pretty(name)}" for name, share in fill.items())
        said = [f"{shares}, {'at rest' if scene.initial.shape == AT_REST else 'level'} at the start"]
    for name, parameters in scene.effects.items():
        end = REGISTRY[name].fill_at(parameters, fill or {})
        said += [f"{_pretty(liquid)} flows in until it holds {100.0 * end[liquid]:g} %"
                 for liquid in REGISTRY[name].brings(parameters)]
    said += [postures_in_words(scene), "effects: " + (", ".join(map(_pretty, scene.effects)) or "none")]
    return " ".join(f"{one[0].upper()}{one[1:]}." for one in said if one)


def _pretty(name: str) -> str:
    return name.replace("_", " ")
