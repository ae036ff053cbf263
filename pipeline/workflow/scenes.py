"""What the Snakefile asks: which scenes there are, how many segments they have, and where a segment starts."""
import functools
import hashlib
import re
import sys
import tempfile
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NoReturn

from pipeline.base.cli import describe, reason
from pipeline.base.errors import UserError
from pipeline.base.files import remove_left_over, write_text
from pipeline.base.words import nearest
from pipeline.cavity.eye_files import eye_files
from pipeline.runs.contents import CRATE
from pipeline.runs.segments import segments_made, segments_until_rest
from pipeline.scenes.checks import NAME
from pipeline.scenes.devices import checked_device, chosen_device
from pipeline.scenes.effects import knows_films
from pipeline.scenes.folders import LISTED, scene_path, scene_paths
from pipeline.scenes.load import load_accuracy_levels, load_scene
from pipeline.scenes.model import Scene
from pipeline.scenes.reader import describe as shown
from pipeline.scenes.threads import chosen_threads, paying_threads, solver_threads
from pipeline.scenes.yaml_files import scene_files
from pipeline.studies.plan import study_names
from pipeline.workflow.copied import restore_dates
from pipeline.workflow.digest import stage_digest
from pipeline.workflow.memory import memory_of_stage
from pipeline.workflow.mending import changes, end_future, hold, logs_below, set_aside_damaged

LEVELS = Path("config/accuracy.yaml")
OUTPUTS = Path("outputs")
KEYS = ("scenes", "accuracy", "device")
DEVICE = "--config device"
TEXTS = (".js", ".css", ".html")  # of pages
WANTED = ("index.html", "movie.mp4", "metrics.csv", "advice.html", "effects.html", "cost.html", "run.pvd",
          CRATE)
REQUESTED = ("bodies.csv", "estimate.json", "film.mp4", "frames/frames.pvd", "turntable.mp4")  # made when asked for


def stop(*messages: str) -> NoReturn:
    """End Snakemake with one sentence per error, without a traceback of the Snakefile."""
    for message in messages:
        print(f"error: {message}", file=sys.stderr)
    sys.stderr.flush()
    sys.exit(2)


def probe(folder: Path) -> None:
    """Make a folder if it is missing; end Snakemake where nothing can be written into it."""
    if folder.is_symlink() and not folder.exists():
        stop(f"{folder}: is a link to {folder.readlink()}, which is not there; make that folder, or remove the link")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(bytes(4096))
    except OSError as error:
        stop(f"{folder}: this folder cannot be written ({reason(error)})")


def _read(load, *arguments):
    """What ``load`` returns; its errors end Snakemake with one sentence for each."""
    try:
        return load(*arguments)
    except UserError as error:
        stop(*error.messages)
    except OSError as error:
        stop(describe(error))


def scene_names() -> list[str]:
    """Return the names of all scenes, but of those that cannot name a folder."""
    return [name for name in _read(scene_paths) if re.fullmatch(NAME, name)]


