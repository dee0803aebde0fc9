"""Locks of a results folder: one run at a time, or several shards side by side. Needs no JAX.

A run holds ``.lock`` until it ends, a shard a lock of its own. The gate is a lock that is held for
moments: while a run checks which others run, and while a shard writes what all shards share. On a
file system without locks nothing is held, and a shard refuses a folder where another one ran.
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
from knitlab.io.text_file import plain_file

LOCK_NAME = ".lock"
GATE_NAME = ".lock-gate"
SHARD_LOCK = re.compile(r"\.lock-shard-(\d+)-of-(\d+)")
NO_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP}
"""Errors of a file system without locks."""
GATE_SECONDS = 900.0  # longest time to wait for the gate; its holder writes a cube at most


@contextmanager
def held(folder: Path, shard: tuple[int, int] | None = None) -> Iterator[None]:
    """Lock a results folder for a run, or for a shard (number, count) beside the others.

    The lock ends with the process. InputError if another run, the same shard or another split runs,
    or if there are no locks and another shard ran here.
    """
    with gate(folder) as locks:
        if not locks and shard is not None:
            own = _holder_path(folder, _shard_lock(*shard))
            if {*folder.glob(_holder_path(folder, f"{LOCK_NAME}-shard-*").name)} - {own}:
                message = "is on a file system without locks, and another shard ran in it; give"
                raise invalid(str(folder), f"{message} each a folder of its own and merge them")
        if shard is not None:
            with _acquired(folder, LOCK_NAME):
                pass
        for number, count in running_shards(folder):
            if shard is None or count != shard[1]:
                raise _in_use(folder, _shard_lock(number, count))
        lock = _acquired(folder, LOCK_NAME if shard is None else _shard_lock(*shard))
    with lock:
        yield


def gate(folder: Path) -> AbstractContextManager[object]:
    """Exclude the other processes of a results folder for a moment; errors as of a lock."""
    return _acquired(folder, GATE_NAME, GATE_SECONDS)


def running_shards(folder: Path) -> list[tuple[int, int]]:
    """The shards (number, count) that run in a folder."""
    running = []
    for path in sorted(folder.glob(".lock-shard-*")):
        if shard := SHARD_LOCK.fullmatch(path.name):
            try:
                with FileLock(path, blocking=False):
                    pass
            except Timeout:
                running.append((int(shard[1]), int(shard[2])))
            except OSError as error:
                _refuse_unless_without_locks(folder, error)
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


def _shard_lock(number: int, count: int) -> str:
    return f"{LOCK_NAME}-shard-{number}-of-{count}"


def _acquired(folder: Path, name: str, seconds: float = 0.0) -> AbstractContextManager[object]:
    """A lock of a folder within some time [s]; None, as a context, if the file system has none."""
    lock: AbstractContextManager[object] = nullcontext()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = FileLock(folder / name).acquire(timeout=seconds)
    except Timeout:
        raise _in_use(folder, name) from None
    except OSError as error:
        _refuse_unless_without_locks(folder, error)
    shard = SHARD_LOCK.fullmatch(name)
    holder = f"process {os.getpid()} of {getpass.getuser()} on {socket.gethostname()}"
    holder += f" since {datetime.now().isoformat(timespec='seconds')}"
    holder += f" (shard {shard[1]} of {shard[2]})" if shard else ""
    with suppress(OSError):  # the lock works without the file that names its holder
        plain_file(_holder_path(folder, name)).write_text(holder, encoding="utf-8")
    return lock


def _refuse_unless_without_locks(folder: Path, error: OSError) -> None:
    if error.errno not in NO_LOCKS:
        message = f"cannot be written ({error.strerror}); choose another folder"
        raise CannotWrite([Mistake(str(folder), message)]) from error


def _in_use(folder: Path, name: str) -> InputError:
    by = "another process"
    with suppress(OSError, ValueError):
        by = plain_file(_holder_path(folder, name)).read_text(encoding="utf-8") or by
    return invalid(str(folder), f"is held by {by}; wait for it, or name another results folder")


def _holder_path(folder: Path, name: str) -> Path:
    """The file beside a lock that names its holder; a locked file is not readable on Windows."""
    return folder / f"{name}.holder"
