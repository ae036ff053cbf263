"""Some spoiled scenes and studies, the same in every run; `python tests/fuzz/fuzz_scenes.py` reads 5,000 others."""
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.thorough
def test_spoiled_scenes_are_sentences_or_survive():
    """In a process of its own: it watches what Python does, and how much memory it takes."""
    script = Path(__file__).with_name("fuzz_scenes.py")
    done = subprocess.run([sys.executable, script, "--examples", "30", "--seed", "1"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "files: 30" in done.stdout and "scene accepted" in done.stdout and "scene refused" in done.stdout
