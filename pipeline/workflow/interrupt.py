"""Ctrl-C ends Snakemake in a sentence, without an error for every job that it ends."""
import logging
import signal
import threading
import time
from types import FrameType

PATIENCE = 0.5  # s, that an error waits


class Interrupt:
    """Whether the user has interrupted Snakemake; from then on its errors are not logged.

    Parameters
    ----------
    logger : Snakemake's.
    """

    def __init__(self, logger: logging.Logger):
        self.happened = False
        # Where a signal is ignored, or handled by others already, that stays so.
        if (threading.current_thread() is threading.main_thread()
                and signal.getsignal(signal.SIGINT) is signal.default_int_handler):
            signal.signal(signal.SIGINT, self._handle)
            logger.addFilter(self._is_wanted)

    def _is_wanted(self, record: logging.LogRecord) -> bool:
        """Whether a record is logged: a job that Ctrl-C has ended may be told of before the signal is."""
        if record.levelno < logging.ERROR:
            return True
        end = time.monotonic() + PATIENCE
        while not self.happened and time.monotonic() < end:
            time.sleep(0.02)
        return not self.happened

    def _handle(self, number: int, frame: FrameType | None) -> None:
        self.happened = True
        signal.default_int_handler(number, frame)
