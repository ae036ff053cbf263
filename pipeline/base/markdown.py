"""Pages in Markdown that are written from tables, and the check that they are not older than those."""
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from pipeline.base.files import write_text


def table(head: Sequence[object], body: Sequence[Sequence[object]]) -> str:
    """Return a table; a bar in a cell is escaped."""
    lines = [head, ("---",) * len(head), *body]
    return "\n".join("| " + " | ".join(str(cell).replace("|", "\\|") for cell in line) + " |" for line in lines)


def settle(pages: Mapping[Path, str], check: bool, command: str) -> int:
    """Write pages, or only check that they are as given; return the exit code.

    Parameters
    ----------
    pages : path -> text.
    check : leave the files as they are, and print a sentence on standard error for each that differs.
    command : what writes the pages, for that sentence.
    """
    stale = [path for path, text in pages.items() if not path.is_file() or path.read_text(encoding="utf-8") != text]
    for path in stale:
        if check:
            print(f"error: {path} is older than its tables: {command}", file=sys.stderr)
        else:
            write_text(path, pages[path])
    return int(check and bool(stale))
