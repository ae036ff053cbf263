"""What of the effects of a scene is left out or done cheaper, by rules that need the scene's numbers alone.

An effect whose coefficient is zero, or whose liquids do not differ, is left out as if it were not listed
(`Effect.idle`): nothing of it is allocated, compiled or launched. Implicit viscosity is advanced explicitly where that
costs no time step (`Effect.instead`); a study, which compares methods, takes what it was told to. Both say so in one
sentence, which the log of a run shows.
"""
import dataclasses

from sim import effects as effect_registry
from sim.settings import Settings
from sim.time_step import known_limits


def without_idle(settings: Settings) -> tuple[Settings, list[str]]:
    """Return the settings with only the effects that act, and why each of the others is left out."""
    kept, notes = [], []
    classes = {effect.Parameters: effect for effect in effect_registry.REGISTRY.values()}
    for parameters in settings.effects:
        effect = classes[type(parameters)]
        reason = effect.idle(parameters, settings)
        if reason:
            notes.append(f"{effect.name} is left out: {reason}")
        else:
            kept.append(parameters)
    return dataclasses.replace(settings, effects=tuple(kept)), notes


def cheapest(settings: Settings) -> tuple[Settings, list[str]]:
    """Return the settings with every effect in its cheapest form, and why any of them was changed."""
    notes = []
    classes = {effect.Parameters: effect for effect in effect_registry.REGISTRY.values()}
    for place, parameters in enumerate(settings.effects):
        effect, largest = classes[type(parameters)], _largest_step(settings)
        found = effect.instead(parameters, settings, largest)
        if found:
            other, reason = found
            changed = dataclasses.replace(settings, effects=(*settings.effects[:place], other,
                                                             *settings.effects[place + 1:]))
            if _largest_step(changed) >= largest:  # another effect may need smaller steps beside it
                settings = changed
                notes.append(f"{effect.name} {reason}")
    return settings, notes


def _largest_step(settings: Settings) -> float:
    """The time step that all limits known before a run allow, s."""
    return min(*known_limits(settings).values(), settings.numerics.time_step or float("inf"))
