"""This computer and its software, in words."""
import os
import platform
import subprocess
import sys
from pathlib import Path

from pipeline.base.memory import in_words, memory_of_computer
from sim.cores import available_cores


def processor() -> str:
    """Return the name of the processor, as far as the system tells it."""
    if sys.platform == "darwin":
        told = subprocess.run(["sysctl", "-n", "machdep.cpu.brand_string"], capture_output=True, text=True, check=False)
        return told.stdout.strip() or platform.machine()
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.is_file() else []
    model = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "")
    return model or platform.processor() or platform.machine()


def computer() -> str:
    """Return the processor, its cores, the memory and the system of this computer."""
    return (f"{processor()}, {available_cores()} of {os.cpu_count()} cores, {in_words(memory_of_computer())}, "
            f"{platform.system()} {platform.machine()}")
