"""Loops that are not unrolled: less to compile, the same sums, and nothing asked of other libraries."""
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sim.backend.choice import library
from sim.backend.private import core
from sim.backend.unrolling import addresses

ROOT = Path(__file__).parents[3]
CACHE = library().variable("offline_cache_file_path")
PROGRAM = """
import sys
from sim.backend import ti, unrolling
if sys.argv[1] == "rolled":
    assert unrolling.leave_loops_rolled()
    assert unrolling.leave_loops_rolled()  # a second call asks nothing of LLVM
if sys.argv[1] == "unrolled":
    unrolling.OPTIONS = (b"-unroll-count=16",)
    assert unrolling.leave_loops_rolled()
ti.init(ti.cpu, default_fp=ti.f64, cpu_max_num_threads=1, offline_cache=True, log_level=ti.ERROR)
rows, values, sums = ti.field(ti.i32, 100), ti.field(ti.f64, 4000), ti.field(ti.f64, 100)
@ti.kernel
def add():
    for k in values:
        values[k] = 1.0 / (k + 1.0)
    for i in rows:
        rows[i] = i % 37
        total = 0.0
        for s in range(rows[i]):
            total += ti.sin(values[40 * i + s]) * values[s]
        sums[i] = total
add()
print(sums.to_numpy().tobytes().hex())
"""


def compiled(folder: Path, how: str) -> tuple[np.ndarray, int]:
    """Sums of rows in a process of its own, and the bytes of its compiled kernels."""
    folder.mkdir()
    program = folder / "program.py"
    program.write_text(PROGRAM)  # where the source of a kernel is read from
    done = subprocess.run(
        [sys.executable, str(program), how], cwd=ROOT, check=True, capture_output=True, text=True,
        env=os.environ | {CACHE: str(folder / "cache"), "PYTHONPATH": str(ROOT)})
    size = sum(file.stat().st_size for file in folder.rglob("*.tic"))
    return np.frombuffer(bytes.fromhex(done.stdout.splitlines()[-1])), size


@pytest.mark.thorough
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="libraries of other systems have another format")
def test_loops_that_stay_rolled_are_less_to_compile_and_give_the_same_sums(tmp_path):
    rolled, small = compiled(tmp_path / "rolled", "rolled")
    as_it_is, usual = compiled(tmp_path / "as it is", "as it is")
    unrolled, large = compiled(tmp_path / "unrolled", "unrolled")
    for sums in (as_it_is, unrolled):
        np.testing.assert_allclose(rolled, sums, rtol=1e-13)  # of up to 36 numbers, in any order
    assert np.count_nonzero(rolled) > 90
    # On some processors LLVM makes copies by itself, on others vectors only; told to, on any. 0.4 was measured.
    assert small < usual
    assert small < 0.6 * large


@pytest.mark.thorough
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="libraries of other systems have another format")
def test_kernels_of_other_options_are_compiled_anew(tmp_path):
    """Else who takes a new version runs on with the kernels of the old one, to the last digit."""
    program = ("import sys\nfrom sim.backend import runtime, unrolling\n"
               "unrolling.OPTIONS = unrolling.OPTIONS[:int(sys.argv[1])]\n"
               "from sim.backend.private import current_config\n"
               "runtime.initialize('f32', 1)\nprint(current_config().offline_cache_file_path)\n"
               "runtime.restart()\nprint(current_config().offline_cache_file_path)")
    kept = {name: value for name, value in os.environ.items() if name != CACHE}

    def folders(options: int, **more: str) -> list[str]:
        return subprocess.run([sys.executable, "-c", program, str(options)], cwd=ROOT, check=True, capture_output=True,
                              text=True, env=kept | {"XDG_CACHE_HOME": str(tmp_path)} | more).stdout.split()[-2:]

    fewer, all_of_them = folders(1), folders(3)
    assert fewer[0] != all_of_them[0] and all(Path(one).is_relative_to(tmp_path) for one in fewer + all_of_them)
    assert (fewer[1], all_of_them[1]) == (fewer[0], all_of_them[0])
    assert folders(3, **{CACHE: str(tmp_path / "mine")}) == [str(tmp_path / "mine")] * 2


@pytest.mark.parametrize("content", [b"MZ no library of Linux", b"\x7fELF\x02\x01" + bytes(100)])
def test_a_library_that_does_not_tell_its_functions_is_left_alone(tmp_path, content):
    library = tmp_path / "library.so"
    library.write_bytes(content)
    assert addresses(library, b"LLVMParseCommandLineOptions") is None


def test_a_function_that_is_not_there_has_no_address():
    assert addresses(core(), b"LLVMNoSuchFunction") is None
