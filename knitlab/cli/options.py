"""Options, exit codes and messages that commands share."""

import json
import re
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from knitlab.cli.output import droppable_output
from knitlab.io.errors import BadInput, Fault, fault

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BAD_INPUT = 2
MATERIAL = "knitlab.material"
"""Key of the material file in the context of a command."""
SOME_CASE_NOT_OK = 1
MOST_LINES = 20  # largest number of cases that a command lists
PATH = click.Path(path_type=Path)
FILE = click.Path(path_type=Path, dir_okay=False)
FOLDER = click.Path(path_type=Path, file_okay=False)
COUNT = click.IntRange(min=1)
COUNT_OR_ZERO = click.IntRange(min=0)
POSITIVE = click.FloatRange(min=0, min_open=True)

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]


class CommandGroup(click.Group):
    """Commands that explain bad input in sentences, and end with exit code 2."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command that is named; its work never depends on what it shows."""
        with droppable_output():
            try:
                return super().invoke(ctx)
            except BadInput as error:
                command = self.get_command(ctx, ctx.invoked_subcommand or "") or self
                for each in error.faults:
                    echo_problem(_with_option(str(each), command))
                sys.exit(BAD_INPUT)


def echo_problem(problem: object) -> None:
    """Print a problem on the error stream."""
    click.echo(f"knitlab: {problem}", err=True)


def echo_first(lines: Sequence[str], indent: str = "", more: str = "", err: bool = False) -> None:
    """Print the first lines, and how many more there are."""
    for line in lines[:MOST_LINES]:
        click.echo(indent + line, err=err)
    if len(lines) > MOST_LINES:
        click.echo(f"{indent}… and {len(lines) - MOST_LINES} more{more}", err=err)


def exit_unless(ok: bool) -> None:
    """End with exit code 1 if what was asked for did not succeed."""
    if not ok:
        sys.exit(SOME_CASE_NOT_OK)


def _with_option(message: str, command: click.Command) -> str:
    """The message about a Python argument, with the name of its option instead."""
    argument, space, rest = message.partition(" ")
    for parameter in command.params:
        if parameter.name == argument.removesuffix(":") and isinstance(parameter, click.Option):
            colon = ":" if argument.endswith(":") else ""
            return f"{parameter.opts[-1]}{colon}{space}{rest}"
    return message


def read_selections(texts: tuple[str, ...]) -> dict[str, list[float | str]]:
    """The values of ``--select`` by coordinate; BadInput if malformed, or given twice."""
    selections: dict[str, list[float | str]] = {}
    faults = []
    for text in texts:
        name, _, listed = (part.strip() for part in text.partition("="))
        if not listed:
            faults.append(Fault(f"selections {text}", "is not NAME=VALUE; give both"))
        elif name in selections:
            problem = f"selects {name} again; give its values once, with commas between them"
            faults.append(Fault(f"selections {text}", problem))
        else:
            selections[name] = [_number_or_label(each.strip()) for each in listed.split(",")]
    if faults:
        raise BadInput(faults)
    return selections


def _number_or_label(text: str) -> float | str:
    """The number that is written as this text, or the text: 04 may be a label."""
    for kind in (int, float):
        with suppress(ValueError):
            if str(kind(text)) == text:
                return kind(text)
    return text


def _two_counts(text: str) -> tuple[int, int]:
    """The counts of ``--repeats``; BadInput if the text is of another form."""
    match = re.fullmatch(r"(\d+)\s*[x×,]\s*(\d+)", text.strip())
    if match is None:
        raise fault("repeats", f"is {text!r}; give two counts such as 4x2, along warp and weft")
    return int(match[1]), int(match[2])


def read_machine_values(texts: tuple[str, ...]) -> dict[str, Any]:
    """The values of ``--machine`` by key; BadInput with every text that is not ``KEY=VALUE``."""
    from knitlab.sweep.workflow_file import read_overrides

    read, faults = read_overrides(texts, "machine")
    if faults:
        raise BadInput(faults)
    return {each.key: each.value for each in read}


def check_toml(output: Path) -> None:
    """Raise BadInput unless a file for stripes has the suffix ``.toml``."""
    if output.suffix != ".toml":
        raise fault(f"output {output}", "has no suffix .toml; give it one")


def draw_beside(output: Path, draw: Callable[[], "Figure"]) -> None:
    """Save a figure beside a file, as PDF and PNG."""
    from knitlab.figures.figure_files import draw_into

    files = [output.with_suffix(suffix) for suffix in (".pdf", ".png")]
    draw_into(draw, *files)
    for file in files:
        click.echo(f"figure   {file}")


cubes = click.argument("cubes", type=PATH, nargs=-1, required=True)
results = click.option(
    "--results",
    type=FOLDER,
    default=Path("results"),
    help="Folder that holds a folder of results for each workflow.",
)
repeats = click.option(
    "--repeats",
    type=_two_counts,
    metavar="NxM",
    help="Repeats of the pattern along the warp and the weft, such as 4x2.",
)
table_format = click.option(
    "--format", "style", type=click.Choice(["table", "csv", "json"]), default="table"
)


def repeatable(names: str, help: str, **options: Any) -> Decorator:
    """An option that may be given several times, by its names with spaces between."""
    return click.option(*names.split(), multiple=True, help=f"{help} Repeatable.", **options)


_material = click.option(
    "--material",
    type=FILE,
    help="Material file with the stripes of another yarn, in place of the paper's.",
    is_eager=True,
    expose_value=False,
    callback=lambda context, _, path: context.meta.update({MATERIAL: path}),
)
_settings = repeatable(
    "--set settings",
    "Override a setting of the workflow; a comma makes a list.",
    metavar="KEY=VALUE",
    callback=lambda context, _, texts: _with_material(context.meta.get(MATERIAL), texts),
)


def settings(command: Callable[..., Any]) -> Callable[..., Any]:
    """The options ``--set`` and ``--material``, which is the setting ``material``."""
    return _material(_settings(command))


def _with_material(path: Path | None, texts: tuple[str, ...]) -> tuple[str, ...]:
    return texts if path is None else (f"material={json.dumps(str(path))}", *texts)


select = repeatable(
    "--select selections",
    "Keep one value of a coordinate, or several with commas.",
    metavar="NAME=VALUE",
    callback=lambda _, __, texts: read_selections(texts),
)


def output(help: str, **options: Any) -> Decorator:
    """The option ``--output`` of a command that writes one file."""
    return click.option("-o", "--output", type=FILE, help=help, **options)


def covariances(help: str) -> Decorator:
    """The option ``--material`` of a command that takes the covariances of its stripes."""
    return click.option("--material", type=FILE, metavar="FILE", help=help)


def workers(default: int | None, shown: str | bool = True) -> Decorator:
    """The option ``--workers``, with the default of a command and how to show it."""
    return click.option(
        "--workers",
        type=COUNT_OR_ZERO,
        default=default,
        show_default=shown,
        help="Worker processes on this machine; 0 runs in this process.",
    )
