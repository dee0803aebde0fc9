"""Ctrl-C while the command line is imported ends it with one line, as imports may lose the error.

A program of a user that imports knitlab gets its KeyboardInterrupt as ever.
"""

import os
import signal
import sys
from types import FrameType

INTERRUPTED = 128 + signal.SIGINT  # exit code, as a shell reports it


def end_at_once(number: int, frame: FrameType | None) -> None:
    """End the process; nothing has begun that would have to be cleared up."""
    try:
        os.write(2, b"Interrupted.\n")
    finally:
        os._exit(INTERRUPTED)


_words = sys.orig_argv[1:3]
_names = [os.path.basename(word).partition(".")[0] for word in _words[:1]]  # noqa: PTH119
is_command = _words == ["-m", "knitlab"] or _names == ["knitlab"]
if is_command and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, end_at_once)
