"""Options, exit codes and messages that commands share."""

import re
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import wraps
from pathlib import Path
from typing import Any

import click

from knitlab.io.errors import BadInput, Fault, fault

BAD_INPUT = 2
SOME_CASE_NOT_OK = 1
MOST_LINES = 20
"""Largest number of cases that a command lists."""

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
    """Check the suffix of a file for stripes.

    Raises:
        BadInput: if it is not ``.toml``.
    """
    if output.suffix != ".toml":
        raise fault(f"output {output}", "has no suffix .toml; give it one")


def _with_options(message: str) -> str:
    """The message about a Python argument, with the name of its option instead."""
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


def workers_option(default: int | None, shown: str | bool = True) -> Callable[[Command], Command]:
    """The option ``--workers``, with the default of a command and how to show it."""
    return click.option(
        "--workers",
        type=click.IntRange(min=0),
        default=default,
        show_default=shown,
        help="Worker processes on this machine; 0 runs in this process.",
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


def read_selections(texts: tuple[str, ...]) -> dict[str, list[float | str]]:
    """The values of ``--select`` by their coordinate.

    Raises:
        BadInput: with every text that is malformed, or of a coordinate that an earlier one selects.
    """
    found: dict[str, list[float | str]] = {}
    faults = []
    for text in texts:
        name, _, listed = (part.strip() for part in text.partition("="))
        if not listed:
            faults.append(Fault(f"selections {text}", "is not NAME=VALUE; give both"))
        elif name in found:
            problem = f"selects {name} again; give its values once, with commas between them"
            faults.append(Fault(f"selections {text}", problem))
        else:
            found[name] = [_value(part.strip()) for part in listed.split(",")]
    if faults:
        raise BadInput(faults)
    return found


def _value(text: str) -> float | str:
    """The number that is written as this text, or the text: 04 may be a label."""
    for kind in (int, float):
        with suppress(ValueError):
            if str(kind(text)) == text:
                return kind(text)
    return text


repeats_option = click.option(
    "--repeats",
    metavar="NxM",
    help="Repeats of the pattern along the warp and the weft, such as 4x2.",
)


def two_counts(text: str | None) -> tuple[int, int] | None:
    """The counts of ``--repeats``; ``None`` if it is not given.

    Raises:
        BadInput: if the text is of another form.
    """
    if text is None:
        return None
    match = re.fullmatch(r"(\d+)\s*[x×,]\s*(\d+)", text.strip())
    if match is None:
        raise fault("repeats", f"is {text!r}; give two counts such as 4x2, along warp and weft")
    return int(match[1]), int(match[2])
