"""Where, and with which code, a number was made."""
import functools
import os
import subprocess
import tomllib
from importlib.metadata import PackageNotFoundError, version

from pipeline.base.computer import processor
from pipeline.base.project import PROJECT, SNAKEFILE

NAME = "eye-oil-pipeline"
CODE = ("pipeline", "sim", "studies", "rules", SNAKEFILE)  # of the project: what results come from


@functools.cache
def machine() -> str:
    """Return the processor of this computer and the number of its cores."""
    return f"{processor()}, {os.cpu_count()} cores"


def release() -> str:
    """Return the version of this code; of a checkout the one that it says, for the installed one may be older."""
    project = PROJECT / "pyproject.toml"
    if project.is_file():
        return tomllib.loads(project.read_text(encoding="utf-8"))["project"]["version"]
    try:
        return version(NAME)
    except PackageNotFoundError:
        return "0"


@functools.cache
def commit() -> str:
    """Return the last commit of this code; empty where it is no checkout."""
    return _git("rev-parse", "--short", "HEAD")


@functools.cache
def changed() -> bool:
    """Tell whether the code of a checkout was changed since its last commit."""
    return bool(_git("status", "--porcelain", "--untracked-files=no", "--", *CODE))


def code() -> str:
    """Return the version of this code, and in a checkout its last commit and whether it was changed since."""
    return f"{release()} ({commit()}{' and changes' * changed()})" if commit() else release()


def commit_before(moment: str) -> str:
    """Return the last commit of this code before a time, ISO 8601; empty without one."""
    return _git("log", "-1", f"--before={moment}", "--format=%h")


def _git(*arguments: str) -> str:
    """What Git says of the project; nothing where it is no checkout of its own, or there is no Git."""
    if not (PROJECT / ".git").exists():
        return ""
    try:
        done = subprocess.run(["git", "-C", PROJECT, *arguments], capture_output=True, text=True, check=False)
    except OSError:
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""
