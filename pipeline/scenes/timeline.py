"""What is done to the eye of a scene, and when: postures and turns, injection, saccades, jolts of the head.

It is read from the effects, so that what a scene inherits is told as well.
"""
import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence

import yaml

from pipeline.base.words import duration
from pipeline.scenes.fill import fill_at_start
from pipeline.scenes.model import Scene
from sim.effects import REGISTRY

FOR_DIGESTS = "runs effects"
MOST = 12  # spans of one effect; more are told together
MOST_KEYS = 2  # that are named


@dataclasses.dataclass(frozen=True)
class Span:
    """Something that is done.

    Attributes
    ----------
    effect : name of the effect that does it.
    words : what it is.
    begin, end : s.
    second_means : s, where the effect runs in a time-lapse.
    """

    effect: str
    words: str
    begin: float
    end: float
    second_means: float = 1.0


def timeline_of(scene: Scene, fill: Mapping[str, float] | None, cavity_volume: float, end: float | None = None
                ) -> list[Span]:
    """Return what is done in a scene, in the order of time.

    Parameters
    ----------
    fill : share of the cavity that each liquid holds at the start; None where it is not known.
    cavity_volume : m3, in two dimensions m2.
    end : s, of a scene that has ended before its duration is over.
    """
    last = scene.output.duration if end is None else min(end, scene.output.duration)
    found = []
    for name in scene.effects:
        lapse = getattr(scene.effects[name], "second_means", 1.0)  # of postures; a lapse of mixing leaves them alone
        spans = [dataclasses.replace(one, begin=max(one.begin, 0.0), end=min(one.end, last), second_means=lapse)
                 for one in _spans(scene, name, fill, cavity_volume) if one.begin < last]
        if len(spans) > MOST:
            spans = [Span(name, f"{len(spans)} postures and movements: {spans[0].words} first, {spans[-1].words} last",
                          spans[0].begin, spans[-1].end, lapse)]
        found += spans
    return sorted(found, key=lambda one: (one.begin, one.end))


def timeline_in_words(scene: Scene, volume_of: Callable[[Scene], float]) -> str:
    """Return what will be done in a scene, before it is run, as one sentence; empty where nothing is done.

    How full a scene is that starts from another one is not known here, nor how long an injection takes then.

    Parameters
    ----------
    volume_of : returns the volume of the cavity, m3 (in two dimensions m2); asked only where liquid flows in.
    """
    fill = None if scene.start_from else fill_at_start(scene, lambda name: scene)
    flows = any(REGISTRY[name].brings(parameters) for name, parameters in scene.effects.items())
    return in_words(timeline_of(scene, fill, volume_of(scene) if flows else 0.0), scene.output.duration)


def _spans(scene: Scene, name: str, fill, cavity_volume: float) -> Iterator[Span]:
    """Yield what one effect does; `held` are the postures, between which events are the turns."""
    effect, parameters = REGISTRY[name], scene.effects[name]
    # Where a scene has no eye, gravity has a direction and no posture.
    held = effect.held(parameters, scene.output.duration) if scene.eye is not None else ()
    for begin, end, _, words in held:
        yield Span(name, f"on the {_pretty(words)}" if "_side" in words else _pretty(words), begin, end)
    flows = ", ".join(map(_pretty, effect.brings(parameters)))
    spans = effect.events(parameters, fill, cavity_volume) if held else effect.spans(parameters, fill, cavity_volume)
    for words, begin, end in spans:
        if end > begin:
            yield Span(name, f"{flows} flows in" if flows else _pretty(words), begin, end)


def in_words(spans: Sequence[Span], end: float) -> str:
    """Return a timeline as one sentence, such as "supine until 2.3 s; turn to upright 2.3 to 2.8 s".

    Parameters
    ----------
    end : s, of the scene.
    """
    return "; ".join(f"{one.words} {when(one, end)}" for one in spans)


def when(span: Span, end: float) -> str:
    """Return when something is done in a scene of a length, s: "2.3 to 2.8 s", "from 2.8 s", or "throughout"."""
    begins, ends = span.begin <= 0.0, span.end >= end * (1.0 - 1e-9)
    if begins and ends:
        return "throughout"
    edges = [] if begins else [span.begin]
    edges += [] if ends else [span.end]
    word = "until " if begins else "from " if ends else ""
    text = f"{word}{' to '.join(map(_short, edges))} s"
    if span.second_means == 1.0:
        return text
    return f"{text} ({' to '.join(duration(edge * span.second_means) for edge in edges)})"


def inherited(sources: Mapping[str, str]) -> dict[str, str]:
    """Return what a scene inherits of its effects, in words: effect -> "from tamponade.yaml".

    Parameters
    ----------
    sources : files of the scene, name -> YAML, its own first.
    """
    own = next(iter(sources), "")
    origin: dict[str, dict[str, str]] = {}
    for file, text in sources.items():
        for name, value in ((yaml.safe_load(text) or {}).get("effects") or {}).items():
            keys = origin.setdefault(name, {})
            if keys.get("") is None:  # else a file before it has removed what this one says
                for key in value or ():
                    keys.setdefault(key, file)
                if value is None:
                    keys[""] = file
    found = {}
    for name, keys in origin.items():
        elsewhere = {key: file for key, file in keys.items() if key and file != own}
        files = ", ".join(dict.fromkeys(elsewhere.values()))
        if not elsewhere:
            continue
        if len(elsewhere) == sum(map(bool, keys)):
            found[name] = f"from {files}"
        elif len(elsewhere) <= MOST_KEYS:
            found[name] = f"{', '.join(map(_pretty, elsewhere))} from {files}"
        else:
            found[name] = f"in part from {files}"
    return found


def _short(time: float) -> str:
    return f"{time:.2f}".rstrip("0").rstrip(".")


def _pretty(name: str) -> str:
    return name.replace("_", " ")
