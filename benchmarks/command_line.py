"""The command line as processes of their own, and the processor time that they use."""

import resource
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

COMMAND = (sys.executable, "-c", "from knitlab.cli import main; main()")


def processor_seconds() -> float:
    """Processor time of all processes that this one has waited for, user and system [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def results_in(name: str) -> Callable[..., Any]:
    """The option ``--results``, by default a folder of this name among the kept results."""
    return click.option(
        "--results",
        type=click.Path(path_type=Path),
        default=Path("results/reference", name),
        show_default=True,
        help="Folder of the cube.",
    )
