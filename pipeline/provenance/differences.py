"""How the files of a run differ from what its crate says of them, one sentence for each difference."""
import dataclasses
import hashlib
import itertools
import json
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import PurePosixPath
from typing import Any

from pipeline.base.errors import UserError
from pipeline.provenance.places import Place
from pipeline.provenance.recorded import Recorded, how_to_make, read_crate
from pipeline.runs.contents import CRATE, frame_of, is_result, left_over
from pipeline.runs.run_folder import RunFolder
from pipeline.scenes.model import Scene
from pipeline.workflow.digest import outdated

MOST = 20  # files of a kind that are named one by one
SCENE = PurePosixPath("scene.json")


@dataclasses.dataclass(frozen=True)
class Comparison:
    """A run beside its crate.

    Attributes
    ----------
    differences : sentences.
    whole : files that are as the crate says.
    recorded : what the crate says.
    """

    differences: list[str]
    whole: int
    recorded: Recorded

    @property
    def size(self) -> int:
        """Bytes of all files that the crate lists."""
        return sum(size for size, _ in self.recorded.files.values())


def compare(place: Place, threads: int = 1, code: bool = True) -> Comparison:
    """Compare a run with its crate.

    Parameters
    ----------
    threads : that read files.
    code : compare the code that made the run with this code too.

    Raises
    ------
    UserError : there is no run or no crate, or the crate is that of another run.
    """
    sizes = place.sizes()
    recorded = _recorded(place, sizes)
    found = {path: size for path, size in sizes.items() if is_result(path)}
    scene, segments, unread = _scene(place, found)
    over = left_over(found, segments) if segments else {}
    apart = {path for paths in over.values() for path in paths}
    differences = [unread] if unread else []
    differences += _missing(recorded, found)
    resized, other = _changed(place, recorded, found, threads)
    differences += _several(resized, "is changed: it has another size than in the crate")
    differences += _several(other, "is changed: as large as in the crate, but with another content")
    differences += [f"segment_{name}: the scene has no such segment, but {counted(len(paths), 'file')} of it "
                    f"{'is' if len(paths) == 1 else 'are'} here, such as {min(paths)}; a longer run left them"
                    for name, paths in sorted(over.items())]
    differences += _several(sorted(found.keys() - recorded.files.keys() - apart), "is not in the crate: it was added "
                            "or made after it")
    if code and scene is not None:
        differences += _older(recorded, scene)
    whole = recorded.files.keys() & found.keys() - {*resized, *other}
    return Comparison(differences, len(whole), recorded)


def _recorded(place: Place, sizes: dict[PurePosixPath, int]) -> Recorded:
    if PurePosixPath(CRATE) not in sizes:
        if SCENE not in sizes:
            raise UserError(f"{place.name}: holds no run; name outputs/<scene>/<level>, or a copy of it")
        values = _values(place)
        raise UserError(f"{place.name}: has no {CRATE} to compare it with; "
                        f"{how_to_make(values.get('name', '<scene>'), values.get('accuracy', '<level>'))}")
    with place.open(PurePosixPath(CRATE)) as file:
        recorded = read_crate(file.read(), place.name)
    if SCENE in sizes:
        values = _values(place)
        scene, level = values.get("name"), values.get("accuracy")
        if scene and level and (scene, level) != (recorded.scene, recorded.level):
            raise UserError(f"{place.name}/{CRATE}: is the crate of {recorded.scene} at {recorded.level}, but the run "
                            f"is {scene} at {level}; {how_to_make(scene, level)}")
    return recorded


def _values(place: Place) -> dict[str, Any]:
    """The scene of a run as it is written, without any check; empty where it is damaged."""
    try:
        with place.open(SCENE) as file:
            values = json.loads(file.read())
    except ValueError:
        return {}
    return values if isinstance(values, dict) else {}


