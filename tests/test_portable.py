"""The package imports where the system is not Linux."""

import subprocess
import sys

import pytest

SCRIPT = """
import importlib, os, pkgutil, signal, sys

import knitlab

def import_all():
    for module in pkgutil.walk_packages(knitlab.__path__, "knitlab."):
        importlib.import_module(module.name)

# First as here, so that other libraries have found what they use of this system.
import_all()
for name in [name for name in sys.modules if name.partition(".")[0] == "knitlab"]:
    del sys.modules[name]
for name in ("fcntl", "grp", "pwd", "resource", "syslog", "termios"):
    sys.modules[name] = None
for module, names in {
    os: ("fork", "getuid", "geteuid", "sched_getaffinity", "sysconf", "setsid", "killpg"),
    signal: ("SIGALRM", "SIGHUP", "SIGKILL", "SIGUSR1", "SIGUSR2", "alarm", "setitimer"),
}.items():
    for name in names:
        delattr(module, name)
import knitlab
import_all()
from knitlab.model.threads import allowed_threads
assert allowed_threads() >= 1
"""


@pytest.mark.slow
def test_every_module_is_imported_without_features_of_linux():
    command = [sys.executable, "-W", "ignore", "-c", SCRIPT]
    imported = subprocess.run(command, capture_output=True, text=True, check=False)
    assert imported.returncode == 0, imported.stderr