def sha256(content: bytes) -> str:
    """Return the digest of the content of files, 16 hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()[:16]


def room_texts(*rooms: str) -> str:
    """Return the digest of the scripts, styles and templates in rooms of the pipeline, and of their libraries."""
    from pipeline.base.digest import ROOT

    return sha256(b"".join(path.read_bytes() for room in rooms for path in sorted((ROOT / "pipeline" / room).rglob("*"))
                           if path.suffix in TEXTS))


def rest_file(name: str, level: str, segment: str) -> str:
    """Return the file that says whether a scene is at rest after a segment."""
    return f"{OUTPUTS}/{name}/{level}/rest/segment_{segment}.json"


class Workflow:
    """The scenes of one call of Snakemake.

    Parameters
    ----------
    config : Snakemake's configuration, ``config/config.yaml`` with the changes of ``--config``.
    elsewhere : jobs may run on other computers, whose cores and devices this one does not know: they ask themselves.
    rested : returns the file that says whether a scene is at rest, of its name, level and segment; that of Snakemake
        sees to it that the file is made.

    Attributes
    ----------
    names : scenes that ``all`` makes.
    levels : names of all accuracy levels; each has a folder of its own in that of a scene.
    accuracy : level at which ``all`` and the studies are made.
    device : option of every stage that starts the solver, empty where the scenes decide.
    """

    def __init__(self, config: Mapping[str, Any], elsewhere: bool = False,
                 rested: Callable[[str, str, str], str] = rest_file):
        for key in config:
            if key not in KEYS:
                stop(f"--config {key}: unknown key, must be one of {', '.join(KEYS)}")
        names = config.get("scenes")
        if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
            stop(f"--config scenes is {names!r}, but must be a list of names such as '[tamponade]'")
        probe(Path(".snakemake"))  # Snakemake's own notes: without them it ends with a traceback
        restore_dates()
        self.names = list(dict.fromkeys(names))
        self.levels = tuple(_read(load_accuracy_levels, LEVELS))
        self.accuracy = config.get("accuracy")
        if self.accuracy not in self.levels:
            stop(f"--config accuracy is {shown(self.accuracy)}, but must be one of {', '.join(self.levels)}"
                 f"{nearest(self.accuracy, self.levels)}")
        self._device = config.get("device")
        self.elsewhere, self._rested = elsewhere, rested
        if self._device is not None and not elsewhere:
            _read(checked_device, self._device, DEVICE)
        self.device = "" if self._device is None else f"--device {self._device}"
        self._scenes: dict[tuple[str, str], Scene] = {}

    @staticmethod
    def scene_file(wildcards) -> str:
        """Return the file of a scene."""
        return str(_read(scene_path, wildcards.scene))

    @property
    def any_level(self) -> str:
        """Regular expression of the names of all levels."""
        return "|".join(map(re.escape, self.levels))

    def scene(self, name: str, level: str) -> Scene:
        """Return a scene at an accuracy level; a scene with errors ends Snakemake with one sentence for each."""
        if (name, level) not in self._scenes:
            path = _read(scene_path, name)
            scene = self._scenes[name, level] = _read(load_scene, path, level)
            if not self.elsewhere:
                _read(chosen_threads, None, scene, path)
                _read(chosen_device, self._device, scene, path, DEVICE)
        return self._scenes[name, level]

    def threads(self, name: str, level: str, cores: int) -> int:
        """Return how many threads the solver of a scene gets where Snakemake has a number of cores.

        Elsewhere that is the number that one job may have.
        """
        scene = self.scene(name, level)
        if self.elsewhere:
            return min(scene.numerics.threads or paying_threads(scene), cores)
        return solver_threads(scene, cores)

    def memory(self, stage: str):
        """Return a resource: the memory, MB, that a job of a stage needs; a job that is tried again gets more."""
        most = functools.cache(lambda name, level: memory_of_stage(stage, self.scene(name, level)))
        return lambda wildcards, attempt: attempt * most(wildcards.scene, wildcards.level)

    def gpu(self, wildcards) -> int | None:
        """Return a resource: the GPUs that a job of a scene needs; None where it needs none."""
        return self.gpus(self.scene(wildcards.scene, wildcards.level).numerics.device)

    def gpus(self, device: str) -> int | None:
        """Return 1 where a job whose own device is ``device`` is to run on a GPU, else None."""
        return 1 if (self._device or device) == "cuda" else None

    def segments(self, name: str, level: str) -> list[str]:
        """Return the names of the segments of a scene: ``000``, ``001`` ...; where it ends at rest, as it is run."""
        return _read(segments_until_rest, self.scene(name, level),
                     lambda segment: Path(self._rested(name, level, segment)))

    def segments_up_to(self, name: str, level: str, segment: str) -> list[str]:
        """Return the names of the segments of a scene from the start to one of them."""
        segments = self.scene(name, level).segment_names
        if segment not in segments:
            stop(f"{name} has no segment {segment}; its segments are {', '.join(segments)}")
        return segments[:int(segment) + 1]

    def segments_before(self, name: str, level: str, segment: str) -> list[str]:
        """Return the names of the segments whose frames tell what oil lies on at the start of one of them.

        There are none in a scene whose films are not known.
        """
        return self.segments_up_to(name, level, segment)[:-1] if knows_films(self.scene(name, level)) else []

    def start(self, name: str, level: str, segment: str) -> list[str]:
        """Return the checkpoint that a segment starts from, as a list; empty when it starts from the initial state."""
        before = self.segments_up_to(name, level, segment)[:-1]
        if before:
            return [f"{OUTPUTS}/{name}/{level}/checkpoints/segment_{before[-1]}.npz"]
        earlier = self.scene(name, level).start_from
        if not earlier:
            return []
        return [f"{OUTPUTS}/{earlier}/{level}/checkpoints/segment_{self.segments(earlier, level)[-1]}.npz"]

    def known_start(self, name: str, level: str) -> list[str]:
        """Return the checkpoint that a scene will start from, as a list; empty also where it is not known yet."""
        earlier = self.scene(name, level).start_from
        if not earlier:
            return []
        last = _read(segments_made, self.scene(earlier, level), OUTPUTS / earlier / level)[-1]
        return [f"{OUTPUTS}/{earlier}/{level}/checkpoints/segment_{last}.npz"]

    def mesh(self, name: str, level: str) -> list[str]:
        """Return the files of the user's mesh or image of the eye; none for the parametric eye."""
        return eye_files(self.scene(name, level).eye)

    def wanted(self, names: Iterable[str]) -> list[str]:
        """Return what is made of scenes unless somebody asks for less, at the accuracy level of this call."""
        return [f"{OUTPUTS}/{name}/{self.accuracy}/{file}" for file in WANTED for name in names]

    def still(self, name: str, level: str) -> list[str]:
        """Return the still of a scene, which has bodies to show only in space."""
        return [f"{OUTPUTS}/{name}/{level}/still.png"] * (self.scene(name, level).dimension == 3)

    def unknown(self, word: str) -> NoReturn:
        """End Snakemake with what there is: a word was asked for that is no rule, no scene and no study."""
        if word in _read(scene_paths):
            self.scene(word, self.accuracy)  # its file has a name that no folder can have, which is said
        known = [*scene_names(), *study_names()]
        stop(f'no scene and no study is called "{word}"{nearest(word, known)}; {LISTED} scenes, and the studies are '
             f"{', '.join(study_names())}")

    def levels_in(self, joined: str) -> list[str]:
        """Return the levels in the name of a comparison, such as ``draft_standard``."""
        longest_first = "|".join(map(re.escape, sorted(self.levels, key=len, reverse=True)))
        return re.findall(rf"(?:^|_)({longest_first})(?=_|$)", joined)

    def compared(self, name: str, joined: str) -> list[str]:
        """Return the files by which levels of a scene are compared: metrics, pictures and costs of each."""
        levels = self.levels_in(joined)
        for level in levels:
            if levels.count(level) > 1:
                stop(f"{OUTPUTS}/{name}/compare_{joined}: compares {level} with itself; name two or more of "
                     f"{', '.join(self.levels)}")
        files = []
        for folder, segments in ((f"{OUTPUTS}/{name}/{one}", self.segments(name, one)) for one in levels):
            files += [f"{folder}/{file}" for file in ("metrics.csv", "metrics.json", "initial.npz")]
            files += [*(f"{folder}/images/segment_{segment}" for segment in segments),
                      *(f"{folder}/costs/segment_{segment}.json" for segment in segments)]
        return files

    def refuse(self, name: str, rest: str) -> NoReturn:
        """End Snakemake with the path to ask for: a file was asked for without an accuracy level.

        name : of a scene, or studies/<study>.
        """
        study = name.removeprefix("studies/")
        if study == name:
            self.scene(name, self.accuracy)  # an unknown scene has a sentence of its own
        elif study not in study_names():
            stop(f'{OUTPUTS}/{name}: no study is called "{study}"{nearest(study, study_names())}')
        file = "movie.mp4" if study == name else "table.html"
        folder, levels = f"{OUTPUTS}/{name}", ", ".join(self.levels)
        first, _, after = rest.partition("/")
        meant = nearest(first, self.levels) if after else ""
        if first.startswith("compare_"):
            stop(f"{folder}/{rest}: must be compare_<level>_<level>.html, .png or .csv, with two or more of {levels}")
        if rest in self.levels:
            stop(f"{folder}/{rest}: is a folder; ask for a file in it, such as {folder}/{rest}/{file}")
        if meant:
            stop(f'{folder}/{rest}: no accuracy level is called "{first}"{meant}; there are {levels}')
        stop(f"{folder}/{rest}: every accuracy level has a folder of its own ({levels}); ask for "
             f"{folder}/{self.accuracy}/{rest}")

    def depends(self, stage: str):
        """Return a Snakemake parameter that changes when the results of ``stage`` may change."""
        def digest_of(name: str, level: str) -> str:
            # A mesh of the user counts by what it holds: a copy of it has another date.
            meshes = [Path(path) for path in self.mesh(name, level)] if stage == "eye" else []
            return " ".join([stage_digest(stage, self.scene(name, level)),
                             *(sha256(path.read_bytes()) for path in meshes if path.is_file())])

        digest = functools.cache(digest_of)

        def parameter(wildcards) -> str:
            name, level, segment = wildcards.scene, wildcards.level, getattr(wildcards, "segment", None)
            frames = self.scene(name, level).frames_of_segment(int(segment)) if segment else ""
            return f"{digest(name, level)} {frames}".strip()
        return parameter

    @staticmethod
    def estimate_made(name: str, level: str) -> list[str]:
        """Return the estimate of a scene where somebody has asked for one; it costs as much as many frames."""
        path = OUTPUTS / name / level / "estimate.json"
        return [str(path)] if path.is_file() else []

    def crate_depends(self, wildcards) -> str:
        """Return a parameter that changes with the code of the crate and with anything in the scene."""
        scene = self.scene(wildcards.scene, wildcards.level)
        return f"{stage_digest('crate')} {sha256(scene.to_json().encode())}"

    @staticmethod
    def requested(wildcards) -> list[str]:
        """Return a parameter that changes with what is there of a run because somebody has asked for it."""
        folder = OUTPUTS / wildcards.scene / wildcards.level
        return [f"{name} {sha256((folder / name).read_bytes())}" for name in REQUESTED if (folder / name).is_file()]

    @staticmethod
    def expected_errors() -> str:
        """Return a parameter that changes with the errors to expect."""
        from pipeline.forecast.expected_error import errors_file
        from pipeline.forecast.retina_error import SHIPPED

        return sha256(errors_file().read_bytes() + SHIPPED.read_bytes())

    @staticmethod
    def page_texts(wildcards) -> str:
        """Return a parameter that changes with the texts of a page that are no Python: scripts and scene files."""
        shown = _read(scene_files, _read(scene_path, wildcards.scene))
        return sha256((room_texts("pages", "web") + "".join(shown.values())).encode())

    def tell_pages(self) -> None:
        """Print where the page and the pictures of every scene of this run are, as far as they have been made."""
        for name, level in self._scenes:
            folder = OUTPUTS / name / level
            made = [f"{what} {folder / file}" for what, file in (
                ("page", "index.html"), ("movie", "movie.mp4"), ("pictures", "images")) if (folder / file).exists()]
            if made:
                print(f"{name} at {level}: {', '.join(made)}", flush=True)

    def prepare_outputs(self) -> None:
        """Hold the folder of outputs for this run and bring the resolved scenes in it up to date.

        A rule cannot do the latter: Snakemake does not look for changed parameters downstream of a job that it runs.
        The kernel gives the lock back however the run ends, so that none is left behind by ``kill -9``.
        """
        probe(OUTPUTS)
        self._logs = changes(logs_below(OUTPUTS))
        try:
            self._lock = hold(OUTPUTS)
        except BlockingIOError:
            stop(f"{OUTPUTS}: another snakemake works in this folder; wait for its end")
        for folder in {OUTPUTS / name for name, _ in self._scenes}:
            if folder.is_dir():
                remove_left_over(folder)
                end_future(folder)
        for (name, level), scene in self._scenes.items():
            folder = OUTPUTS / name / level
            if folder.is_dir():
                probe(folder)
            if (folder / "scene.json").is_file():
                write_text(folder / "scene.json", scene.to_json())

    def repeat_errors(self) -> None:
        """Print the sentences with which jobs of this run ended, after all that Snakemake says about them.

        Damaged files that they name are set aside.
        """
        sentences = []
        for log, state in changes(logs_below(OUTPUTS)).items():
            if self._logs.get(log) != state:
                sentences += [line.removeprefix("error: ") for line in log.read_text(
                    encoding="utf-8", errors="replace").splitlines() if line.startswith("error: ")]
        for sentence in sentences:
            print(f"error: {sentence}", file=sys.stderr)
        for name, level in self._scenes:
            for sentence in set_aside_damaged(OUTPUTS / name / level, sentences):
                print(sentence, file=sys.stderr)
