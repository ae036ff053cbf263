"""Ctrl-C while the thread that hears of it waits: the job that the signal ended is not told of as an error."""
import signal
import subprocess
import sys
import time

import pytest
from conftest import ROOT, hear_interrupts

# A thread logs the end of its job at once, as Snakemake's do; the signal reaches the main thread a second later.
LATE = """
import logging, os, signal, threading, time
from pipeline.workflow.interrupt import Interrupt
signal.signal(signal.SIGINT, signal.default_int_handler)  # in the background of a shell it may be ignored
logger = logging.getLogger("snakemake")
logger.addHandler(logging.StreamHandler())
interrupt = Interrupt(logger)
signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
job = threading.Thread(target=logger.error, args=["CalledProcessError: '...' {how}"])
job.start()
time.sleep(1.0)
try:
    if {interrupted}:
        os.kill(os.getpid(), signal.SIGINT)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
        time.sleep(10)
except KeyboardInterrupt:
    pass
job.join()
print(interrupt.happened)
"""


@pytest.mark.parametrize(("how", "interrupted", "told"), [
    ("died with <Signals.SIGINT: 2>.", True, False),
    ("returned non-zero exit status 130.", True, False),
    ("returned non-zero exit status 1.", False, True),
])
def test_error_waits_for_the_signal_that_it_tells_of(how, interrupted, told):
    run = subprocess.run([sys.executable, "-c", LATE.format(how=how, interrupted=interrupted)], cwd=ROOT,
                         capture_output=True, text=True, check=True)
    assert run.stdout.split() == [str(interrupted)]
    assert (how in run.stderr) == told


# As `python -m` starts a module, but that it says when Python itself, which nobody can speak for, has started.
STARTED = """
import runpy, sys
name, sys.argv = sys.argv[1], ["-m", *sys.argv[2:]]
import pipeline
print("started", flush=True)
runpy.run_module(name, run_name="__main__", alter_sys=True)
"""


@pytest.mark.parametrize("command", [("pipeline.workflow.start", "-n", "-q", "all", "-j1"), ("pipeline.eye", "--help")])
@pytest.mark.parametrize("seconds", [0.0, 0.3, 0.8, 1.5, 3.0])
def test_ctrl_c_ends_in_one_sentence_at_any_moment(command, seconds):
    """Also while libraries are imported and jobs are planned; what has ended before says nothing of it."""
    run = subprocess.Popen([sys.executable, "-c", STARTED, *command], cwd=ROOT, stdout=subprocess.PIPE,
                           stderr=subprocess.PIPE, text=True, preexec_fn=hear_interrupts)
    assert run.stdout.readline() == "started\n"
    time.sleep(seconds)
    if run.poll() is None:
        run.send_signal(signal.SIGINT)
    said = run.communicate(timeout=120)[1].splitlines()
    assert not any(line.startswith("  File") for line in said), said
    assert sum("interrupted" in line for line in said) == 1 or run.returncode == 0
