"""Ctrl-C ends Snakemake in a sentence, without an error for every job that it ends."""
import logging
import re
import signal
import sys
import threading
import time
from types import FrameType

from pipeline.base.memory import end_at_once, tell_of_imports

PATIENCE = 0.5  # s, that an error waits
PATIENCE_OF_INTERRUPTED = 30.0  # s, that the error of a job waits that the signal itself has ended
INTERRUPTED = re.compile(r"Signals\.SIGINT|exit status 130\b")


class Interrupt:
    """Whether the user has interrupted Snakemake; from then on its errors are not logged.

    Parameters
    ----------
    logger : Snakemake's.
    """

    def __init__(self, logger: logging.Logger):
        self.happened = False
        sys.excepthook = tell_of_imports  # while Snakemake plans, it lets the signal pass
        # Where a signal is ignored, or handled by others already, that stays so.
        if (threading.current_thread() is threading.main_thread()
                and signal.getsignal(signal.SIGINT) in (signal.default_int_handler, end_at_once)):
            signal.signal(signal.SIGINT, self._handle)
            logger.addFilter(self._is_wanted)

    def _is_wanted(self, record: logging.LogRecord) -> bool:
        """Whether a record is logged: a job that Ctrl-C has ended may be told of before the signal is.

        The thread that handles the signal may wait for a slow disk by then; so the job of which the record says that
        it ended by this very signal is told of only if nothing is heard of the signal for long.
        """
        if record.levelno < logging.ERROR:
            return True
        interrupted = INTERRUPTED.search(record.getMessage())
        end = time.monotonic() + (PATIENCE_OF_INTERRUPTED if interrupted else PATIENCE)
        while not self.happened and time.monotonic() < end:
            time.sleep(0.02)
        return not self.happened

    def _handle(self, number: int, frame: FrameType | None) -> None:
        self.happened = True
        signal.default_int_handler(number, frame)
