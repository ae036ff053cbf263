"""A lack of memory ends every stage in one sentence, whichever library meets it, and however."""
import resource
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT

from pipeline.base import memory
from pipeline.workflow.shell import PREFIX

MIB = 2**20


def limited(code_or_stage: list[str], limit: int) -> subprocess.CompletedProcess:
    """Run Python with little address space."""
    return subprocess.run([sys.executable, *code_or_stage], cwd=ROOT, capture_output=True, text=True,
                          preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (limit, limit)))


def told(done: subprocess.CompletedProcess) -> str:
    """The one sentence of what Python has run; libraries print words of their own beside, but no traceback is left."""
    sentences = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert done.returncode == 1 and len(sentences) == 1 and "Traceback" not in done.stderr, done.stderr
    return sentences[0]


@pytest.mark.parametrize("stage", ["eye", "voxelize", "simulate", "render", "metrics"])
@pytest.mark.parametrize("limit", [200, 500])
def test_libraries_that_cannot_be_loaded_are_one_sentence(stage, limit):
    sentence = told(limited(["-m", f"pipeline.{stage}", "none.json"], limit * MIB))
    assert sentence == (f"error: not enough memory to run {stage}: ulimit -v allows {limit} MiB of address space, but "
                        "must allow at least 4 GiB (ulimit -v unlimited)")


@pytest.mark.parametrize("code", [
    "from sim.backend.runtime import initialize; run(lambda: initialize('f32', 1, 'cpu'))",
    "import numpy; run(lambda: numpy.ones(2**30).sum())",
    "import threading as t; run(lambda: [t.Thread(target=t.Event().wait).start() for _ in range(10**5)])"])
def test_what_a_stage_cannot_get_is_one_sentence(code):
    sentence = told(limited(["-c", f"from pipeline.base.cli import run\n{code}"], 1200 * MIB))
    assert sentence.startswith("error: not enough memory to run ") and "ulimit -v allows 1.17 GiB" in sentence


def test_little_memory_is_not_taken_for_no_opengl():
    """A driver may need more than VTK itself."""
    code = ("from pipeline.base.cli import run\nfrom pipeline.pictures import opengl\n"
            "opengl.PROBE = 'bytearray(2**30)'\nrun(lambda: opengl.main([]))")
    sentence = told(limited(["-c", code], 800 * MIB))
    assert sentence.startswith("error: not enough memory to run ")
    assert " (no OpenGL could be tried): ulimit -v " in sentence


def test_other_errors_keep_their_words():
    assert memory.sentence_of(RuntimeError("the field has another shape"), "render") == ""
    assert memory.sentence_of(OSError(28, "No space left on device"), "render") == ""
    done = limited(["-c", "from pipeline.base.cli import run\nrun(lambda: 1 // 0)"], 1200 * MIB)
    assert done.returncode == 1 and done.stderr.endswith("ZeroDivisionError: integer division or modulo by zero\n")


def test_a_lack_of_memory_behind_another_error_is_found():
    try:
        try:
            raise MemoryError("Unable to allocate 8 GiB for an array")
        except MemoryError as error:
            raise RuntimeError("the picture could not be drawn") from error
    except RuntimeError as error:
        sentence = memory.sentence_of(error, "render")
    assert sentence.startswith("not enough memory to run render (Unable to allocate 8 GiB for an array): ")


@pytest.mark.parametrize(("number", "limit", "words"), [
    (9, "unlimited", "error: not enough memory to run metrics, unless somebody has killed it (signal 9): "),
    (11, "unlimited", "error: metrics crashed (SIGSEGV): "),
    (6, str(2**21), "error: not enough memory to run metrics, a library crashed (SIGABRT): ulimit -v allows 2 GiB"),
    (15, "unlimited", "")])
def test_the_shell_tells_of_a_stage_that_a_signal_has_ended(number, limit, words, tmp_path):
    """As the kernel does where memory is full: the sentence is in the log, from which Snakemake's last words are."""
    victim = tmp_path / "pipeline" / "metrics.py"
    victim.parent.mkdir()
    victim.write_text(f"import os\nos.kill(os.getpid(), {number})\n")
    for room in ("base", "__init__.py"):
        (victim.parent / room).symlink_to(ROOT / "pipeline" / room)
    (tmp_path / "sim").symlink_to(ROOT / "sim")
    done = subprocess.run(
        ["bash", "-c", f"ulimit -c 0; ulimit -v {limit}; OMP_NUM_THREADS=1; {PREFIX} STAGE_USAGE=metrics.json "
                       "python -m pipeline.metrics frames 2>&1 | tee log"],
        cwd=tmp_path, env={"PATH": f"{Path(sys.executable).parent}:/usr/bin:/bin", "PYTHONPATH": str(tmp_path)},
        capture_output=True, text=True)
    assert done.returncode == 128 + number
    sentences = [line for line in (tmp_path / "log").read_text().splitlines() if line.startswith("error: ")]
    assert [sentence.startswith(words) for sentence in sentences] == [True] * bool(words)


def test_a_limit_of_address_space_counts_as_memory():
    code = "from pipeline.base.memory import memory_of_computer; print(memory_of_computer())"
    done = limited(["-c", code], 500 * MIB)
    assert float(done.stdout) == 500 * MIB
