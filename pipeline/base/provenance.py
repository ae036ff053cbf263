"""Where, and with which code, a number was made."""
import functools
import os
import subprocess
import tomllib
from importlib.metadata import version
from pathlib import Path

from pipeline.base.project import PROJECT

PYPROJECT = PROJECT / "pyproject.toml"
CHANGED = " and changes"


@functools.cache
def machine() -> str:
    """Return the processor of this computer and the number of its cores."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return f"{names[0] if names else os.uname().machine}, {os.cpu_count()} cores"


def release() -> str:
    """Return the version of this code."""
    if PYPROJECT.is_file():  # of a checkout, whose installed version may be an older one
        return tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))["project"]["version"]
    return version("eye-oil-pipeline")


@functools.cache
def code() -> str:
    """Return the version of this code, and in a checkout its last commit and whether it was changed since."""
    commit = _git("log", "-1", "--format=%h")
    return f"{release()} ({commit}{CHANGED * bool(_git('status', '--porcelain', '-uno'))})" if commit else release()


def commit_before(moment: str) -> str:
    """Return the last commit of this code before a time, ISO 8601; empty without one."""
    return _git("log", "-1", f"--before={moment}", "--format=%h")


def _git(*arguments: str) -> str:
    """What git says of a checkout of this project; nothing of other folders, and where there is no git."""
    if not PYPROJECT.is_file():
        return ""
    try:
        done = subprocess.run(["git", *arguments], cwd=PROJECT, capture_output=True, text=True)
    except FileNotFoundError:
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""
