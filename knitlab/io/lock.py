"""The lock of a results folder: one run at a time, and whose it is. Needs no JAX."""

import fcntl
import getpass
import json
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path

from knitlab.io.errors import CannotWrite, Fault, fault

LOCK_NAME = ".lock"


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Hold a results folder; the lock goes when the process does, however it ends.

    Raises:
        BadInput: if another process holds it, naming which.
        CannotWrite: if the folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = (folder / LOCK_NAME).open("a+")
    except OSError as error:
        problem = f"cannot be written ({error.strerror}); choose another folder"
        raise CannotWrite([Fault(str(folder), problem)]) from error
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise fault(
                str(folder),
                f"is held by {_holder(folder)}; wait for it, or name another --results",
            ) from None
        lock.truncate(0)
        lock.write(
            json.dumps(
                {
                    "process": os.getpid(),
                    "user": getpass.getuser(),
                    "host": socket.gethostname(),
                    "since": datetime.now().isoformat(timespec="seconds"),
                }
            )
        )
        lock.flush()
        yield


def _holder(folder: Path) -> str:
    try:
        holder = json.loads((folder / LOCK_NAME).read_text())
        return "process {process} of {user} on {host} since {since}".format(**holder)
    except (OSError, ValueError, KeyError):
        return "another process"
