"""How every stage ends: with its result, or with one sentence per error and an exit code."""
import argparse
import errno
import os
import re
import signal
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

from pipeline.base.errors import UserError
from pipeline.base.home import stand_in_for_home
from pipeline.base.memory import FAILED, end_at_once, end_in_sentence, sentence_of
from pipeline.base.usage import write_if_asked
from pipeline.base.words import nearest

FOR_DIGESTS = "no influence"
WRONG_INPUT = 2
INTERRUPTED = 130

_REASONS = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the disk quota is used up",
    errno.EACCES: "permission denied",
    errno.EROFS: "the disk is not writable",
    errno.ENOENT: "no such file or folder",
    errno.EFBIG: "the file is too large for this disk",
    errno.EIO: "the disk has an error",
    errno.EISDIR: "this is a folder, not a file",
    errno.ENOTDIR: "a part of this path is a file, not a folder",
}
# What argparse says of a value that is not among the allowed ones, and of an option that there is not.
_CHOICE = re.compile(r"argument (.+): invalid choice: '(.+)' \(choose from (.+)\)$")
_UNKNOWN = re.compile(r"unrecognized arguments: (-\S+)")
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES)


def mistake(command: str, parser: argparse.ArgumentParser, message: str) -> str:
    """Return what is wrong on a command line, what was probably meant, and where its options are listed.

    Parameters
    ----------
    command : as it is typed. message : what argparse has found.
    """
    meant = ""
    if chosen := _CHOICE.match(message):
        meant = nearest(chosen[2], re.split(r"', '|, ", chosen[3].strip("'")))
    elif unknown := _UNKNOWN.match(message):
        options = (option for action in parser._actions for option in action.option_strings)
        meant = nearest(unknown[1].partition("=")[0], options)
    return f"{command}: {message}{meant}; --help lists what it takes"


class CommandLine(argparse.ArgumentParser):
    """Options and arguments of a command, whose mistakes end in one sentence as all others do."""

    def __init__(self, *, prog: str, **options: Any):
        super().__init__(prog=prog, **options)
        self._command = prog

    def error(self, message: str) -> NoReturn:
        """Raise the error that tells of a mistake; see argparse."""
        raise UserError(mistake(self._command, self, message))


def stage_parser(stage: str, description: str, epilog: str = "") -> CommandLine:
    """Return the command line of `python -m pipeline.<stage>`; its help has the description as it is written."""
    return CommandLine(prog=f"python -m pipeline.{stage}", description=description, epilog=epilog,
                       formatter_class=argparse.RawDescriptionHelpFormatter)


def run(main: Callable[[], int | None]) -> NoReturn:
    """Call ``main`` and exit with its code; errors that a user can meet become sentences on stderr.

    Exit codes: 0 success, 1 the computer failed (disk, memory), 2 wrong input, 130 interrupted. Anything else that
    is raised is a defect of the program and keeps its traceback.
    """
    try:
        if signal.getsignal(signal.SIGINT) is end_at_once:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        stand_in_for_home()
        if sys.stdout is None:  # closed by the caller, who wants no words
            sys.stdout = open(os.devnull, "w")  # noqa: SIM115 until the end of the process
        code = main() or 0
        sys.stdout.flush()
        if code == 0:
            write_if_asked()
    except UserError as error:
        code = _report(WRONG_INPUT, *error.messages)
    except BrokenPipeError:
        sys.stdout = None  # the reader (`head`, a closed pager) has seen enough; nothing is left to flush at exit
        code = FAILED
    except KeyboardInterrupt:
        code = _report(INTERRUPTED, "interrupted")
    except Exception as error:
        if sentence := sentence_of(error, Path(sys.argv[0]).stem):
            end_in_sentence(sentence)
        if not isinstance(error, OSError):
            raise
        code = _report(FAILED, describe(error))
    sys.exit(code)


def _report(code: int, *messages: str) -> int:
    for message in messages:
        print(f"error: {message}", file=sys.stderr)
    return code


def describe(error: OSError) -> str:
    """Return an error of the operating system as a sentence: which file, and what is wrong with it."""
    if error.filename is None:
        return reason(error)
    temporary = Path(str(error.filename)).is_relative_to(tempfile.gettempdir()) and error.errno in _NO_ROOM
    return f"{error.filename}: {reason(error)}" + "; set TMPDIR to a folder with room" * temporary


def reason(error: OSError) -> str:
    """Return what is wrong, without the name of the file."""
    return _REASONS.get(error.errno) or error.strerror or str(error) or type(error).__name__
