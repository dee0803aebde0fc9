"""The lock of a results folder, which allows one run at a time. Needs no JAX."""

import getpass
import json
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path

from filelock import FileLock, Timeout

from knitlab.io.errors import CannotWrite, Fault, fault

LOCK_NAME = ".lock"
HOLDER_NAME = ".lock.json"
"""Separate from the lock, because a locked file cannot be read on Windows."""


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Lock a results folder; the lock is released when the process ends, however it ends.

    Raises:
        BadInput: if another process holds the lock; the message names it.
        CannotWrite: if the folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = FileLock(folder / LOCK_NAME, blocking=False).acquire()
    except Timeout:
        problem = f"is held by {_holder(folder)}; wait for it, or name another results folder"
        raise fault(str(folder), problem) from None
    except OSError as error:
        problem = f"cannot be written ({error.strerror}); choose another folder"
        raise CannotWrite([Fault(str(folder), problem)]) from error
    with lock:
        _name_holder(folder)
        yield


def _name_holder(folder: Path) -> None:
    holder = {
        "process": os.getpid(),
        "user": getpass.getuser(),
        "host": socket.gethostname(),
        "since": datetime.now().isoformat(timespec="seconds"),
    }
    # The lock works without the file that names its holder.
    with suppress(OSError):
        (folder / HOLDER_NAME).write_text(json.dumps(holder))


def _holder(folder: Path) -> str:
    try:
        holder = json.loads((folder / HOLDER_NAME).read_text())
        return "process {process} of {user} on {host} since {since}".format(**holder)
    except (OSError, ValueError, KeyError):
        return "another process"
