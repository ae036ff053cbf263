"""Some meshes of known eyes, the same in every run; `python tests/fuzz/fuzz_meshes.py` reads 200 others."""
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.thorough
def test_meshes_give_their_eye_or_a_sentence():
    script = Path(__file__).with_name("fuzz_meshes.py")
    done = subprocess.run([sys.executable, script, "--count", "10", "--seed", "1"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "meshes: 10" in done.stdout and "0 failed" in done.stdout
