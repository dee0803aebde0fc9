"""The command line: ``knitlab plan | run | status | reproduce | query | map | claims | …``."""

import click

from knitlab.cli import cubes, laboratory, making, sweeps
from knitlab.cli.options import CommandGroup


@click.group(
    cls=CommandGroup, context_settings={"help_option_names": ["-h", "--help"], "show_default": True}
)
@click.version_option(package_name="knitlab")
def main() -> None:
    """Simulate folding knits and find the one you need."""


for _module in (sweeps, cubes, making, laboratory):
    for _command in _module.COMMANDS:
        main.add_command(_command)
