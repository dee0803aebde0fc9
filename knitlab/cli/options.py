"""What commands share: options, exit codes, and messages of bad input."""

import sys
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any

import click

from knitlab.io.errors import BadInput, fault

BAD_INPUT = 2
SOME_CASE_NOT_OK = 1
MOST_LINES = 20
"""Cases that a command lists at most."""

Command = Callable[..., None]


def explains_bad_input(command: Command) -> Command:
    """Turn bad input into its message and exit code 2."""

    @wraps(command)
    def explained(*arguments: Any, **options: Any) -> None:
        try:
            command(*arguments, **options)
        except BadInput as error:
            for fault in error.faults:
                click.echo(f"knitlab: {_with_options(str(fault))}", err=True)
            sys.exit(BAD_INPUT)

    return explained


def check_toml(output: Path) -> None:
    """Refuse a file for stripes that is no TOML file.

    Raises:
        BadInput: if its suffix is another one.
    """
    if output.suffix != ".toml":
        raise fault(f"output {output}", "has no suffix .toml; give it one")


def _with_options(message: str) -> str:
    """A fault of a Python argument as one of the option that gives it."""
    argument, space, rest = message.partition(" ")
    for parameter in click.get_current_context().command.params:
        if parameter.name == argument.removesuffix(":") and isinstance(parameter, click.Option):
            colon = ":" if argument.endswith(":") else ""
            return f"{parameter.opts[-1]}{colon}{space}{rest}"
    return message


results_option = click.option(
    "--results",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("results"),
    show_default=True,
    help="Folder that holds a folder of results for each workflow.",
)


set_option = click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=VALUE",
    help="Override a setting of the workflow; a comma makes a list. Repeatable.",
)

select_option = click.option(
    "--select",
    "selections",
    multiple=True,
    metavar="NAME=VALUE",
    help="Keep one value of a coordinate, or several with commas. Repeatable.",
)
