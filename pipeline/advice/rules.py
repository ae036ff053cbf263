"""Which effects of a scene are seen in its results, which are not, and which are missing.

What there is to say of an effect is in its file: `Effect.advice` yields one sentence each, with the number that decides
and the threshold it is held against. An effect that a scene does not have can say that it is missing. What a scene may
say but hardly means (``pipeline.scenes.checks.doubts``) is said here too.
"""
from pipeline.scenes.checks import doubts
from pipeline.scenes.model import Scene
from pipeline.scenes.reader import dotted
from sim.advice import NOTE, SEEN_EFFECT, WARNING, Advice, Limit
from sim.effects import REGISTRY
from sim.scales import Scales

FOR_DIGESTS = "all effects speak"
ADVISED = {name for name, effect in REGISTRY.items() if effect.overrides("advice")}


def advice(scene: Scene, scales: Scales, limits: list[Limit]) -> list[Advice]:
    """Return the advice of all effects: warnings first, then what matters, then notes."""
    found = [one for name, effect in REGISTRY.items() for one in effect.advice(scene.effects.get(name), scales, limits)]
    found += [Advice(NOTE, name, f"there is no advice on it: it is none of the {len(ADVISED)} effects known here")
              for name in sorted(scene.effects.keys() - ADVISED)]
    found += [Advice(WARNING, dotted(key).removeprefix("effects."), sentence) for key, sentence in doubts(scene)]
    return sorted(found, key=lambda one: (WARNING, SEEN_EFFECT, NOTE).index(one.level))
