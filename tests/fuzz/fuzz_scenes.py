"""Read thousands of spoiled scenes and studies: what is refused is refused in sentences, what is accepted survives.

    python tests/fuzz/fuzz_scenes.py                    5,000 files
    python tests/fuzz/fuzz_scenes.py --examples 200 --seed 3

Every file is read as the stages read it. Beside a scene or a study only sentences may come out of that, each in one
line: no traceback, nothing that takes longer than ten seconds, no command, pickle or connection, no file outside of the
project, no memory beyond 1 GB. What is accepted is written, read again, planned, advised on, put into plots, pictures,
pages and the script for ParaView, and where it has a small container, filled with particles.
"""
import argparse
import ast
import collections
import contextlib
import dataclasses
import functools
import json
import math
import os
import re
import shutil
import signal
import sys
import tempfile
import time
import types
import typing
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from hypothesis import HealthCheck, Phase, given, seed, settings  # noqa: E402
from hypothesis import strategies as st  # noqa: E402
from PIL import Image, ImageDraw  # noqa: E402

from pipeline.advice import report  # noqa: E402
from pipeline.base import page  # noqa: E402
from pipeline.base.errors import UserError  # noqa: E402
from pipeline.cavity.container import container_arrays  # noqa: E402
from pipeline.exchange.paraview_view import view_script  # noqa: E402
from pipeline.measures.plots import overview  # noqa: E402
from pipeline.pictures.marks import header  # noqa: E402
from pipeline.scenes import load  # noqa: E402
from pipeline.scenes.eye_shape import published_volume  # noqa: E402
from pipeline.scenes.folders import scene_paths  # noqa: E402
from pipeline.scenes.load import load_resolved, load_scene  # noqa: E402
from pipeline.scenes.model import Scene  # noqa: E402
from pipeline.scenes.reader import MOST_MESSAGES  # noqa: E402
from pipeline.studies.family import family_names  # noqa: E402
from pipeline.studies.plan import load_study  # noqa: E402
from pipeline.workflow.digest import UNREAD, _part_read  # noqa: E402

EXAMPLES = 5000
LONGEST = 10.0  # s of a core that a file may take
TIMERS = ((signal.SIGPROF, signal.ITIMER_PROF, LONGEST), (signal.SIGALRM, signal.ITIMER_REAL, 30.0 * LONGEST))
MOST_MEMORY = 1e9  # bytes of the whole process
MOST_PARTICLES = 20_000  # with which a container is filled here
SCRIPT = "<script>alert(1)</script>"
CODE = ("os.system", "subprocess.Popen", "os.exec", "os.posix_spawn", "os.fork", "pickle.find_class", "socket.connect",
        "os.remove", "os.rename", "shutil.rmtree")
NUMBERS = ("0", "-0", "1", "2", "3", "-1", "0.5", "1e-9", "1e-12", "1e-300", "1e-320", "1e300", "-1e308", "1e400",
           "010", "0x10", "0o7", "1_000", "1:30", ".5", "5.", "+1", ".nan", ".inf", "-.inf", "9" * 400, "1e", "1.2.3",
           "--1")
UNITS = ("", "m", "mm", "um", "nm", "km", "s", "ms", "h", "days", "Pa s", "mPa s", "cSt", "m2/s", "N/m", "mN/m",
         "kg/m3", "g/mL", "deg", "rad", "deg/s", "rpm", "%", "mL/s", "1/s", "Hz", "m/s", "m/s2", "m**9", "m^-9", "dB",
         "degC", "K", "banana", "m m m", "°", "µm", "%%", "m/", "/m", "m//m", "1/1", "m.m", "m)(", "**", "m**2**2", "e",
         "inf", "nan")
