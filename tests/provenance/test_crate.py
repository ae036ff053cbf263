"""The crate of a run, and what is said of a run that is not as its crate says."""
import base64
import hashlib
import importlib.metadata
import json
import os
import shutil
import sys
import zipfile
from pathlib import Path

import pytest
from conftest import ROOT

from pipeline import crate, verify
from pipeline.base.errors import UserError
from pipeline.runs.contents import CRATE
from pipeline.scenes.load import load_scene
from pipeline.workflow.digest import stage_digest
from pipeline.workflow.notes import NOTES

sys.path.insert(0, str(ROOT / "tests" / "judges"))

import ro_crate

RUN = Path("outputs/tiny/draft")
BEGUN = 1.7e9  # s since 1970
# What rules make: rule -> stage, segment, files.
MADE = {
    "scene": ("scene", None, ["scene.json"]),
    "eye": ("eye", None, ["eye.vtp", "eye.json"]),
    "simulate_000": ("simulate", "000", ["frames/segment_000", "checkpoints/segment_000.npz"]),
    "simulate_001": ("simulate", "001", ["frames/segment_001", "checkpoints/segment_001.npz"]),
    "render_000": ("render", "000", ["images/segment_000"]),
    "render_001": ("render", "001", ["images/segment_001"]),
    "page": ("page", None, ["index.html"]),
}
FRAMES = {"000": range(3), "001": range(3, 5)}
READ = {"eye": ["scene.json"], "simulate_000": ["scene.json", "eye.vtp"], "page": ["scene.json", "images/segment_000"]}


def note(name: str, rule: str, stage: str, digest: str, inputs: list[str], begun: float) -> None:
    """Note a file as Snakemake does."""
    path = NOTES / base64.urlsafe_b64encode(str(RUN / name).encode()).decode()
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({
        "rule": rule.partition("_")[0], "log": [str(RUN / "logs" / f"{rule}.log")], "params": [repr(digest)],
        "input": [str(RUN / one) for one in inputs], "starttime": begun, "endtime": begun + 5.0,
        "shellcmd": f"python -m pipeline.{stage} {RUN / name} 2>&1 | tee log"}))


def make(rule: str, stage: str, segment: str | None, names: list[str], digest: str, begun: float) -> None:
    for name in names:
        path = RUN / name
        files = [path] if path.suffix else [path / f"frame_{number:05d}.vtu" for number in FRAMES[segment]]
        for file in files:
            file.parent.mkdir(parents=True, exist_ok=True)
            if file.name != "scene.json":
                file.write_text(f"{file} of {rule}")
        note(name, rule, stage, digest, READ.get(rule, []), begun)


@pytest.fixture(scope="module")
def projects(tmp_path_factory):
    """Return two projects with a run in which every file is a short text: in the second one it has its crate."""
    projects = [tmp_path_factory.mktemp(name) / "project" for name in ("run", "told")]
    with pytest.MonkeyPatch.context() as patch:
        for folder in projects:
            folder.mkdir()
            patch.chdir(folder)
            make_run()
        crate.main([str(RUN)])
    return projects


def make_run() -> None:
    RUN.mkdir(parents=True)
    scene = load_scene(ROOT / "config" / "scenes" / "tests" / "tiny.yaml", "draft")
    (RUN / "scene.json").write_text(scene.to_json())
    for number, (rule, (stage, segment, names)) in enumerate(MADE.items()):
        make(rule, stage, segment, names, stage_digest(stage, scene), BEGUN + 10.0 * number)
    (RUN / "logs").mkdir()
    (RUN / "logs" / "eye.log.json").write_text(json.dumps({"wall": 2.0, "cpu": 1.5, "memory": 1e8}))


@pytest.fixture
def run(projects, tmp_path, monkeypatch):
    """Return the folder of a run without a crate, in a project of its own."""
    return copied(projects[0], tmp_path, monkeypatch)


@pytest.fixture
def told(projects, tmp_path, monkeypatch):
    """Return the folder of a run with its crate, in a project of its own."""
    return copied(projects[1], tmp_path, monkeypatch)


def copied(project, tmp_path, monkeypatch):
    monkeypatch.chdir(shutil.copytree(project, tmp_path / "project"))
    return RUN


def said(capsys, folder, *options) -> tuple[int, str]:
    capsys.readouterr()
    code = verify.main([str(folder), *options])
    return code, capsys.readouterr().out


def entities(folder: Path) -> dict[str, dict]:
    return {one["@id"]: one for one in json.loads((folder / CRATE).read_text())["@graph"]}


