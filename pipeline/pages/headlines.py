"""The few numbers of a run that people ask for first, and how sure they are."""
import dataclasses
from collections.abc import Sequence

import numpy as np

from pipeline.measures.least_energy import COVERED, LeastEnergy
from pipeline.measures.metric import LAST
from pipeline.measures.shown import Curve, Shown
from pipeline.scenes.effects import illustration_in_words
from pipeline.scenes.model import Scene
from sim.liquid import GAS_DENSITY

# Of an eye: metric, part, and what it is.
OF_EYE = ((COVERED, "whole", "of the retina is under oil"),
          (COVERED, "inferior", "of its inferior half"), (COVERED, "macula", "of the macula"),
          ("emulsion", "whole", "of emulsion"))
MOST = 4
NARROW = "\u00a0"     # a space that breaks no line


@dataclasses.dataclass(frozen=True)
class Headline:
    """A number in words.

    Attributes
    ----------
    meaning : what it is.
    sure : whether its uncertainty is known.
    at_rest : the same number at rest, of least energy, and how much less or more this run has; empty where that is not
        known.
    """

    number: str
    meaning: str
    sure: bool
    at_rest: str = ""


def headlines_of(scene: Scene, shown: Sequence[Shown], resting: LeastEnergy | None = None) -> list[Headline]:
    """Return the first numbers of a run of a scene, at its end; none where they would only illustrate.

    Parameters
    ----------
    resting : what the oil would touch at rest.
    """
    if illustration_in_words(scene):
        return []
    found = headlines(shown, of_eye=scene.container is None, resting=resting)
    found = [dataclasses.replace(one, meaning=f"{one.meaning}{what_of_it(shown)}")
             if one.meaning == OF_EYE[0][2] else one for one in found]
    if any(liquid.density < GAS_DENSITY for liquid in scene.liquids):
        return [dataclasses.replace(one, meaning=one.meaning.replace("under oil", "under gas")) for one in found]
    return found


def what_of_it(shown: Sequence[Shown]) -> str:
    """Return what of the retina under oil it touches and what is over films, in words; empty where not known.

    The numbers are those of the tables.
    """
    ends = {(one.metric.name, curve.part): curve for one in shown for curve in one.curves}
    touched, film = (ends.get((name, "whole")) for name in ("retina_contact", "retina_film"))
    if touched is None or film is None or not np.isfinite(film.values[-1]):
        return ""
    thick = [ends["retina_film_thickness", end].text(-1) for end in ("smallest", "largest")]
    how_thick = f" of {thick[0]} to {thick[1]} µm" if all(thick) else ""
    return f": it touches {touched.text(-1)} %, {film.text(-1)} % are on a film of aqueous{how_thick}"


def headlines(shown: Sequence[Shown], of_eye: bool, resting: LeastEnergy | None = None) -> list[Headline]:
    """Return the first numbers of a run, at its end.

    Parameters
    ----------
    shown : metrics in the order of interest.
    of_eye : whether the scene is one of an eye; else the first of what changes is told.
    resting : what the oil would touch at rest.
    """
    if of_eye:
        known = {(one.metric.name, curve.part): (one, curve) for one in shown for curve in one.curves}
        named = [(*known[name, part], meaning, resting.shares.get(part) if resting and name == COVERED else None)
                 for name, part, meaning in OF_EYE if (name, part) in known]
        return [_headline(*one) for one in named if np.isfinite(one[1].values[-1])]
    effects_first = sorted(shown, key=lambda one: one.metric.effect is None)
    chosen = [(one, curve) for one in effects_first if one.metric.place < LAST for curve in one.curves
              if not curve.constant and np.isfinite(curve.values[-1])]
    return [_headline(one, curve, f"{one.name} {curve.part}".strip()) for one, curve in chosen[:MOST]]


def _headline(one: Shown, curve: Curve, meaning: str, at_rest: float | None = None) -> Headline:
    beside = ""
    if at_rest is not None:
        less = curve.beside(abs(curve.values[-1] - at_rest), -1)
        apart = "the same here" if float(less) == 0.0 else (
            f"{less} percentage points {'less' if curve.values[-1] < at_rest else 'more'} here")
        beside = f"{curve.beside(at_rest, -1)}{NARROW}{one.unit}, {apart}"
    return Headline(f"{curve.text(-1)} {one.unit}".strip(), meaning, bool(np.isfinite(curve.uncertainty[-1])), beside)
