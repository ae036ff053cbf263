"""Where a home cannot be written, or an account has no name, as in containers: what libraries want of both."""
import contextlib
import os
import sys
import tempfile
from pathlib import Path

from pipeline.base.errors import UserError


def stand_in_for_home() -> None:
    """Let Snakemake, Taichi and Matplotlib keep their files elsewhere, as ``./run`` does; Taichi crashes otherwise.

    Raises
    ------
    UserError : the other place is somebody else's.
    """
    os.environ.setdefault("USER", str(os.getuid()))
    cache = Path(os.environ.get("XDG_CACHE_HOME") or f"{os.environ.get('HOME', '/nonexistent')}/.cache")
    with contextlib.suppress(OSError):  # whether it can be written is asked next
        cache.mkdir(parents=True, exist_ok=True)
    if os.access(cache, os.W_OK):
        return
    other = Path(tempfile.gettempdir()) / f"eye-oil-pipeline-{os.getuid()}"
    other.mkdir(mode=0o700, exist_ok=True)
    if other.stat().st_uid != os.getuid():
        raise UserError(f"{other}: belongs to another user, and {cache} cannot be written; set XDG_CACHE_HOME to a "
                        "folder of your own")
    os.environ["XDG_CACHE_HOME"] = str(other)
    print(f"{cache} cannot be written: what is kept between runs is in {other}", file=sys.stderr)
