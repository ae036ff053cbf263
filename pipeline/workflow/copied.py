"""A folder that was copied without the dates of its files.

Snakemake runs a job again when a file that it reads is newer than one that it has written. After `cp -r` that is a
matter of chance. Its notes tell the dates that the files had: they are given back, so that nothing is run again.
"""
import os
from pathlib import Path
from typing import Any

from pipeline.workflow.notes import NOTES, notes

PLACE = Path(".snakemake/place")  # which folder the dates are known to be right in
TIMESTAMP = ".snakemake_timestamp"  # what Snakemake takes for the date of a folder


def restore_dates() -> int:
    """Give the files their dates back where this folder is a copy; return how many have got another one."""
    if not NOTES.is_dir():
        return 0
    here = str(NOTES.stat().st_ino)
    if PLACE.is_file() and PLACE.read_text() == here:
        return 0
    restored = sum(_restored(Path(name), note) for name, note in notes())
    PLACE.write_text(here)
    return restored


def _restored(path: Path, note: dict[str, Any]) -> bool:
    """Whether a file has got the date of its note, because its own is later."""
    date = note.get("endtime")
    file = path / TIMESTAMP if (path / TIMESTAMP).is_file() else path
    if not date or not file.exists() or file.stat().st_mtime <= date:
        return False
    os.utime(file, (date, date))
    return True