WORDS = ("yes", "no", "on", "off", "null", "~", "true", "False", "", " ", "tiny", "tamponade", "still_eye", "aqueous",
         "silicone_oil_1000", "draft", "../../../etc/passwd", "/etc/passwd", "/dev/zero", "eye.stl", "head.csv",
         "..", ".", "a/b", "2024-01-01", "12:30:45", "=", "<<", "!!python/object/apply:os.system", "*a", "&a", SCRIPT,
         f"</title>{SCRIPT}", "$x_{", "a $ b " * 30, "$\\frac{", "{{ 7 * 7 }}", "{0.__class__}",
         "__import__('os').system('touch hacked')", "$(touch hacked)", "`touch hacked`", "%s%n", "'; touch hacked; '",
         '"', "'", "\\", "@scene@", "@folder@", "two\nlines", "tab\there", "a\rb", "\u2028", "\ud800", "\udfff", "\x00",
         "\x1b[2J", "\x85", "\u202e", "\ufeff", "\U0001f600" * 40, "e\u0301\u0301\u0301", "\uffff", "x" * 199,
         "x" * 201, "y" * 6000, "\u0627\u0644\u0639\u064a\u0646")
SHIPPED = list(scene_paths(ROOT / "config" / "scenes").values())


class Hang(BaseException):
    """A file took too long."""


# Values, right and wrong

def quantities() -> st.SearchStrategy[str]:
    """Return numbers with and without units, as they stand in a file."""
    return st.builds(lambda number, unit: f"{number} {unit}".strip(), st.sampled_from(NUMBERS), st.sampled_from(UNITS))


def words() -> st.SearchStrategy[str]:
    """Return texts that have a meaning somewhere, and any others."""
    return st.one_of(st.sampled_from(WORDS), st.text(st.characters(codec=None), max_size=30))


def anything() -> st.SearchStrategy[Any]:
    """Return plain data of any kind."""
    leaves = st.one_of(quantities(), words(), st.none(), st.booleans(), st.integers(), st.floats())
    names = st.one_of(words(), st.sampled_from(("liquid", "size", "to")))
    return st.recursive(leaves, lambda inner: st.one_of(
        st.lists(inner, max_size=4), st.dictionaries(names, inner, max_size=3)), max_leaves=6)