def _scene(place: Place, found: Iterable[PurePosixPath]) -> tuple[Scene | None, list[str], str]:
    """The scene of a run and the names of its segments, or why this code cannot tell them."""
    if SCENE not in found:
        return None, [], ""
    with place.folder() as folder:
        run = RunFolder(folder)
        try:
            return run.scene, run.segments, ""
        except UserError as error:
            return None, [], str(error.messages[0]).replace(f"{folder}/", "") + ", so that neither segments nor the " \
                "version of the code could be compared"


def _missing(recorded: Recorded, found: dict[PurePosixPath, int]) -> list[str]:
    """Sentences on files that the crate has and the run has not: whole folders by one, frames of a sequence by one."""
    missing = sorted(recorded.files.keys() - found.keys())
    there = {parent for path in found for parent in path.parents}
    sentences, rest = [], []
    # The largest folders of which nothing is left.
    gone: dict[PurePosixPath, list[PurePosixPath]] = {}
    for path in missing:
        lost = [parent for parent in path.parents if parent not in there and parent != PurePosixPath()]
        gone.setdefault(lost[-1], []).append(path) if lost else rest.append(path)
    for folder, paths in gone.items():
        size = sum(recorded.files[path][0] for path in paths)
        sentences.append(f"{folder}: is missing, with {counted(len(paths), 'file')} of {size:,} bytes")
    for folder, group in itertools.groupby(rest, key=lambda path: path.parent):
        paths = list(group)
        frames = sorted({frame_of(path) for path in paths} - {None})
        if frames:
            kept = sorted({frame_of(path) for path in found if path.parts[0] == folder.parts[0]} - {None})
            sentences.append(f"{folder}: {', '.join(frames[:3])}{f' and {len(frames) - 3} more' * (len(frames) > 3)} "
                             f"{'is' if len(frames) == 1 else 'are'} missing{_where(frames, kept)}")
        sentences += _several([path for path in paths if not frame_of(path)], "is missing")
    return sentences


def _where(frames: Sequence[str], kept: Sequence[str]) -> str:
    """Where frames are missing beside those that are there: among them, or at an end."""
    if not kept:
        return ""
    if frames[-1] < kept[0]:
        return f" before {kept[0]}"
    return f" after {kept[-1]}" if frames[0] > kept[-1] else f" among {kept[0]} to {kept[-1]}"


def _changed(place: Place, recorded: Recorded, found: dict[PurePosixPath, int],
             threads: int) -> tuple[list[PurePosixPath], list[PurePosixPath]]:
    """The files of another size, which need not be read, and those of the same size but another content."""
    both = sorted(recorded.files.keys() & found.keys())
    same_size = [path for path in both if found[path] == recorded.files[path][0]]

    def differs(path: PurePosixPath) -> bool:
        with place.open(path) as file:
            digest = hashlib.sha256()
            while block := file.read(2**20):
                digest.update(block)
        return digest.hexdigest() != recorded.files[path][1]

    with ThreadPoolExecutor(threads) as pool:
        other = [path for path, wrong in zip(same_size, pool.map(differs, same_size), strict=True) if wrong]
    return sorted({*both} - {*same_size}), other


def counted(number: int, what: str) -> str:
    """Return a number of things with their name in the singular or the plural.

    >>> counted(1, "file"), counted(1200, "file")
    ('1 file', '1,200 files')
    """
    return f"{number:,} {what}{'' if number == 1 else 's'}"


def _several(paths: Sequence[PurePosixPath], what: str) -> list[str]:
    """A sentence for each of some files, and one for the others of many."""
    rest = paths[MOST:]
    kinds = dict.fromkeys(path.parts[0] for path in rest)
    return [*(f"{path}: {what}" for path in paths[:MOST]),
            *([f"{', '.join(kinds)}: {counted(len(rest), 'more file')} with the same difference"] if rest else [])]


def _older(recorded: Recorded, scene: Scene) -> list[str]:
    """A sentence on stages whose results this code would make otherwise."""
    older = outdated(((job.stage, job.digests) for job in recorded.jobs), scene)
    return [f"code: {', '.join(older)} {'has' if len(older) == 1 else 'have'} changed since the run was made; "
            "this code may give other results: run the scene again to see"] if older else []
