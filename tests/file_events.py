"""Processes that wait before each change of a file for permission: kills at counted events.

A process announces every change of a file in a folder on one end of a pair of sockets and waits
for an answer. The process at the other end thus knows its state without a clock.
"""

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

UNFINISHED = "/.writing-"
ROOT = Path(__file__).parents[1]


def pause_before_changes(channel: socket.socket, folder: Path, suffix: str = "") -> None:
    """Make this process wait before it creates, opens for writing, or renames such a file.

    Of files with a suffix only finished ones count, so that each is one change.
    """

    def hook(event: str, arguments: tuple) -> None:
        path = _changed(event, arguments)
        if path and suffix and UNFINISHED in path:
            return
        if path and path.startswith(str(folder)) and path.endswith(suffix):
            channel.send(b".")
            channel.recv(1)

    sys.addaudithook(hook)


def _changed(event: str, arguments: tuple) -> str | None:
    """The path that an audited operation changes, if any."""
    if event == "os.rename":
        return os.fspath(arguments[1])
    if event == "os.mkdir":
        return os.fspath(arguments[0])
    if event == "open" and isinstance(arguments[0], str | Path):
        flags = arguments[2]
        return os.fspath(arguments[0]) if flags & (os.O_WRONLY | os.O_RDWR) else None
    return None


def await_changes(channel: socket.socket, count: int) -> None:
    """Let a process continue until it waits before its n-th change of a file."""
    for number in range(count):
        if number:
            channel.send(b".")
        assert channel.recv(1), f"the process ended after {number} changes of files"


PROGRAM = """
import socket, sys
from pathlib import Path
from tests.file_events import pause_before_changes
pause_before_changes(socket.socket(fileno=int(sys.argv.pop())), Path.cwd(), ".nc")
from knitlab.cli import main
main()
"""


def kill_command(folder: Path, words: Sequence[str], changes: int) -> None:
    """Run ``knitlab`` in a folder, and kill it before a given number of changes of netCDF files."""
    own, other_end = socket.socketpair()
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, *words, str(other_end.fileno())],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])},
        pass_fds=[other_end.fileno()],
        stderr=subprocess.DEVNULL,
    )
    other_end.close()
    with own:
        await_changes(own, changes)
        process.kill()
        process.wait()


def kill_fork(repeated: Callable[[], object], folder: Path, changes: int, *, begun=False) -> None:
    """Repeat a call in a fork, and kill it before its n-th change of a file in a folder.

    With ``begun`` it is killed just after that change has begun.
    """
    own, other_end = socket.socketpair()
    child = os.fork()
    if not child:
        own.close()
        pause_before_changes(other_end, folder)
        while True:  # what is complete only writes its shared files again
            repeated()
    other_end.close()
    with own:
        await_changes(own, changes)
        if begun:
            own.send(b".")
        kill(child)


def kill(pid: int) -> None:
    """Kill a child process, and wait for its end."""
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
