"""Calls from a command to a factorisation: ``python -m benchmarks.calls`` in the repository."""

import sys
import tempfile
import traceback
from pathlib import Path
from typing import Any

from click.testing import CliRunner

from knitlab.cli import main
from knitlab.io.shipped import PACKAGE
from knitlab.solvers.equilibrium.system import System

SETTINGS = "n_stripe=4", "n_subunit=16", "strain_max=0.03", "robustness=0"


def calls_to_a_factorisation() -> list[tuple[str, str]]:
    """File and function of every call of knitlab from a run to its first factorisation."""
    found: list[tuple[str, str]] = []
    factorise = System.factorise

    def noting(self: System, *args: Any, **settings: Any) -> bool:
        if not found:
            for frame in traceback.extract_stack()[:-1]:
                path = Path(frame.filename)
                if path.is_relative_to(PACKAGE):
                    found.append((path.relative_to(PACKAGE).as_posix(), frame.name))
        return factorise(self, *args, **settings)

    System.factorise = noting  # type: ignore[method-assign]
    try:
        with tempfile.TemporaryDirectory() as folder:
            settings = [word for setting in SETTINGS for word in ("--set", setting)]
            command = ["run", "periodic", *settings, "--workers", "0", "--results", folder]
            CliRunner().invoke(main, command, catch_exceptions=False)
    finally:
        System.factorise = factorise  # type: ignore[method-assign]
    return found


if __name__ == "__main__":
    calls = calls_to_a_factorisation()
    for file, function in calls:
        print(f"{file:45} {function}")
    files = len({file for file, _ in calls})
    print(f"{len(calls)} calls in {files} files")
    sys.exit(0 if calls else 1)