def proper(kind: Any, metadata: Any, draw: Callable) -> Any:
    """Draw a value that a field may have, at least at first sight."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin is types.UnionType:
        return proper(arguments[0], metadata, draw)
    if dataclasses.is_dataclass(kind):
        return record(kind, draw)
    if "kinds" in metadata:
        names = draw(st.lists(st.sampled_from(sorted(metadata["kinds"])), max_size=3, unique=True))
        return {name: record(metadata["kinds"][name], draw) for name in names}
    if origin is tuple:
        count = draw(st.integers(0, 3)) if arguments[-1] is Ellipsis else len(arguments)
        return [proper(arguments[0], metadata, draw) for _ in range(count)]
    if origin is dict:
        return {name: draw(st.sampled_from((0.2, 0.5, 0.8, 1.0))) for name in ("aqueous", "silicone_oil_1000")}
    if kind is bool:
        return draw(st.booleans())
    if kind is str:
        choices = ("aqueous", "silicone_oil_1000") if metadata["liquid"] else metadata["choices"]
        return draw(st.sampled_from(choices) if choices else words())
    low = next((metadata[name] for name in ("minimum", "exclusive_minimum") if metadata[name] is not None), None)
    ends = [end for end in (low, metadata["maximum"]) if end is not None]
    tried = [*ends, *(end * factor for end in ends for factor in (0.999, 1.001, 0.5, 2.0)), 1e-3, 1e-2, 0.1, 1.0, 10.0]
    return draw(st.one_of(st.sampled_from(tried), st.floats(low, metadata["maximum"])))


def record(kind: Any, draw: Callable) -> dict[str, Any]:
    """Draw a mapping for a dataclass: what it needs, and some of the rest."""
    found = {}
    for field in dataclasses.fields(kind):
        needed = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        if draw(st.integers(0, 9)) < (9 if needed else 2):
            found[field.name] = proper(field.type, field.metadata, draw)
    return found


def spoiled(data: Any, draw: Callable) -> Any:
    """Return plain data with one thing in it replaced, removed or added."""
    if isinstance(data, dict) and data and draw(st.integers(0, 4)):
        name = draw(st.sampled_from(sorted(data)))
        if draw(st.integers(0, 9)) == 0:
            return {key: value for key, value in data.items() if key != name}
        return {**data, name: spoiled(data[name], draw)}
    if isinstance(data, list) and data and draw(st.integers(0, 4)):
        place = draw(st.integers(0, len(data) - 1))
        return [*data[:place], spoiled(data[place], draw), *data[place + 1:]]
    if isinstance(data, dict) and draw(st.booleans()):
        return {**data, draw(words()): draw(anything())}
    return draw(anything())


# Files

FIELDS = {field.name: field for field in dataclasses.fields(Scene) if field.name not in ("name", "accuracy", "liquids")}


@st.composite
def scene_data(draw: Callable) -> dict[str, Any]:
    """Draw what a scene file holds: another scene with some changes, or a box, spoiled or not."""
    if draw(st.booleans()):
        data: dict[str, Any] = {"extends": draw(st.sampled_from(SHIPPED)).stem}
    else:
        data = {"dimension": 2, "liquids": ["aqueous", "silicone_oil_1000"], "container": {"size": [0.1, 0.1]},
                "blocks": [{"liquid": "aqueous", "lower": [0, 0], "upper": [0.05, 0.05]}],
                "numerics": {"particle_spacing": 0.005, "scheme": draw(st.sampled_from(("dfsph", "wcsph")))},
                "output": {"duration": 0.5}}
    for name in draw(st.lists(st.sampled_from(sorted(FIELDS)), max_size=3, unique=True)):
        value = proper(FIELDS[name].type, FIELDS[name].metadata, draw)
        data[name] = {**data[name], **value} if isinstance(value, dict) and isinstance(data.get(name), dict) else value
    if draw(st.integers(0, 3)) == 0:
        data["liquids"] = draw(st.sampled_from((
            ["aqueous"], {"aqueous": {"density": "1 g/mL"}, "silicone_oil_1000": {"color": "#ff0000"}},
            {"aqueous": {"source": SCRIPT}, "silicone_oil_1000": {"dynamic_viscosity": "5000 cSt"}}, ["helium"], [])))
    for _ in range(draw(st.sampled_from((0, 0, 0, 1, 1, 2)))):
        changed = spoiled(data, draw)
        data = changed if isinstance(changed, dict) else data
    return data


@st.composite
def scene_text(draw: Callable) -> bytes:
    """Draw the text of a scene file: data, a shipped scene with a few letters changed, or anything."""
    kind = draw(st.integers(0, 9))
    if kind < 6:
        return json.dumps(draw(scene_data())).encode()  # JSON is YAML
    if kind == 6:
        lines = [f"{name}: {draw(st.one_of(quantities(), words()))}" for name in draw(
            st.lists(st.sampled_from(sorted(FIELDS)), max_size=3, unique=True))]
        return "\n".join(["extends: tiny", *lines]).encode("utf-8", "surrogatepass")
    if kind == 7:
        letters = st.text(st.characters(codec="utf-8"), max_size=200)
        return draw(st.one_of(st.binary(max_size=200), letters.map(str.encode)))
    if kind == 8 and draw(st.integers(0, 3)) == 0:
        return draw(st.sampled_from(BOMBS))
    text = draw(st.sampled_from(SHIPPED)).read_text()
    for _ in range(draw(st.integers(1, 4))):
        place, length = draw(st.integers(0, len(text))), draw(st.integers(0, 12))
        new = draw(st.one_of(st.text(":-[]{}&*!|>'\"%@#,?~ \n\t", max_size=4), quantities(), words()))
        text = text[:place] + new + text[place + length:]
    return text.encode("utf-8", "surrogatepass")


@functools.cache
def resolved(path: Path) -> str:
    """Return a shipped scene as the first stage writes it."""
    return load_scene(path, "draft").to_json()


@st.composite
def resolved_text(draw: Callable) -> bytes:
    """Draw a resolved scene with changes."""
    data = json.loads(resolved(draw(st.sampled_from(SHIPPED))))
    for _ in range(draw(st.integers(1, 3))):
        data = spoiled(data, draw)
    text = json.dumps(data).encode()
    return text[:draw(st.integers(0, len(text)))] if draw(st.integers(0, 9)) == 0 else text


@st.composite
def study_text(draw: Callable) -> bytes:
    """Draw a study."""
    family = draw(st.sampled_from(family_names()))
    text = (ROOT / "config" / "studies" / "validation.yaml").read_text()
    if draw(st.booleans()):
        data = {"title": draw(words()), "cases": {family: spoiled(
            {"scene": "tiny", "seed": draw(st.lists(st.integers(), max_size=5))}, draw)}}
        return json.dumps(data if draw(st.booleans()) else spoiled(data, draw)).encode()
    place = draw(st.integers(0, len(text)))
    return (text[:place] + draw(words()) + text[place + draw(st.integers(0, 9)):]).encode("utf-8", "surrogatepass")


@st.composite
def files(draw: Callable) -> tuple[str, bytes]:
    """Draw a kind of file and its bytes."""
    kind = draw(st.sampled_from(("scene", "scene", "resolved", "study")))
    return kind, draw({"scene": scene_text(), "resolved": resolved_text(), "study": study_text()}[kind])


# Small where they are written, large where they are read, or just large.
BOMBS = (
    b"a: " + b"[" * 50_000, b"a: " + b"{a: " * 20_000, b"- " * 50_000, b"? " * 50_000, b"extends: case",
    b"liquids: [" + b"aqueous, " * 20_000 + b"]", b"title: " + b"x" * 199_000, b"x" * 300_000, b"a: 1\n" * 40_000,
    b"".join(b"k%d: 1\n" % number for number in range(15_000)), b"title: |\n" + b"  x\n" * 40_000,
    b"a0: &a0 [x, x]\n" + b"".join(b"a%d: &a%d [*a%d, *a%d]\n" % (n, n, n - 1, n - 1) for n in range(1, 40)),
    b"dimension: 2\nliquids: [aqueous]\ncontainer: {size: [1, 1]}\nnumerics: {particle_spacing: 0.01}\n"
    b"output: {duration: 1}\nblocks:\n" + b"- {liquid: aqueous, lower: [0, 0], upper: [1, 1]}\n" * 3000)


# What must hold

def peak_memory() -> int:
    """Most memory that this process has held, bytes; `getrusage` may tell that of the one that started it."""
    return 1024 * int(re.search(r"VmHWM:\s+(\d+)", Path("/proc/self/status").read_text())[1])


class Watch:
    """Sees what Python does beside computing, while it is told to."""

    def __init__(self, folder: Path):
        self.allowed = (str(folder), str(ROOT), os.path.realpath(sys.prefix), sys.base_prefix, "/usr/", "/proc/",
                        "/sys/")
        self.folder, self.active, self.seen = str(folder), False, []
        sys.addaudithook(self)

    def __call__(self, event: str, arguments: tuple) -> None:
        if not self.active:
            return
        if event in CODE:
            self.seen.append(f"{event} {arguments}")
        elif event == "open" and isinstance(arguments[0], str):
            path, writes = os.path.abspath(arguments[0]), (arguments[2] or 0) & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
            if not path.startswith(self.allowed) or writes:
                self.seen.append(f"open {path}")

    @contextlib.contextmanager
    def ing(self) -> Iterator[None]:
        """Watch a block; end it when it takes too long."""
        def stop(*_):
            raise Hang(f"took longer than {LONGEST:g} s")

        for kind, timer, limit in TIMERS:
            signal.signal(kind, stop)
            signal.setitimer(timer, limit)
        self.active = True
        try:
            yield
        finally:
            self.active = False
            for _, timer, _ in TIMERS:
                signal.setitimer(timer, 0.0)
        assert not self.seen, self.seen


def sentences(error: UserError) -> None:
    """Assert that an error is few sentences, each in one line."""
    assert 1 <= len(error.messages) <= 2 * MOST_MESSAGES + 2
    for message in error.messages:
        assert message.isprintable() and 0 < len(message) < 5000, message[:5000]


def survives(scene: Scene, folder: Path) -> None:
    """Do with an accepted scene what later stages do with what it says."""
    text = scene.to_json()
    (folder / "scene.json").write_text(text, encoding="utf-8")
    assert load_resolved(folder / "scene.json") == scene
    assert all(scene.frames_of_segment(number) for number in range(min(scene.segment_count, 3)))
    for unread in UNREAD.values():
        _part_read(scene, unread)
    title = scene.title or scene.name
    assert "\n" not in title + scene.label
    volume = published_volume(scene.eye.axial_length) if scene.container is None else float(
        math.prod(scene.container.size))
    advice = report.report_of(scene, volume)
    report.text_of(advice)
    pages = [report.html_of(advice), page.page(title, [page.paragraph(scene.description), page.paragraph(
        page.bold(scene.label)), page.bullets([one.source for one in scene.liquids])])]
    for one in pages:
        assert SCRIPT not in one and one.encode()
    script = ast.walk(ast.parse(view_script(scene, folder, painted=True)))
    assert f"{title} ({scene.accuracy})" in [node.value for node in script if isinstance(node, ast.Constant)]
    image = Image.new("RGB", (320, 180))
    header(ImageDraw.Draw(image), image.size, title=title, time="t = 0.00 s", subtitle="", label=scene.label)
    if scene.title not in PLOTTED:
        PLOTTED.add(scene.title)
        assert overview([], {}, [], f"{title} ({scene.accuracy})").startswith(b"\x89PNG")
    if scene.container is not None:
        particles = volume / scene.numerics.particle_spacing**scene.dimension
        if particles < MOST_PARTICLES:
            container_arrays(scene)


PLOTTED: set[str] = set()


def run(examples: int, number: int | None = None) -> collections.Counter:
    """Try so many files; returns what became of them."""
    found: collections.Counter = collections.Counter()
    with tempfile.TemporaryDirectory() as place:
        project = Path(place) / "project"
        shutil.copytree(ROOT / "config", project / "config")
        (project / "config" / "scenes" / "head.csv").write_text("time [s],pitch [deg],roll [deg]\n0,0,0\n1,30,0\n")
        scene_file, study_file = (project / "config" / kind / "case.yaml" for kind in ("scenes", "studies"))
        resolved_file = project / "scene.json"
        readers = {"scene": (scene_file, lambda: load_scene(scene_file, "draft")),
                   "resolved": (resolved_file, lambda: load_resolved(resolved_file)),
                   "study": (study_file, lambda: load_study("case", "draft", study_file.parent))}
        watch = Watch(project)
        # These files are not spoiled: they are read once.
        for name in ("load_materials", "load_accuracy_levels"):
            setattr(load, name, functools.cache(getattr(load, name)))

        @settings(max_examples=examples, deadline=None, database=None, suppress_health_check=list(HealthCheck),
                  print_blob=False, phases=(Phase.generate, Phase.shrink))  # to explain is to trace every line
        @given(files())
        def one(file: tuple[str, bytes]) -> None:
            kind, text = file
            path, read = readers[kind]
            path.write_bytes(text)
            begin = time.process_time()
            try:
                with watch.ing():
                    result = read()
            except UserError as error:
                sentences(error)
                result = None
            found["slowest, ms"] = max(found["slowest, ms"], round(1e3 * (time.process_time() - begin)))
            found[f"{kind} {'refused' if result is None else 'accepted'}"] += 1
            if isinstance(result, Scene):
                try:
                    survives(result, project)
                except UserError as error:
                    sentences(error)
            found["files"] += 1
            memory = peak_memory()
            assert memory < MOST_MEMORY, f"{memory / 1e6:.0f} MB"
            found["memory, MB"] = round(memory / 1e6)
            path.unlink()

        (seed(number)(one) if number is not None else one)()
        left = sorted(path.name for path in Path(place).iterdir())
        assert left == ["project"] and not list(Path(place).rglob("hacked")), left
    return found


def main() -> None:
    """Run from the command line."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--examples", type=int, default=EXAMPLES, metavar="N", help=f"files to try (default {EXAMPLES})")
    p.add_argument("--seed", type=int, metavar="N", help="of the choice of files (default: by chance)")
    options = p.parse_args()
    begin = time.perf_counter()
    for name, count in sorted(run(options.examples, options.seed).items()):
        print(f"{name}: {count}")
    print(f"no traceback, no hang, nothing run, in {time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
