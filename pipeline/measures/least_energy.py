"""What the oil of a scene would touch at rest, by the shape of least energy of the fill and posture that it ends with.

It stands beside the numbers of a run: a scene may be far from rest at its end, and particles blur the contact line.
"""
import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.base.errors import UserError
from pipeline.base.frame_files import FrameData
from pipeline.equilibrium.contact import Contact, shares
from pipeline.equilibrium.of_scene import rest_of
from pipeline.scenes.effects import contact_angle_of, does, known_by_an_effect, oil_of, sum_of_effects
from pipeline.scenes.model import Scene
from sim.effects.effect import MIXES
from sim.effects.parts.postures import words_of

COVERED = "retina_coverage"  # the metric that it stands beside
RESTING = "calculated resting shape"    # for readers
FILLS = (0.02, 0.995)  # beyond them there is as good as nothing, or all, to touch


@dataclasses.dataclass(frozen=True)
class LeastEnergy:
    """Oil at rest.

    Attributes
    ----------
    fill : share of the cavity that is oil.
    posture : in words.
    shares : part of the retina -> what the oil touches of it, percent.
    """

    fill: float
    posture: str
    shares: Mapping[str, float]

    def sentence(self) -> str:
        """Return it in one sentence."""
        parts = ", ".join(f"{share:.1f} % ({name})" for name, share in self.shares.items())
        return (f"at rest, {self.posture}, this fill of {100.0 * self.fill:.1f} % touches {parts} of the retina: the "
                f"{RESTING}")

    def explained(self) -> str:
        """Return what the shape is that stands beside a run."""
        return (f"{RESTING[:1].upper()}{RESTING[1:]}: where oil of the same fill ({100.0 * self.fill:.1f} %) and "
                f"posture ({self.posture}) is at rest, in the shape of least energy, computed without particles.")

    @classmethod
    def of(cls, record: Mapping[str, Any]) -> "LeastEnergy":
        """Return what :func:`dataclasses.asdict` has made a record of."""
        return cls(float(record["fill"]), str(record["posture"]), dict(record["shares"]))


def has_least_energy(scene: Scene) -> bool:
    """Whether the shape of the oil at rest follows from the scene: an eye, aqueous and one oil or gas, not mixed."""
    return (scene.eye is not None and len(scene.liquids) == 2 and not does(scene, MIXES)
            and oil_of(scene) == 1 and contact_angle_of(scene) is not None
            and known_by_an_effect(scene, "down_at_start") is not None
            and sum_of_effects(scene, "tension_of") > 0.0 and sum_of_effects(scene, "weight_of") > 0.0)


def least_energy_of(scene: Scene, frame: FrameData, cavity_volume: float) -> tuple[LeastEnergy | None, str]:
    """Return the oil of a frame at rest, and a sentence where that is not known; empty for scenes that have no such.

    Parameters
    ----------
    cavity_volume : m3.
    """
    if not has_least_energy(scene):
        return None, ""
    fill, size = float(frame.fill[1]) / cavity_volume, float(np.linalg.norm(frame.gravity))
    if not FILLS[0] <= fill <= FILLS[1] or size == 0.0:
        return None, f"no shape at rest is looked for at a fill of {100.0 * fill:.1f} %"
    down = np.asarray(frame.gravity, float) / size
    try:
        touched = shares(Contact.of(rest_of(scene, down, fill)))
    except UserError as error:
        return None, str(error)
    parts = {"whole": touched.pop("retina")} | {name: share for name, share in touched.items() if name != "wall"}
    return LeastEnergy(fill, words_of(down), {name: 100.0 * share for name, share in parts.items()}), ""


def read_least_energy(path: Path) -> LeastEnergy | None:
    """Read it from what the metrics stage says of its columns; None where it is not known.

    Raises
    ------
    UserError : the file is damaged.
    """
    try:
        record = json.loads(path.read_text(encoding="utf-8")).get("at_rest")
        return None if record is None else LeastEnergy.of(record)
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise UserError(f"{path}: cannot be read ({error}); run the metrics stage again, with --meanings") from error
