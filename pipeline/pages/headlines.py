"""The few numbers of a run that people ask for first, and how sure they are."""
import dataclasses
from collections.abc import Sequence

import numpy as np

from pipeline.measures.metric import LAST
from pipeline.measures.shown import Curve, Shown
from pipeline.scenes.effects import illustration_in_words
from pipeline.scenes.model import Scene
from sim.liquid import GAS_DENSITY

# Of an eye: metric, part, and what it is.
OF_EYE = (("retina_coverage", "whole", "of the retina is under oil"),
          ("retina_coverage", "inferior", "of its inferior half"), ("retina_coverage", "macula", "of the macula"),
          ("emulsion", "whole", "of emulsion"))
IN_PLANE = (("wall_coverage", "", "of the wall is under oil"), ("contact_arc", "", "of the wall under oil, as an arc"))
MOST = 4


@dataclasses.dataclass(frozen=True)
class Headline:
    """A number in words, what it is, and whether its uncertainty is known."""

    number: str
    meaning: str
    sure: bool


def headlines_of(scene: Scene, shown: Sequence[Shown]) -> list[Headline]:
    """Return the first numbers of a run of a scene, at its end; none where they would only illustrate."""
    if illustration_in_words(scene):
        return []
    found = headlines(shown, of_eye=scene.container is None)
    found = [dataclasses.replace(one, meaning=f"{one.meaning}{what_of_it(shown)}")
             if one.meaning == OF_EYE[0][2] else one for one in found]
    if any(liquid.density < GAS_DENSITY for liquid in scene.liquids):
        return [dataclasses.replace(one, meaning=one.meaning.replace("under oil", "under gas")) for one in found]
    return found


def what_of_it(shown: Sequence[Shown]) -> str:
    """Return what of the retina under oil it touches and what is over films, in words; empty where not known.

    The numbers add up to that of the headline.
    """
    ends = {(one.metric.name, curve.part): float(curve.values[-1]) for one in shown for curve in one.curves}
    film = ends.get(("retina_film", "whole"), np.nan)
    if not np.isfinite(film):
        return ""
    touched = round(ends["retina_coverage", "whole"]) - round(film)
    thick = [ends["retina_film_thickness", end] for end in ("smallest", "largest")]
    how_thick = f" of {thick[0]:.0f} to {thick[1]:.0f} µm" if np.isfinite(thick).all() else ""
    return f": it touches {touched} %, {film:.0f} % are on a film of aqueous{how_thick}"


def headlines(shown: Sequence[Shown], of_eye: bool) -> list[Headline]:
    """Return the first numbers of a run, at its end.

    Parameters
    ----------
    shown : metrics in the order of interest.
    of_eye : whether the scene is one of an eye; else the first of what changes is told.
    """
    if of_eye:
        return _named(shown, OF_EYE) or _named(shown, IN_PLANE)
    effects_first = sorted(shown, key=lambda one: one.metric.effect is None)
    chosen = [(one, curve) for one in effects_first if one.metric.place < LAST for curve in one.curves
              if not curve.constant and np.isfinite(curve.values[-1])]
    return [_headline(one, curve, f"{one.name} {curve.part}".strip()) for one, curve in chosen[:MOST]]


def _named(shown: Sequence[Shown], wanted: Sequence[tuple[str, str, str]]) -> list[Headline]:
    known = {(one.metric.name, curve.part): (one, curve) for one in shown for curve in one.curves}
    found = [(*known[name, part], meaning) for name, part, meaning in wanted if (name, part) in known]
    return [_headline(*one) for one in found if np.isfinite(one[1].values[-1])]


def _headline(one: Shown, curve: Curve, meaning: str) -> Headline:
    number, half = float(curve.values[-1]), float(curve.uncertainty[-1])
    sure = bool(np.isfinite(half))
    return Headline(f"{with_uncertainty(number, half) if sure else curve.text(-1)} {one.unit}".strip(), meaning, sure)


def with_uncertainty(number: float, half: float) -> str:
    """Return a number with what it is uncertain by, as whole numbers where that is one or more.

    >>> with_uncertainty(42.461, 15.51), with_uncertainty(99.93, 0.28), with_uncertainty(100.0, 0.0)
    ('42 ± 16', '99.9 ± 0.3', '100')
    """
    if not half > 0.0:
        return f"{number:.0f}"
    digits = 1 if half < 1.0 else 0
    return f"{number:.{digits}f} ± {half:.{digits}f}"