def test_a_run_is_as_its_crate_says_wherever_it_lies(told, tmp_path, capsys):
    assert said(capsys, told)[0] == 0
    shutil.move(told, tmp_path / "elsewhere")
    code, text = said(capsys, tmp_path / "elsewhere")
    assert code == 0 and "nothing differs" in text and "tiny at draft" in text
    for top in ("", "run"):
        with zipfile.ZipFile(tmp_path / "run.zip", "w") as archive:
            for path in (tmp_path / "elsewhere").rglob("*"):
                archive.write(path, Path(top, path.relative_to(tmp_path / "elsewhere")))
        assert said(capsys, tmp_path / "run.zip")[0] == 0


SPOILED = {
    "changed": (lambda run: (run / "frames/segment_000/frame_00001.vtu").write_text("x"),
                "frames/segment_000/frame_00001.vtu: is changed: it has another size"),
    "flipped": (lambda run: flip(run / "frames/segment_000/frame_00001.vtu"),
                "frames/segment_000/frame_00001.vtu: is changed: as large as in the crate, but with another content"),
    "missing": (lambda run: (run / "eye.vtp").unlink(), "eye.vtp: is missing"),
    "missing in the middle": (lambda run: (run / "frames/segment_001/frame_00003.vtu").unlink(),
                              "frames/segment_001: frame_00003 is missing among frame_00000 to frame_00004"),
    "missing at the end": (lambda run: (run / "images/segment_001/frame_00004.vtu").unlink(),
                           "images/segment_001: frame_00004 is missing after frame_00003"),
    "a segment": (lambda run: shutil.rmtree(run / "images/segment_001"),
                  "images/segment_001: is missing, with 2 files"),
    "a kind": (lambda run: shutil.rmtree(run / "frames"), "frames: is missing, with 5 files"),
    "added": (lambda run: (run / "mine.txt").touch(), "mine.txt: is not in the crate"),
    "of a longer run": (lambda run: shutil.copytree(run / "frames/segment_001", run / "frames/segment_002"),
                        "segment_002: the scene has no such segment, but 2 files of it are here"),
    "another scene": (lambda run: replace(run / "scene.json", '"duration": 0.2', '"duration": 0.1'),
                      "segment_001: the scene has no such segment"),
    "no scene": (lambda run: (run / "scene.json").unlink(), "scene.json: is missing"),
    "a scene of other code": (lambda run: replace(run / "scene.json", '"duration"', '"durance"'),
                              "so that neither segments nor the version of the code could be compared"),
}


def flip(path: Path) -> None:
    """Change a byte and nothing else, as a bad disk does."""
    dates = path.stat()
    path.write_bytes(path.read_bytes()[:-1] + b"?")
    os.utime(path, ns=(dates.st_atime_ns, dates.st_mtime_ns))


def replace(path: Path, old: str, new: str) -> None:
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))


@pytest.mark.parametrize("how", SPOILED)
def test_every_difference_is_a_sentence(told, capsys, how):
    spoil, sentence = SPOILED[how]
    spoil(told)
    code, text = said(capsys, told, "--any-code")
    assert code == verify.DIFFERS
    assert len([line for line in text.splitlines() if sentence in line]) == 1, text
    assert "from the crate" in text.splitlines()[-1]


def test_logs_and_what_was_set_aside_are_no_results(told, capsys):
    (told / "damaged").mkdir()
    for name in ("logs/page.log", "damaged/eye.vtp", ".half.1.vtp"):
        (told / name).touch()
    assert said(capsys, told)[0] == 0


def test_many_differences_are_told_in_short(told, capsys):
    for number in range(60):
        (told / f"mine_{number:02d}.txt").touch()
    text = said(capsys, told)[1]
    assert "mine_19.txt" in text and "mine_20.txt: is not" not in text and "40 more files" in text


def test_what_older_code_made_is_told(run, capsys):
    make("render_001", "render", "001", ["images/segment_001"], "0123456789abcdef", BEGUN)
    crate.main([str(run)])
    code, text = said(capsys, run)
    assert code == verify.DIFFERS
    assert text.startswith("code: render has changed since the run was made; this code may give other results")
    assert said(capsys, run, "--any-code")[0] == 0


CANNOT = {
    "no crate": (lambda run: (run / CRATE).unlink(), f"has no {CRATE} .*snakemake -j2 outputs/tiny/draft/{CRATE}"),
    "half a crate": (lambda run: (run / CRATE).write_text('{"@graph": ['), "is damaged or no crate of a run"),
    "another's crate": (lambda run: (run / CRATE).write_text('{"@graph": [{"@id": "./", "@type": "Dataset"}]}'),
                        "is damaged or no crate of a run"),
    "another run's": (lambda run: replace(run / CRATE, "Run of tiny at", "Run of still_eye at"),
                      "is the crate of still_eye at draft, but the run is tiny at draft"),
    "a way out": (lambda run: replace(run / CRATE, '{"@id": "eye.vtp", "@type"', '{"@id": "../eye.vtp", "@type"'),
                  "names ../eye.vtp, which is outside"),
    "no run": (shutil.rmtree, "no such folder or ZIP archive"),
    "an empty folder": (lambda run: [shutil.rmtree(run), run.mkdir()], "holds no run"),
}


