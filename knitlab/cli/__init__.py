"""The command line: ``knitlab plan | run | status | reproduce | query | map | claims | …``.

In: the arguments of a shell. Out: lines of text, files, and an exit code: 0 if all is well, 1 if a
case is not ok, 2 if the input is invalid.

``options.py`` turns text into values. A command parses, makes one public call, and prints; it
imports no package but ``knitlab.api`` and ``knitlab.io``, which ``lint-imports`` checks.
"""

import os

import click

from knitlab.cli import cubes, laboratory, making, sensing, stability, sweeps
from knitlab.cli.options import CommandGroup

os.environ["MPLBACKEND"] = "agg"  # figures are drawn into files only


@click.group(
    cls=CommandGroup, context_settings={"help_option_names": ["-h", "--help"], "show_default": True}
)
@click.version_option(package_name="knitlab")
def main() -> None:
    """Simulate folding knits and find the one you need."""


for _module in (sweeps, cubes, stability, sensing, making, laboratory):
    for _command in _module.COMMANDS:
        main.add_command(_command)
