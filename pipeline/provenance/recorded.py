"""What the RO-Crate of a run says of it, read back."""
import dataclasses
import json
from pathlib import PurePosixPath
from typing import Any

from pipeline.base.errors import UserError
from pipeline.provenance.entities import listed, path_of
from pipeline.runs.contents import CRATE

TOOL = "#pipeline."


@dataclasses.dataclass(frozen=True)
class RecordedJob:
    """A job as the crate tells it.

    Attributes
    ----------
    digests : of its code and of what it read of the scene, when it ran.
    """

    name: str
    stage: str
    digests: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class Recorded:
    """What a crate tells.

    Attributes
    ----------
    files : size, bytes, and SHA-256 of every result.
    version : of the code that wrote the crate.
    """

    scene: str
    level: str
    files: dict[PurePosixPath, tuple[int, str]]
    jobs: list[RecordedJob]
    version: str


def read_crate(text: bytes, where: str) -> Recorded:
    """Read a crate that `pipeline.crate` has written.

    Raises
    ------
    UserError : it is damaged, or the crate of something else.
    """
    try:
        entities = {one["@id"]: one for one in json.loads(text)["@graph"]}
        files = {path_of(name): (int(one["contentSize"]), str(one["sha256"]).lower())
                 for name, one in entities.items() if "File" in listed(one["@type"])}
        workflow = entities[entities["./"]["mainEntity"]["@id"]]
        jobs = [_job(one, entities) for one in entities.values()
                if one["@type"] == "CreateAction" and one["instrument"]["@id"].startswith(TOOL)]
        scene, level = _called(entities["#run"]), entities["#value-accuracy"]["value"]
        recorded = Recorded(scene, level, files, jobs, workflow["version"])
    except (ValueError, KeyError, TypeError, AttributeError, IndexError) as error:
        raise UserError(f"{where}/{CRATE}: is damaged or no crate of a run of this pipeline "
                        f"({type(error).__name__}: {error}); {how_to_make()}") from None
    outside = [path for path in files if path.is_absolute() or ".." in path.parts]
    if outside:
        raise UserError(f"{where}/{CRATE}: names {outside[0]}, which is outside of its folder; {how_to_make()}")
    return recorded


def how_to_make(scene: str = "<scene>", level: str = "<level>") -> str:
    """Return what makes a crate."""
    return f"where the scene was run, snakemake -j2 outputs/{scene}/{level}/{CRATE} makes one"


def _called(run: dict[str, Any]) -> str:
    return run["name"].removeprefix("Run of ").rpartition(" at ")[0]


def _job(action: dict[str, Any], entities: dict[str, Any]) -> RecordedJob:
    given = [entities.get(one["@id"], {}) for one in listed(action.get("object"))]
    digests = " ".join(one["value"] for one in given if one.get("@id", "").startswith("#digest-"))
    return RecordedJob(action["name"], action["instrument"]["@id"].removeprefix(TOOL), tuple(digests.split()))
