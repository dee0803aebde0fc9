"""Locks of a results folder: one run at a time, or several shards side by side. Needs no JAX.

A run holds a lock until it ends, as does each shard of a plan. The brief lock is held while a run
checks which others run, and while a shard writes what all share. On a file system without locks
nothing is held, and a shard refuses a folder where another one ran.
"""

import errno
import getpass
import os
import re
import socket
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from datetime import datetime
from pathlib import Path

from filelock import FileLock, Timeout

from knitlab.io.errors import CannotWrite, InputError, Mistake, invalid

SHARD_LOCK = re.compile(r"\.lock-(\d+)-of-(\d+)")
NO_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP}
"""Errors of a file system without locks."""
BRIEF_SECONDS = 900.0  # longest time to wait for the brief lock, whose holder may write a cube
Shard = tuple[int, int]  # number, from 1 on, and count


@contextmanager
def locked(folder: Path, shard: Shard = (1, 1)) -> Iterator[None]:
    """Lock a results folder for a run, or for a shard beside others; InputError if it is in use."""
    path = folder / ".lock-{}-of-{}".format(*shard)
    with brief_lock(folder) as locks:
        others = {*folder.glob(".lock-*.holder")} - {_holder_file(path)}
        if not locks and shard[1] > 1 and others:
            message = "is on a file system without locks, and another shard ran in it; give"
            raise invalid(str(folder), f"{message} each a folder of its own and merge them")
        for other in running_shards(folder):
            if other[1] != shard[1]:
                raise _in_use(folder / ".lock-{}-of-{}".format(*other))
        lock = _acquired(path)
        holder = f"process {os.getpid()} of {_user()} on {socket.gethostname()}"
        holder += f" since {datetime.now().isoformat(timespec='seconds')}"
        holder += " (shard {} of {})".format(*shard) if shard[1] > 1 else ""
        with suppress(OSError):  # the lock works without the file that names its holder
            _holder_file(path).write_text(holder, encoding="utf-8")
    with lock:
        yield


def brief_lock(folder: Path) -> AbstractContextManager[object]:
    """Exclude the other processes of a results folder for a moment."""
    return _acquired(folder / ".lock-brief", BRIEF_SECONDS)


def running_shards(folder: Path) -> list[Shard]:
    """The shards that run in a folder."""
    running = []
    for path in sorted(folder.glob(".lock-*")):
        if shard := SHARD_LOCK.fullmatch(path.name):
            try:
                with _acquired(path):
                    pass
            except CannotWrite:
                raise
            except InputError:
                running.append((int(shard[1]), int(shard[2])))
    return running


def is_locked(path: Path) -> bool:
    """Whether another program holds a lock of a file, as HDF5 does while it writes."""
    try:
        import fcntl
    except ImportError:  # on Windows a locked file cannot be read
        return False
    with path.open("rb") as file, suppress(OSError):
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False


def _acquired(path: Path, seconds: float = 0.0) -> AbstractContextManager[object]:
    """A lock, acquired within some time [s]; None, as a context, if the file system has none."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        return FileLock(path).acquire(timeout=seconds)
    except Timeout:
        raise _in_use(path) from None
    except OSError as error:
        if error.errno in NO_LOCKS:
            return nullcontext()
        message = f"cannot be written ({error.strerror}); choose another folder"
        raise CannotWrite([Mistake(str(path.parent), message)]) from error


def _user() -> str:
    """The name of the user, or the number of one without a name, as in a container."""
    try:
        return getpass.getuser()
    except (KeyError, OSError, ImportError):
        return f"user {os.getuid()}" if hasattr(os, "getuid") else "another user"


def _in_use(path: Path) -> InputError:
    holder = "another process"
    with suppress(OSError, ValueError):
        holder = _holder_file(path).read_text(encoding="utf-8") or holder
    message = f"is held by {holder}; wait for it, or name another results folder"
    return invalid(str(path.parent), message)


def _holder_file(path: Path) -> Path:
    # A locked file itself is not readable on Windows.
    return path.with_name(f"{path.name}.holder")
