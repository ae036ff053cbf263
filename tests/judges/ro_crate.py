"""Judge of `pipeline.crate`: what rocrate-validator makes of the crate of a run.

    python tests/judges/ro_crate.py outputs/tiny/draft --python /somewhere/bin/python

It needs a Python with the validator, which is no dependency of the pipeline and brings thirty packages of its own
(`pip install roc-validator`); without one the script says so and judges nothing. Profiles come with the validator. What
the words of a crate mean it asks of two pages on the web; here it gets the few that our crates use, so that no network
is needed; a word that is none of them is told too. `--online` lets it ask.
"""
import argparse
import importlib.util
import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

PYTHON = "ROCRATE_PYTHON"   # variable of the environment that names the Python with the validator
PROFILE = "provenance-run-crate"
SCHEMA, BIOSCHEMAS, RUN = "http://schema.org/", "https://bioschemas.org/", "https://w3id.org/ro/terms/workflow-run#"
WORDS = [
    "about", "actionStatus", "additionalType", "ComputerLanguage", "contentSize", "ControlAction", "CreateAction",
    "CreativeWork", "Dataset", "dateModified", "datePublished", "description", "encodingFormat", "endTime",
    "exampleOfWork", "hasPart", "HowTo", "HowToStep", "identifier", "IndividualProduct", "instrument", "license",
    "mainEntity", "mentions", "name", "object", "OrganizeAction", "position", "programmingLanguage", "propertyID",
    "PropertyValue", "result", "SoftwareApplication", "softwareRequirements", "SoftwareSourceCode", "softwareVersion",
    "startTime", "step", "unitCode", "url", "value", "version", "workExample",
]
CONTEXTS = {
    "https://w3id.org/ro/crate/1.1/context": {
        **{word: SCHEMA + word for word in WORDS}, "File": f"{SCHEMA}MediaObject",
        "conformsTo": "http://purl.org/dc/terms/conformsTo", "FormalParameter": f"{BIOSCHEMAS}FormalParameter",
        "ComputationalWorkflow": f"{BIOSCHEMAS}ComputationalWorkflow",
        "input": f"{BIOSCHEMAS}ComputationalWorkflow#input", "output": f"{BIOSCHEMAS}ComputationalWorkflow#output"},
    "https://w3id.org/ro/terms/workflow-run/context": {word: RUN + word for word in ("sha256", "resourceUsage")},
}


def main() -> None:
    """Run; see the head of the file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="folder of a run with a crate, or a ZIP archive of it")
    parser.add_argument("--python", help=f"Python with rocrate_validator (default: that of {PYTHON}, else this one)")
    parser.add_argument("--severity", choices=("REQUIRED", "RECOMMENDED"), default="REQUIRED",
                        help="what has to hold: all that the profiles require (default), or recommend as well")
    parser.add_argument("--online", action="store_true", help="ask the web what the words mean")
    options = parser.parse_args()
    python = options.python or found_python()
    if python is None:
        print(f"not judged: no Python with rocrate_validator; name one by --python or {PYTHON}")
        return
    said = judged(options.run, python, options.severity, {} if options.online else CONTEXTS)
    print("\n".join([f"rocrate-validator {said['version']}, {said['checks']} checks of {PROFILE} and what it extends: "
                     f"{len(said['issues'])} issues", *said["issues"]]))
    raise SystemExit(1 if said["issues"] else 0)


def found_python() -> str | None:
    """Return the Python with the validator that this computer has; None without."""
    return os.environ.get(PYTHON) or (sys.executable if importlib.util.find_spec("rocrate_validator") else None)


def judged(run: Path, python: str, severity: str = "REQUIRED", contexts: dict = CONTEXTS) -> dict:
    """Return what the validator says of a crate: version, number of checks, issues."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run([python, "-c", INSIDE, run, severity, PROFILE, json.dumps(contexts)], text=True,
                          capture_output=True, env=environment, check=False)
    if done.returncode:
        raise SystemExit(f"{python} ended with {done.returncode}: {(done.stdout + done.stderr)[-1000:]}")
    said = json.loads(done.stdout.splitlines()[-1])
    known = {word for words in contexts.values() for word in words}
    said["issues"] += [f"unknown word: {word}" for word in sorted(words_of(run) - known)] if known else []
    return said


def words_of(run: Path) -> set[str]:
    """Return the words of a crate whose meaning its contexts have to tell: types and properties."""
    if run.is_file():
        with zipfile.ZipFile(run) as archive:
            text = archive.read(next(name for name in archive.namelist() if name.endswith("ro-crate-metadata.json")))
    else:
        text = (run / "ro-crate-metadata.json").read_bytes()
    words = set()
    for entity in json.loads(text)["@graph"]:
        kinds = entity["@type"]
        words |= {*entity} - {"@id", "@type"} | {*(kinds if isinstance(kinds, list) else [kinds])}
    return words


INSIDE = """
import json, sys
import requests
from requests.adapters import HTTPAdapter

run, severity, profile, contexts = sys.argv[1:]
contexts = json.loads(contexts)

def served(self, request, **options):
    answer = requests.Response()
    answer.url, answer.request = request.url, request
    answer.status_code = 200 if request.url in contexts else 404
    answer.headers["Content-Type"] = "application/ld+json"
    answer._content = json.dumps({"@context": contexts.get(request.url)}).encode()
    answer.raw = __import__("io").BytesIO(answer._content)
    return answer

if contexts:
    HTTPAdapter.send = served

import rocrate_validator
from rocrate_validator import models, services

result = services.validate(services.ValidationSettings(
    rocrate_uri=run, profile_identifier=profile, requirement_severity=models.Severity[severity], no_cache=True))
issues = [f"{issue.severity.name}: {issue.violatingEntity or ''}: {issue.message}" for issue in result.get_issues()]
print(json.dumps({"version": rocrate_validator.__version__, "checks": len(result.executed_checks), "issues": issues}))
"""


if __name__ == "__main__":
    main()
