"""Progress of a stage: a bar with the time left in a terminal, plain lines in a log file."""
import contextlib
import sys
import time
from collections.abc import Iterator

from tqdm import tqdm

FOR_DIGESTS = "no influence"
SECONDS_BETWEEN_LINES = 10.0


class PlainProgress:
    """Progress as lines for a log: at most one every few seconds, and always the last."""

    def __init__(self, total: float, label: str, *, unit: str = "frame", stream=None,
                 interval: float = SECONDS_BETWEEN_LINES):
        self.total, self.label, self.unit = total, label, unit
        self.done = 0.0
        self._note = ""
        self._stream = stream if stream is not None else sys.stderr
        self._interval = interval
        self._start = self._last = time.monotonic()

    def update(self, count: float = 1) -> None:
        """Count ``count`` more units as done; parts of a unit are allowed."""
        self.done += count
        now = time.monotonic()
        if now - self._last >= self._interval or self.done >= self.total:
            self._last = now
            self._write(now - self._start)

    def set_postfix_str(self, note: str) -> None:
        """Show ``note`` (residual, time step ...) at the end of the next line."""
        self._note = note

    def _write(self, elapsed: float) -> None:
        left = elapsed / self.done * max(self.total - self.done, 0.0) if self.done else float("nan")
        note = f", {self._note}" if self._note else ""
        self._stream.write(f"{self.label}: {self.done:.4g}/{self.total:.4g} {self.unit}s, "
                           f"{elapsed:.0f} s, {left:.0f} s left{note}\n")
        self._stream.flush()


@contextlib.contextmanager
def progress(total: float, label: str, *, unit: str = "frame") -> Iterator[PlainProgress | tqdm]:
    """Open a progress display for ``total`` units of work on standard error.

    Examples
    --------
    >>> with progress(3, "simulate", unit="frame") as bar:
    ...     bar.update(1)
    ...     bar.set_postfix_str("dt 0.5 ms")
    """
    if sys.stderr.isatty():
        with tqdm(total=total, desc=label, unit=unit, dynamic_ncols=True) as bar:
            yield bar
    else:
        yield PlainProgress(total, label, unit=unit)
