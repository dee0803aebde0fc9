"""Interruption: signals that end a process are handled like Ctrl-C."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

ENDING = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)
"""Ctrl-C; what a batch system or ``kill`` sends; and, where it exists, a closed terminal."""


@contextmanager
def interrupted_by_signals() -> Iterator[None]:
    """Raise KeyboardInterrupt on any signal that asks a process to end.

    A signal that is ignored stays ignored, such as Ctrl-C in a shell's background or a closed
    terminal under ``nohup``. Outside the main thread this does nothing, as Python installs signal
    handlers only there.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {
        number: signal.signal(number, signal.default_int_handler)
        for number in ENDING
        if signal.getsignal(number) is not signal.SIG_IGN
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
