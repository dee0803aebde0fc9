"""The command line: ``knitlab plan | run | status | reproduce | query | map | claims | …``.

In: words of a shell. Out: lines of text, files, and an exit code: 0 if all is well, 1 if a case is
not ok, 2 if the input was wrong.

Read ``options.py`` (text becomes values there, and nowhere else), then the file of a command:
``sweeps.py``, ``cubes.py``, ``stability.py``, ``sensing.py``, ``making.py`` or ``laboratory.py``. A
command calls one function of ``knitlab.api`` or of the core, and prints.
"""

import os

import click

from knitlab.cli import cubes, laboratory, making, sensing, stability, sweeps
from knitlab.cli.options import CommandGroup

os.environ["MPLBACKEND"] = "agg"  # it draws into files alone, whatever a user's programs show


@click.group(
    cls=CommandGroup, context_settings={"help_option_names": ["-h", "--help"], "show_default": True}
)
@click.version_option(package_name="knitlab")
def main() -> None:
    """Simulate folding knits and find the one you need."""


for _module in (sweeps, cubes, stability, sensing, making, laboratory):
    for _command in _module.COMMANDS:
        main.add_command(_command)
