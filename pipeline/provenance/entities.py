"""The entities of an RO-Crate: what refers to each other by ids, in the order in which it was added."""
import json
import urllib.parse
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import PurePosixPath
from typing import Any

CRATE_VERSION = "https://w3id.org/ro/crate/1.1"
CONTEXTS = [f"{CRATE_VERSION}/context", "https://w3id.org/ro/terms/workflow-run/context"]
WORKFLOW_CRATE = "https://w3id.org/workflowhub/workflow-ro-crate/1.0"
PROFILES = {
    "https://w3id.org/ro/wfrun/process/0.5": "Process Run Crate",
    "https://w3id.org/ro/wfrun/workflow/0.5": "Workflow Run Crate",
    "https://w3id.org/ro/wfrun/provenance/0.5": "Provenance Run Crate",
    WORKFLOW_CRATE: "Workflow RO-Crate",
}
DONE = "http://schema.org/CompletedActionStatus"
FORMATS = {".csv": "text/csv", ".gif": "image/gif", ".html": "text/html", ".json": "application/json",
           ".mp4": "video/mp4", ".npz": "application/zip", ".png": "image/png", ".pvd": "application/xml",
           ".py": "text/x-python", ".vtm": "application/xml", ".vtp": "application/xml", ".vtu": "application/xml"}

Reference = dict[str, str]


class Entities:
    """The graph of a crate that is being written."""

    def __init__(self) -> None:
        self._found: dict[str, dict[str, Any]] = {}

    def add(self, name: str, kind: str | list[str], /, **properties: Any) -> Reference:
        """Add an entity where there is none of its id yet, and return what refers to it.

        Parameters
        ----------
        name : its id.
        properties : what is empty is left out, and a list of one thing is that thing, as RO-Crate recommends.
        """
        kept = {key: value[0] if isinstance(value, list) and len(value) == 1 else value
                for key, value in properties.items() if value not in (None, "", [])}
        self._found.setdefault(name, {"@id": name, "@type": kind, **kept})
        return {"@id": name}

    def text(self) -> str:
        """Return the crate as JSON, one entity in a line, so that a person can read and compare it."""
        lines = ",\n".join(json.dumps(entity, ensure_ascii=False) for entity in self._found.values())
        return f'{{"@context": {json.dumps(CONTEXTS)},\n"@graph": [\n{lines}\n]}}\n'


def file_id(path: PurePosixPath) -> str:
    """Return the id of a file of the run."""
    return urllib.parse.quote(str(path))


def path_of(name: str) -> PurePosixPath:
    """Return the file that an id is of."""
    return PurePosixPath(urllib.parse.unquote(name))


def folder_id(path: PurePosixPath) -> str:
    """Return the id of a folder of the run."""
    return f"{file_id(path)}/"


def moment(seconds: float) -> str:
    """Return a time since 1970 in ISO 8601.

    >>> moment(1.5)
    '1970-01-01T00:00:01.500+00:00'
    """
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds")


def listed(value: Any) -> list[Any]:
    """Return a property as a list: of all its values, of the only one, or of none.

    >>> listed([1, 2]), listed(1), listed(None)
    ([1, 2], [1], [])
    """
    return value if isinstance(value, list) else [] if value is None else [value]


def each_once(references: Iterable[Reference]) -> list[Reference]:
    """Return references without repetitions."""
    return [{"@id": name} for name in dict.fromkeys(one["@id"] for one in references)]