@pytest.mark.parametrize("how", CANNOT)
def test_what_cannot_be_compared_is_one_sentence(told, how):
    spoil, sentence = CANNOT[how]
    spoil(told)
    with pytest.raises(UserError, match=sentence) as error:
        verify.main([str(told)])
    assert len(error.value.messages) == 1


def test_a_file_that_is_no_archive_is_one_sentence(tmp_path):
    (tmp_path / "run.zip").write_text("nothing")
    with pytest.raises(UserError, match="neither a folder nor a ZIP archive"):
        verify.main([str(tmp_path / "run.zip")])


def test_the_crate_tells_how_the_run_was_made(told):
    found = entities(told)
    eye = found["eye.vtp"]
    content = (told / "eye.vtp").read_bytes()
    assert (eye["contentSize"], eye["sha256"]) == (str(len(content)), hashlib.sha256(content).hexdigest())
    job = found["#job-eye"]
    assert job["startTime"] == "2023-11-14T22:13:30.000+00:00" and job["endTime"] == "2023-11-14T22:13:35.000+00:00"
    assert job["object"][0] == {"@id": "scene.json"} and job["result"] == [{"@id": "eye.json"}, {"@id": "eye.vtp"}]
    scene = load_scene(ROOT / "config" / "scenes" / "tests" / "tiny.yaml", "draft")
    assert found[job["object"][1]["@id"]]["value"] == stage_digest("eye", scene)
    assert [found[one["@id"]]["value"] for one in job["resourceUsage"]] == [2.0, 1.5, 1e8]
    assert found["./"]["name"] == f"{scene.title} (tiny at draft)"
    assert found["#value-particle_spacing"]["value"] == 2e-3
    assert found["#package-numpy"]["softwareVersion"] == importlib.metadata.version("numpy")
    assert "cores" in found["#computer"]["name"]
    assert (told / "workflow" / "Snakefile").read_bytes() == (ROOT / "Snakefile").read_bytes()
    assert str(Path.cwd()) not in (told / CRATE).read_text()  # no path of this computer


def test_a_crate_lists_what_the_run_made_and_nothing_else(run):
    note("film.mp4", "film", "movie", "0123456789abcdef", [], BEGUN)                # on request
    (run / "film.mp4").touch()
    FRAMES["002"] = range(5, 7)
    make("simulate_002", "simulate", "002", ["frames/segment_002"], "0" * 16, BEGUN)  # of a longer run
    (run / "mine.txt").touch()
    crate.main([str(run)])
    found = entities(run)
    assert "film.mp4" in found and "#job-film" in found
    assert not [name for name in found if "segment_002" in name or "mine" in name]


def test_the_crate_of_the_same_run_is_the_same(told):
    before = (told / CRATE).read_bytes()
    (told / CRATE).unlink()
    shutil.rmtree(told / "workflow")
    crate.main([str(told)])
    without_dates = [json.loads(text.decode())["@graph"] for text in (before, (told / CRATE).read_bytes())]
    for graph in without_dates:
        for one in graph:
            if one["@id"].startswith("workflow/"):  # written anew
                one.pop("dateModified", None)
    assert without_dates[0] == without_dates[1]


def test_a_byte_that_changed_after_the_crate_is_found_when_the_crate_is_made_again(told, capsys):
    flip(told / "eye.vtp")
    (told / "index.html").write_text("another page")
    crate.main([str(told)])
    code, text = said(capsys, told)
    assert code == verify.DIFFERS and text.startswith("eye.vtp: is changed") and "index.html" not in text


def test_without_notes_of_snakemake_there_is_no_crate(run):
    shutil.rmtree(NOTES)
    with pytest.raises(UserError, match="has no notes of this run"):
        crate.main([str(run)])
    assert not (run / CRATE).exists()


@pytest.mark.thorough
def test_the_validator_finds_nothing(told):
    python = ro_crate.found_python()
    if python is None:
        pytest.skip(f"no Python with rocrate_validator on this machine ({ro_crate.PYTHON} names one)")
    said = ro_crate.judged(told, python)
    assert said["issues"] == [] and said["checks"] > 50
    replace(told / CRATE, '"instrument"', '"tool"')
    assert ro_crate.judged(told, python)["issues"]
