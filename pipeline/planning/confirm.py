"""A scene that confirms an answer by one simulation: the oil comes to rest from a level start."""
import dataclasses
from pathlib import Path

import numpy as np
import yaml

from pipeline.planning.search import Answer, Question
from pipeline.planning.settings import weight_name
from pipeline.scenes.load import PROJECT_CONFIG
from pipeline.scenes.model import Eye
from pipeline.scenes.reader import Errors
from pipeline.scenes.yaml_files import read_extended


def confirming_scene(question: Question, answer: Answer, eye: Eye, starts_from: str) -> str:
    """Return the scene file of an answer.

    Parameters
    ----------
    starts_from : scene that it extends: level liquids in an eye, with weight, tension and contact angle.
    """
    path = PROJECT_CONFIG / "scenes" / f"{starts_from}.yaml"
    base = read_extended(path, Errors(path))
    wetting = next(name for name, values in base["effects"].items() if "contact_angle" in values)
    fill, oil = min(answer.fill, question.largest_fill), answer.oils[0]
    told = dataclasses.asdict(eye if eye.path is None else dataclasses.replace(eye, path=str(Path(eye.path).resolve())))
    cavity = {key: _plain(value) for key, value in told.items() if value != getattr(Eye(), key)}
    cavity |= {"model": eye.model, "side": eye.side}
    if eye.model == "parametric":
        cavity |= {"axial_length": eye.axial_length, "lens": eye.lens}
    fills: dict[str, float | None] = dict.fromkeys(base["initial"]["fill"])  # null removes what is inherited
    fills |= {oil: round(fill, 4), question.other.name: round(1.0 - round(fill, 4), 4)}
    scene = {
        "extends": starts_from,
        "title": f"{oil}, {100 * fill:.1f} %, {answer.posture.replace('_', ' ')}",
        "description": "Confirms a plan: does the oil at rest touch the break?",
        "liquids": [question.other.name, oil],
        "eye": cavity,
        "initial": {"fill": fills},
        "effects": {weight_name(): {"posture": answer.posture},
                    wetting: {"coefficient": f"{1e3 * question.tension:.6g} mN/m",
                              "contact_angle": f"{np.degrees(question.contact_angle):.6g} deg"}},
    }
    return "# yaml-language-server: $schema=../schema.json\n" + yaml.safe_dump(scene, sort_keys=False, width=120)


def _plain(value: object) -> object:
    """A value as YAML writes it: lists for tuples, and nothing of a record that is not told."""
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items() if one is not None}
    return list(value) if isinstance(value, tuple) else value
