"""Output that may be closed: text that cannot be written is dropped, and the work goes on."""

import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any


class Droppable:
    """A text stream that drops what cannot be written, if a pipe is closed or a disk is full."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write text, or drop it."""
        try:
            self._stream.write(text)
            self._stream.flush()
        except (OSError, ValueError):
            # Python would try again, at its end, to write what is buffered.
            with suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), self._stream.fileno())
        return len(text)

    def flush(self) -> None:
        """Do nothing: text is written at once."""


@contextmanager
def droppable_output() -> Iterator[None]:
    """Standard output and error that may be closed while a command runs."""
    streams = sys.stdout, sys.stderr
    for stream in streams:
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # for what its encoding lacks
    sys.stdout, sys.stderr = (stream and Droppable(stream) for stream in streams)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = streams
