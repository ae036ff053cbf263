"""A copy of the project that may be spoiled, and what a run in it has made."""
import contextlib
import hashlib
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LINKED, COPIED = ("pipeline", "sim", "studies", "docs"), ("config", "profiles", "rules", "Snakefile")
SCENE = "tiny"
# What tells times of this computer, or its own path; everything else is the same in every run.
WITH_CLOCKS = ("costs", "logs", "estimate.html", "estimate.json", "cost.html", "effects.html", "effects.csv",
               "index.html", "view_run.py")


class Copy:
    """A copy of the project in a folder, with outputs of its own; the code is linked, its runs have some cores."""

    def __init__(self, folder: Path, cores: int = 2):
        self.folder, self.cores = folder, cores
        folder.mkdir(parents=True, exist_ok=True)
        for name in LINKED:
            if not (folder / name).exists():
                (folder / name).symlink_to(ROOT / name)
        for name in COPIED:
            if not (folder / name).exists():
                (shutil.copytree if (ROOT / name).is_dir() else shutil.copy)(ROOT / name, folder / name)

    @property
    def outputs(self) -> Path:
        """Folder of the results of the scene."""
        return self.folder / "outputs" / SCENE / "draft"

    def start(self, *arguments: str, cores: int | None = None, log: str = "snakemake.log", **environment: str):
        """Start Snakemake in a group of processes of its own."""
        command = [sys.executable, "-m", "snakemake", f"-j{cores or self.cores}", *(arguments or ("all",)), "--config",
                   f"scenes=[{SCENE}]"]
        with (self.folder / log).open("w") as file:
            return subprocess.Popen(command, cwd=self.folder, stdin=subprocess.DEVNULL, stdout=file,
                                    stderr=subprocess.STDOUT, start_new_session=True,
                                    env=os.environ | {"PYTHONPATH": str(self.folder)} | environment)

    def run(self, *arguments: str, cores: int | None = None, **environment: str) -> tuple[int, str]:
        """Run Snakemake to its end; return its exit code and all that it printed."""
        code = self.start(*arguments, cores=cores, **environment).wait()
        return code, (self.folder / "snakemake.log").read_text(errors="replace")

    def processes(self, *words: str) -> list[int]:
        """Return the processes of Python in the folder whose command line holds all words."""
        found = []
        for entry in filter(str.isdigit, os.listdir("/proc")):
            try:
                line = Path(f"/proc/{entry}/cmdline").read_bytes().decode(errors="replace").split("\0")
                inside = Path(os.readlink(f"/proc/{entry}/cwd")) == self.folder
            except OSError:  # it has ended in the meantime
                continue
            if inside and "python" in line[0] and all(word in line for word in words):
                found.append(int(entry))
        return found

    def kill_all(self) -> None:
        """Kill whatever runs in the folder."""
        for process in self.processes():
            with contextlib.suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)

    def checksums(self) -> dict[str, str]:
        """Return the SHA-256 of every result without clocks, by its path in the folder of the scene."""
        return {str(path.relative_to(self.outputs)): hashlib.sha256(path.read_bytes()).hexdigest()
                for path in sorted(self.outputs.rglob("*")) if path.is_file() and not path.name.startswith(".")
                and path.relative_to(self.outputs).parts[0] not in WITH_CLOCKS}


def differences(one: dict[str, str], other: dict[str, str]) -> list[str]:
    """Return the paths that two runs have not in common, or with other content."""
    return sorted(path for path in one.keys() | other.keys() if one.get(path) != other.get(path))
