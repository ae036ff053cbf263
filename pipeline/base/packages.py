"""The packages that are installed: name, version, license."""
import dataclasses
import hashlib
import sys
from importlib.metadata import Distribution, distributions
from pathlib import Path

UNKNOWN = "not stated"
LONGEST = 60  # letters of a license: above, it is the text of one and no name


@dataclasses.dataclass(frozen=True, order=True)
class Package:
    """A package as it states itself."""

    name: str
    version: str
    license: str


def packages() -> list[Package]:
    """Return all packages that can be imported here, by name, each once: the one that is found first."""
    found: dict[str, Package] = {}
    for one in distributions():
        if name := _told(one, "Name"):  # none is what a broken installation has left
            found.setdefault(name.lower().replace("_", "-"), Package(name, one.version, license_of(one)))
    return [found[name] for name in sorted(found)]


def _told(one: Distribution, key: str) -> str | None:
    """What a package tells of itself, None where it does not."""
    return next(iter(one.metadata.get_all(key) or ()), None)


def license_of(one: Distribution) -> str:
    """Return the license of a package: expression, else classifiers, field, or the head of its license file."""
    expression, field = _told(one, "License-Expression"), _told(one, "License") or ""
    classifiers = [line.rpartition(" :: ")[2] for line in one.metadata.get_all("Classifier") or ()
                   if line.startswith("License :: ") and not line.endswith("OSI Approved")]
    files = [path for path in one.files or () if path.name.upper().startswith(("LICENSE", "LICENCE"))]
    texts = (field, *(path.read_text(encoding="utf-8", errors="replace")
                      for path in (Path(file.locate()) for file in files) if path.is_file()))
    heads = (text.strip().partition("\n")[0].strip() for text in texts)
    return expression or " / ".join(classifiers) or next((head for head in heads if 0 < len(head) <= LONGEST), UNKNOWN)


def packages_digest() -> str:
    """Return what changes when a package does: the names of their folders carry the versions."""
    names = {path.name for folder in map(Path, sys.path) for path in folder.glob("*.dist-info")}
    return hashlib.sha256(repr(sorted(names)).encode()).hexdigest()[:16]
