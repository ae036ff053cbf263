"""What the Snakefile asks: which scenes there are, how many segments they have, and where a segment starts."""
import fcntl
import functools
import hashlib
import os
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import NoReturn

from pipeline.cli import describe, reason
from pipeline.digest import stage_digest
from pipeline.errors import UserError
from pipeline.files import remove_left_over, write_text
from pipeline.scene import load_scene
from pipeline.scene_model import Scene

SCENES = Path("config/scenes")
OUTPUTS = Path("outputs")
KEYS = ("scenes", "accuracy")


def stop(*messages: str) -> NoReturn:
    """End Snakemake with one sentence per error, without a traceback of the Snakefile."""
    for message in messages:
        print(f"error: {message}", file=sys.stderr)
    sys.stderr.flush()
    sys.exit(2)


def probe(folder: Path) -> None:
    """Make a folder if it is missing; end Snakemake where nothing can be written into it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(bytes(4096))
    except OSError as error:
        stop(f"{folder}: this folder cannot be written ({reason(error)})")


class Workflow:
    """The scenes of one call of Snakemake.

    Parameters
    ----------
    config : Snakemake's configuration, ``config/config.yaml`` with the changes of ``--config``.
    """

    def __init__(self, config: Mapping[str, object]):
        for key in config:
            if key not in KEYS:
                stop(f"--config {key}: unknown key, must be one of {', '.join(KEYS)}")
        names = config.get("scenes")
        if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
            stop(f"--config scenes is {names!r}, but must be a list of names such as '[tamponade]'")
        probe(Path(".snakemake"))  # Snakemake's own notes: without them it ends with a traceback
        self.accuracy = config.get("accuracy")
        self.names = list(dict.fromkeys(names))
        self._scenes: dict[str, Scene] = {}

    def scene(self, name: str) -> Scene:
        """Return a scene by name; a scene with errors ends Snakemake with one sentence for each."""
        if name not in self._scenes:
            try:
                self._scenes[name] = load_scene(SCENES / f"{name}.yaml", self.accuracy)
            except UserError as error:
                stop(*error.messages)
            except OSError as error:
                stop(describe(error))
        return self._scenes[name]

    def segments(self, name: str) -> list[str]:
        """Return the names of the segments of a scene: ``000``, ``001`` ..."""
        return [f"{segment:03d}" for segment in range(self.scene(name).segment_count)]

    def start(self, name: str, segment: str) -> list[str]:
        """Return the checkpoint that a segment starts from, as a list; empty when it starts from the initial state."""
        if segment not in self.segments(name):
            stop(f"{name} has no segment {segment}; its segments are {', '.join(self.segments(name))}")
        if int(segment):
            return [f"{OUTPUTS}/{name}/checkpoints/segment_{int(segment) - 1:03d}.npz"]
        earlier = self.scene(name).start_from
        return [f"{OUTPUTS}/{earlier}/checkpoints/segment_{self.segments(earlier)[-1]}.npz"] if earlier else []

    def mesh(self, name: str) -> list[str]:
        """Return the user's mesh of the eye, as a list; empty for the parametric eye."""
        eye = self.scene(name).eye
        return [eye.path] if eye is not None and eye.path else []

    def depends(self, stage: str):
        """Return a Snakemake parameter that changes when the results of ``stage`` may change."""
        digest = functools.cache(lambda name: stage_digest(stage, self.scene(name)))

        def parameter(wildcards) -> str:
            segment = getattr(wildcards, "segment", None)
            frames = self.scene(wildcards.scene).frames_of_segment(int(segment)) if segment else ""
            return f"{digest(wildcards.scene)} {frames}".strip()
        return parameter

    @staticmethod
    def expected_errors() -> str:
        """Return a parameter that changes with the errors that estimates tell."""
        from pipeline.expected_error import errors_file

        return hashlib.sha256(errors_file().read_bytes()).hexdigest()[:16]

    def prepare_outputs(self) -> None:
        """Hold the folder of outputs for this run and bring the resolved scenes in it up to date.

        A rule cannot do the latter: Snakemake does not look for changed parameters downstream of a job that it runs.
        The kernel gives the lock back however the run ends, so that none is left behind by ``kill -9``.
        """
        self._begin = time.time()
        probe(OUTPUTS)
        self._lock = os.open(OUTPUTS, os.O_RDONLY)
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            stop(f"{OUTPUTS}: another snakemake works in this folder; wait for its end")
        for name, scene in self._scenes.items():
            folder = OUTPUTS / name
            if folder.is_dir():
                probe(folder)
                remove_left_over(folder)
            if (folder / "scene.json").is_file():
                write_text(folder / "scene.json", scene.to_json())

    def repeat_errors(self) -> None:
        """Print the sentences with which jobs of this run ended, after all that Snakemake says about them."""
        for log in sorted([*OUTPUTS.glob("*/logs/*.log"), *OUTPUTS.glob("studies/*/logs/*.log")]):
            if log.stat().st_mtime >= self._begin:
                for line in log.read_text(encoding="utf-8", errors="replace").splitlines():
                    if line.startswith("error: "):
                        print(line, file=sys.stderr)
