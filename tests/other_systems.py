"""Rules of other systems, in a process of their own: an audit hook cannot be removed.

Run as a program it does what a user does where modules of POSIX and ``ipctk`` are missing, and
where the system refuses some names, and changes of files that are open, as Windows does.
"""

import builtins
import os
import re
import signal
import sys
from pathlib import Path

ABSENT = {"fcntl", "grp", "pwd", "resource", "termios"}
SIGNALS = ("SIGALRM", "SIGHUP", "setitimer")
REFUSED = re.compile(
    r"""[<>:"|?*\x00-\x1f]|[. ]\Z|\A(con|prn|aux|nul|(com|lpt)\d)(\.|\Z)""", re.IGNORECASE
)


def leave_out_posix():
    """Remove what other systems lack: for knitlab alone, as libraries know where they run."""
    import_module = builtins.__import__

    def imported(name, names=None, *how, **named):
        if name in ABSENT and (names or {}).get("__name__", "").startswith("knitlab"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return import_module(name, names, *how, **named)

    builtins.__import__ = imported
    for module, names in ((os, ("fork",)), (signal, SIGNALS)):
        for name in names:
            delattr(module, name)
    sys.modules["ipctk"] = None


def keep_rules_of_windows(event, arguments):
    """Refuse changes of files as Windows does, on Linux."""
    makes = event == "open" and isinstance(arguments[2], int) and arguments[2] & os.O_CREAT
    if makes or event == "os.mkdir":
        _check_name(arguments[0])
    elif event in ("os.rename", "os.remove"):
        for path in arguments[: 2 if event == "os.rename" else 1]:
            _check_name(path)
            _check_closed(path)


def _check_name(path):
    for part in [] if isinstance(path, int) else Path(os.fsdecode(path)).parts[1:]:
        if REFUSED.search(part):
            raise OSError(22, "Windows refuses this name", str(path))


def _check_closed(path):
    for opened in Path("/proc/self/fd").iterdir():
        if opened.resolve() == Path(os.fsdecode(path)).resolve():
            raise PermissionError(13, "Windows refuses to change an open file", str(path))


def main(results, preview, laboratory):
    """A run, a second one, queries, maps, a mesh and an import, each twice."""
    from knitlab.cli import main as knitlab
    from knitlab.runs.plan import make_plan
    from tests.runs.fake_simulator import ran

    for _ in range(2):
        ran(make_plan("periodic", ("strain_max=0.06", "contact=none")), Path(results, "periodic"))
        for words in (
            ("query", preview, "--columns", "n_stripe,poisson_ratio_min", "--format", "csv"),
            ("map", "auxetic", preview, "-o", f"{results}/auxetic.png"),
            ("import", "markers", laboratory, "--results", results),
            ("plan", "periodic", "--set", "contact=none", "--results", results),
            ("plan", "preview", "--results", results),
        ):
            knitlab(words, standalone_mode=False)
    knitlab(["plan", "periodic"])


if __name__ == "__main__":
    leave_out_posix()
    sys.addaudithook(keep_rules_of_windows)
    main(*sys.argv[1:])
