"""A simulation asks nothing of the network: Taichi would look for a newer version of itself at every start."""
import os
import subprocess
import sys

import pytest
from conftest import ROOT

from sim.backend.choice import library

ASKED = """
import socket, sys, threading

def ask(host, *rest, **more):
    print("asked", host, file=sys.stderr)
    raise OSError("no network")

socket.getaddrinfo = ask
from sim.backend.runtime import initialize
initialize("f32", 1, "cpu")
for thread in threading.enumerate():
    if thread is not threading.current_thread():
        thread.join(60)
print("started")
"""


@pytest.mark.thorough
def test_nothing_is_asked_of_the_network(tmp_path):
    home = {"HOME": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path)}  # with no note that it has asked today
    kept = {name: value for name, value in os.environ.items() if name != library().variable("skip_version_check")}
    done = subprocess.run([sys.executable, "-c", ASKED], cwd=ROOT, env=kept | home, capture_output=True, text=True)
    assert (done.returncode, done.stdout.split()[-1]) == (0, "started"), done.stderr
    assert "asked" not in done.stderr
