"""What commands share: options, exit codes, and bad input told as such."""

import sys
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any

import click

from knitlab.sweep.faults import BadInput

BAD_INPUT = 2
SOME_CASE_NOT_OK = 1
MOST_LINES = 20
"""Cases of which a command lists that many."""

Command = Callable[..., None]


def explains_bad_input(command: Command) -> Command:
    """Turn bad input into its message and exit code 2."""

    @wraps(command)
    def explained(*arguments: Any, **options: Any) -> None:
        try:
            command(*arguments, **options)
        except BadInput as error:
            for fault in error.faults:
                click.echo(f"knitlab: {fault}", err=True)
            sys.exit(BAD_INPUT)

    return explained


results_option = click.option(
    "--results",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("results"),
    show_default=True,
    help="Folder that holds a folder of results for each workflow.",
)


set_option = click.option(
    "--set",
    "overrides",
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
