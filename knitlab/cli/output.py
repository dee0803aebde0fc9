"""Output that may be closed: text that cannot be written is dropped, and the work goes on."""

import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from knitlab.io.names import CONTROLS


class Droppable:
    """A text stream that drops what cannot be written, if a pipe is closed or a disk is full.

    Control characters are escaped as in Python.
    """

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write text, or drop it."""
        try:
            self._stream.write(text.translate(CONTROLS))
            self._stream.flush()
        except (OSError, ValueError):
            # Drop what is buffered, and what other processes write here from now on.
            with suppress(OSError, ValueError):
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, self._stream.fileno())
                os.close(nowhere)
        return len(text)

    def flush(self) -> None:
        """Do nothing: text is written at once."""


@contextmanager
def droppable_output() -> Iterator[None]:
    """Standard output and error that may be closed, even from the start (``2>&-``)."""
    streams = sys.stdout, sys.stderr
    for stream, descriptor in zip(streams, (1, 2), strict=True):
        if stream is None:
            # Otherwise the next file that is opened would take its descriptor.
            with suppress(OSError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), descriptor)
    for stream in streams:
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # for what its encoding lacks
    sys.stdout, sys.stderr = (
        Droppable(open(os.devnull, "w", encoding="utf-8") if stream is None else stream)  # noqa: PTH123, SIM115
        for stream in streams
    )
    try:
        yield
    finally:
        sys.stdout, sys.stderr = streams
