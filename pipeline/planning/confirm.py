"""A scene that confirms an answer by one simulation, and what that simulation says once it has run."""
import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pipeline.base.errors import UserError
from pipeline.base.tables import read_table
from pipeline.measures.rest import rest_in_words
from pipeline.planning.search import Answer, Question
from pipeline.planning.settings import weight_name
from pipeline.runs.segments import segments_made
from pipeline.scenes.folders import scene_path
from pipeline.scenes.load import PROJECT_CONFIG, load_scene
from pipeline.scenes.model import Eye
from pipeline.scenes.reader import Errors
from pipeline.scenes.retina import HOUR
from pipeline.scenes.yaml_files import read_extended
from pipeline.workflow.digest import outdated
from pipeline.workflow.notes import kept_of

BREAK = "planned"   # name of the break in the scene
# Viscosities: with their own, the liquids need long to the same shape. Measures take the thicker one for the oil.
THIN_OIL, THIN_OTHER = "100 mPa s", "50 mPa s"
OUTPUTS = Path("outputs")
MEASURED = ("eye", "voxelize", "simulate", "metrics")  # stages by which a simulation comes to its numbers


def confirming_scene(question: Question, answer: Answer, eye: Eye, starts_from: str) -> str:
    """Return the scene file of an answer.

    Parameters
    ----------
    starts_from : scene that it extends: two liquids in an eye, with weight, tension and contact angle.
    """
    path = scene_path(starts_from, PROJECT_CONFIG / "scenes")
    base = read_extended(path, Errors(path))
    wetting = next(name for name, values in base["effects"].items() if "contact_angle" in values)
    fill, oil = min(answer.fill, question.largest_fill), answer.oils[0]
    told = {key: value for key, value in dataclasses.asdict(eye).items() if value != getattr(Eye(), key)}
    cavity = {key: _plain(value) for key, value in told.items()} | {"model": eye.model, "side": eye.side}
    if eye.model == "mesh":
        cavity |= {"path": str(Path(eye.path or "").resolve()), "unit": eye.unit}
    else:
        cavity |= {"axial_length": f"{1e3 * eye.axial_length:g} mm", "lens": eye.lens}
    fills: dict[str, float | None] = dict.fromkeys(base["initial"]["fill"])  # null removes what is inherited
    fills |= {oil: round(fill, 4), question.other.name: round(1.0 - round(fill, 4), 4)}
    liquids: dict[str, Any] = dict.fromkeys(base["liquids"])
    liquids |= {question.other.name: {"dynamic_viscosity": THIN_OTHER}, oil: {"dynamic_viscosity": THIN_OIL}}
    scene = {
        "extends": starts_from,
        "title": f"{oil.replace('_', ' ')}, {100 * fill:.1f} %, {answer.posture.replace('_', ' ')}",
        "description": f"Confirms a plan: does the oil, started at rest, keep touching the break? The liquids have "
                       f"{THIN_OIL} and {THIN_OTHER}: that changes how soon they rest, not where.",
        "breaks": [{"name": BREAK, "hour": round(question.place.meridian / HOUR, 6) or 12.0,
                    "latitude": f"{question.place.latitude:.6g} deg",
                    "width": round(min(question.place.width / HOUR, 12.0), 6),
                    "height": f"{question.place.height:.6g} deg"}],
        "liquids": liquids,
        "eye": cavity,
        "initial": {"fill": fills},
        "effects": {weight_name(): {"posture": answer.posture},
                    wetting: {"coefficient": f"{1e3 * question.tension:.6g} mN/m",
                              "contact_angle": f"{np.degrees(question.contact_angle):.6g} deg"}},
    }
    return "# yaml-language-server: $schema=../schema.json\n" + yaml.safe_dump(scene, sort_keys=False, width=120)


def _plain(value: object) -> object:
    """A value of an eye as YAML writes it, in SI units: lists for tuples, and nothing that a record does not tell."""
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items() if one is not None}
    return list(value) if isinstance(value, tuple) else value


def confirmation(path: Path, question: Question, answer: Answer, outputs: Path = OUTPUTS) -> list[str]:
    """Return what the simulation of a confirming scene says, or how to run it, in sentences.

    Parameters
    ----------
    path : of the scene file.
    """
    command = f"snakemake -j2 {outputs / path.stem / 'draft' / 'metrics.html'}"
    runs = [run for run in (_read(folder) for folder in sorted((outputs / path.stem).glob("*"))) if run is not None]
    if not runs:
        return [f"{path}: one simulation of this, to compare, is run by: {command}",
                "Then the same command as this one tells whether it agrees."]
    scene, record, rest = min(runs, key=lambda run: run[0]["numerics"]["particle_spacing"])
    level = scene["accuracy"]
    folder, planned = outputs / path.stem / level, load_scene(path, level)
    # The scene in the folder is that of the plan from the start of a run on, its numbers are so at the end.
    made = [(job.stage, job.digests) for job in kept_of(folder, segments_made(planned, folder))
            if job.stage in MEASURED]
    if json.loads(planned.to_json()) != scene or outdated(made, planned):
        return [f"{path}: the simulation in {folder} is that of another plan, or of older code; run it again: "
                f"{command}"]
    return [_verdict(record, question, answer, level), *([f"It is {rest}."] if rest.startswith("not ") else [])]


def _read(folder: Path) -> tuple[dict[str, Any], dict[str, Any], str] | None:
    """Scene and course of the break of a run, and whether it is at rest; None where there is no run yet.

    Raises
    ------
    UserError : a file is damaged.
    """
    files = [folder / name for name in ("scene.json", "metrics.json", "metrics.csv")]
    if not all(file.is_file() for file in files):
        return None
    try:
        scene, metrics = (json.loads(file.read_text(encoding="utf-8")) for file in files[:2])
        record = next((one for one in metrics["breaks"] if one["name"] == BREAK), None)
    except (ValueError, KeyError, TypeError) as error:
        raise UserError(f"{folder}: its results are damaged ({error}); remove the folder and run it again") from error
    return None if record is None else (scene, record, rest_in_words(read_table(files[2])))


def _verdict(record: dict[str, Any], question: Question, answer: Answer, level: str) -> str:
    """Whether a simulation agrees with an answer."""
    margin, doubt = record["margin_at_end [mm]"], record["uncertainty [mm]"]
    found = (f"at its end the oil reaches {margin:.1f} ± {doubt:.1f} mm beyond the break" if margin > 0.0 else
             f"at its end the oil ends {-margin:.1f} ± {doubt:.1f} mm short of the far edge of the break")
    covers = answer.covers(question.largest_fill)
    planned = (f"planned was that it reaches {1e3 * question.margin:g} mm beyond" if covers else
               "planned was that this fill does not cover it")
    if abs(margin) < doubt:
        return f"The simulation ({level}) cannot tell: {found}; {planned}. A finer level can."
    agrees = (margin > 0.0) == covers
    known = (" Simulations are known to touch less of the retina than oil at rest (docs/results/eye.md), so a break "
             "that is not covered tells less than one that is covered.") if covers and not agrees else ""
    return f"The simulation ({level}) {'agrees' if agrees else 'does not agree'}: {found}; {planned}.{known}"
