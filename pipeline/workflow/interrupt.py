"""Ctrl-C ends Snakemake in a sentence, without an error for every job that it ends."""
import logging
import signal
import threading
from types import FrameType


class Interrupt:
    """Whether the user has interrupted Snakemake; from then on its errors are not logged.

    Parameters
    ----------
    logger : Snakemake's.
    """

    def __init__(self, logger: logging.Logger):
        self.happened = False
        self._logger = logger
        # Where a signal is ignored, or handled by others already, that stays so.
        if (threading.current_thread() is threading.main_thread()
                and signal.getsignal(signal.SIGINT) is signal.default_int_handler):
            signal.signal(signal.SIGINT, self._handle)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        self.happened = True
        self._logger.addFilter(lambda record: record.levelno < logging.ERROR)
        signal.default_int_handler(number, frame)
