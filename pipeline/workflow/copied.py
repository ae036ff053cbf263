"""A folder that was copied without the dates of its files.

Snakemake runs a job again when a file that it reads is newer than one that it has written. After `cp -r` that is a
matter of chance. Its notes tell the dates that the files had: they are given back, so that nothing is run again.
"""
import base64
import binascii
import json
import os
from pathlib import Path

NOTES = Path(".snakemake/metadata")
PLACE = Path(".snakemake/place")  # which folder the dates are known to be right in
TIMESTAMP = ".snakemake_timestamp"  # what Snakemake takes for the date of a folder


def restore_dates() -> int:
    """Give the files their dates back where this folder is a copy; return how many have got another one."""
    if not NOTES.is_dir():
        return 0
    here = str(NOTES.stat().st_ino)
    if PLACE.is_file() and PLACE.read_text() == here:
        return 0
    restored = sum(_restored(note) for note in NOTES.rglob("*") if note.is_file())
    PLACE.write_text(here)
    return restored


def _restored(note: Path) -> bool:
    """Whether a file has got the date of its note, because its own is later."""
    try:
        name = "".join(part.removeprefix("@") for part in note.relative_to(NOTES).parts)
        path = Path(os.fsdecode(base64.urlsafe_b64decode(name)))
        date = float(json.loads(note.read_text(encoding="utf-8"))["endtime"])
    except (binascii.Error, ValueError, KeyError, TypeError):
        return False  # no note that this version of Snakemake would read
    file = path / TIMESTAMP if (path / TIMESTAMP).is_file() else path
    if not file.exists() or file.stat().st_mtime <= date:
        return False
    os.utime(file, (date, date))
    return True
