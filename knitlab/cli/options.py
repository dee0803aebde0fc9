"""Options, exit codes and messages that the commands share."""

import errno
import json
import re
import sys
import traceback
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import TYPE_CHECKING, Any

import click

from knitlab.cli.output import droppable_output
from knitlab.io.cube_path import cube_path, no_cube
from knitlab.io.errors import InputError, Mistake, failed_import, invalid, raise_if_any
from knitlab.io.names import check_suffix, one_line

if TYPE_CHECKING:
    import pandas as pd

SOME_CASE_NOT_OK, BAD_INPUT = 1, 2  # exit codes
EXHAUSTED = {errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.EAGAIN, errno.ENOSPC, errno.EDQUOT}
"""Error numbers of a machine that has no files, memory, processes or disk space left."""
WITHOUT_JAX = ("query", "find", "status")  # commands that need little memory
MIN_BYTES, MIN_BYTES_OF_JAX = 0.5e9, 3e9  # of address space; with less, libraries abort or hang
SETTINGS = "knitlab.settings"  # key of settings that have options of their own, in a context
MAX_LINES = 20  # cases that a command lists
FIGURES = (".pdf", ".svg", ".png")  # suffixes


class Existing(click.Path):
    """A path to read from; InputError if nothing is there, before anything slow is imported."""

    def convert(self, value: Any, *about: Any) -> Path:
        """Return the path as it is given."""
        path = Path(str(super().convert(value, *about)))
        if not path.exists():
            raise invalid(str(path), "does not exist; check the path")
        return path


class Cube(click.Path):
    """The path of a cube; InputError if there is none, before anything slow is imported."""

    def convert(self, value: Any, *about: Any) -> Path:
        """Return the path as it is given."""
        path = Path(str(super().convert(value, *about)))
        if not cube_path(path).is_file():
            raise no_cube(path)
        return path


CUBE = Cube()
EXISTING = Existing(dir_okay=False)
EXISTING_FOLDER = Existing(file_okay=False)
FILE = click.Path(path_type=Path, dir_okay=False)
FOLDER = click.Path(path_type=Path, file_okay=False)
COUNT = click.IntRange(min=1)
COUNT_OR_ZERO = click.IntRange(min=0)
POSITIVE = click.FloatRange(min=0, min_open=True)

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]


class CommandGroup(click.Group):
    """Commands that report invalid input one line each, and end with exit code 2."""

    def main(self, *words: Any, **settings: Any) -> Any:
        """Run a command, even if nobody reads its output."""
        with droppable_output():
            return super().main(*words, **settings)

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        """Find the command of a name; InputError if libraries would abort for lack of space."""
        found = super().resolve_command(ctx, args)
        with suppress(ImportError):
            import resource  # not on Windows

            limit = resource.getrlimit(resource.RLIMIT_AS)[0]
            least = MIN_BYTES if found[0] in WITHOUT_JAX else MIN_BYTES_OF_JAX
            if 0 <= limit < least:
                message = f"is {limit / 1e9:.1f} GB, and {found[0]} needs about {least / 1e9:g} GB"
                raise invalid("the limit of address space", f"{message}; raise ulimit -v")
        return found

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; whatever ends it is a message and exit code 2."""
        try:
            return super().invoke(ctx)
        except (click.ClickException, click.exceptions.Exit, click.Abort):
            raise
        except InputError as error:
            command = self.get_command(ctx, ctx.invoked_subcommand or "") or self
            for each in error.mistakes:
                echo_error(with_options(str(each), command))
        except Exception as error:
            echo_error(_explained(error))
        sys.exit(BAD_INPUT)


def _explained(error: Exception) -> str:
    """What an error that is no invalid input says of the machine, the installation or knitlab."""
    cause = error.__cause__ or error
    if isinstance(error, MemoryError) or getattr(error, "errno", None) in EXHAUSTED:
        return f"this machine has too few resources: {str(error) or 'out of memory'}; free some"
    if library := failed_import(cause):
        reason = str(cause).strip().rpartition("\n")[2]
        hint = f"check variables such as {library.upper()}_…, or install it again"
        return f"{library}: cannot be imported ({reason}); {hint}"
    if isinstance(error, OSError) and error.strerror:
        place = error.filename or "the current folder"
        return f"{place}: cannot be used ({error.strerror}); check the path"
    with NamedTemporaryFile(
        "w", encoding="utf-8", prefix="knitlab-", suffix=".txt", delete=False
    ) as file:
        traceback.print_exception(error, file=file)
    reason = f"{type(error).__name__}: {error}"
    return f"this is an error in knitlab ({reason}); report it with {file.name}"


def echo_error(message: object) -> None:
    """Print a message about an error or a warning on the error stream."""
    click.echo(f"knitlab: {one_line(message)}", err=True)


def echo_report(lines: Iterable[str], warnings: Iterable[object] = ()) -> None:
    """Print lines, and warnings on the error stream."""
    for line in lines:
        click.echo(line)
    for warning in warnings:
        echo_error(warning)


def echo_first(lines: Sequence[str], indent: str = "", more: str = "", err: bool = False) -> None:
    """Print the first lines, and how many more there are."""
    for line in lines[:MAX_LINES]:
        click.echo(indent + one_line(line), err=err)
    if len(lines) > MAX_LINES:
        click.echo(f"{indent}… and {len(lines) - MAX_LINES} more{more}", err=err)


def show(
    table: "pd.DataFrame",
    style: str,
    output: Path | None = None,
    what: str = "",
    heading: Sequence[str] = (),
) -> None:
    """Print a table below a heading; on the error stream, its models, and a written file."""
    from knitlab.api.cubes import formatted

    for line in table.attrs.get("models", ()):
        click.echo(one_line(line), err=True)
    for line in heading:
        click.echo(line, err=style != "table")
    click.echo(formatted(table, style))
    if output is not None:
        click.echo(f"{what or 'figure':6}  {output}", err=True)


def check_planned(workflow: str, settings: Sequence[str]) -> None:
    """Say what is invalid in a workflow and its settings before JAX is imported."""
    from knitlab.api.sweeps import plan

    plan(workflow, settings)


def check_selected(cube: Path, selections: dict[str, Any], where: str | None = None) -> None:
    """Say what is invalid in selections of a cube before JAX is imported."""
    from knitlab.api.cubes import query

    query(cube, selections=selections, where=where)


def show_models(cubes: Iterable[Path]) -> None:
    """Print on the error stream of which model the numbers of cubes are."""
    from knitlab.api.cubes import models

    for line in models(*cubes):
        click.echo(one_line(line), err=True)


def exit_unless(ok: bool) -> None:
    """End with exit code 1 if what was asked for did not succeed."""
    if not ok:
        sys.exit(SOME_CASE_NOT_OK)


def with_options(message: str, command: click.Command | None = None) -> str:
    """A message about a Python argument, with the name of its option instead.

    The hint ``give NAME = VALUE`` becomes ``give --name VALUE``, and ``give NAME = True`` a flag.
    """
    command = command or click.get_current_context().command
    opts = {each.name: each.opts[-1] for each in command.params if isinstance(each, click.Option)}
    message = re.sub(
        r"\b(give|and|or) (\w+) =( True)? ?",
        lambda match: f"{match[1]} {opts[match[2]]} " if match[2] in opts else match[0],
        message,
    )
    argument, space, rest = message.partition(" ")
    name = argument.removesuffix(":")
    return f"{opts[name]}{argument[len(name) :]}{space}{rest}" if name in opts else message


def read_selections(texts: tuple[str, ...]) -> dict[str, list[float | str]]:
    """The values of ``--select`` by coordinate; InputError if malformed, or given twice."""
    selections: dict[str, list[float | str]] = {}
    mistakes = []
    for text in texts:
        name, _, listed = (part.strip() for part in text.partition("="))
        if not listed:
            mistakes.append(Mistake(f"selections {text}", "is not NAME=VALUE; give both"))
        elif name in selections:
            message = f"selects {name} again; give its values once, separated by commas"
            mistakes.append(Mistake(f"selections {text}", message))
        else:
            selections[name] = [_number_or_label(each.strip()) for each in listed.split(",")]
    raise_if_any(mistakes)
    return selections


def _number_or_label(text: str) -> float | str:
    """The number that a text is written for, or the text itself: 04 may be a label."""
    for kind in (int, float):
        with suppress(ValueError):
            if str(kind(text)) == text:
                return kind(text)
    return text


def _two_counts(text: str) -> tuple[int, int]:
    """The counts of ``--repeats``; InputError if the text is not two counts."""
    match = re.fullmatch(r"(\d{1,6})\s*[x×,]\s*(\d{1,6})", text.strip())
    if match is None:
        raise invalid("repeats", f"is {text!r}; give two counts such as 4x2, along warp and weft")
    return int(match[1]), int(match[2])


cubes = click.argument("cubes", type=CUBE, nargs=-1, required=True)


def option(names: str, help: str = "", kind: Any = str, **settings: Any) -> Decorator:
    """An option; ``names`` are its flags, then perhaps its argument and its METAVAR.

    ``kind`` is its type, or a list of the words to choose from.
    """
    words = names.split()
    if words[-1][0].isupper():
        settings["metavar"] = words.pop()
    kind = click.Choice(kind) if isinstance(kind, list) else kind
    return click.option(*words, type=kind, help=help, **settings)


def flag(names: str, help: str) -> Decorator:
    """An option without a value."""
    return click.option(*names.split(), is_flag=True, help=help)


def repeatable(names: str, help: str, kind: Any = str, **settings: Any) -> Decorator:
    """An option that may be given several times."""
    return option(names, f"{help} Repeatable.", kind, multiple=True, **settings)


def output(help: str, suffixes: Sequence[str], kind: str, **settings: Any) -> Decorator:
    """The option ``--output`` of a command that writes one file of a kind, with these suffixes."""

    def checked(_: Any, __: Any, path: Path | None) -> Path | None:
        if path is not None:
            check_suffix(path, suffixes, kind)
        return path

    help = f"{help}: {', '.join(suffixes)}."
    return option("-o --output", help, FILE, callback=checked, **settings)


def workers(default: int | None, shown: str | bool = True) -> Decorator:
    """The option ``--workers``, with the default of a command and how to show it."""
    help = "Worker processes on this machine; 0 runs in this process."
    return option("--workers", help, COUNT_OR_ZERO, default=default, show_default=shown)


def _add_setting(context: click.Context, parameter: click.Parameter, value: Any) -> None:
    if value is not None:
        given = context.meta.setdefault(SETTINGS, [])
        given.append(f"{parameter.name}={json.dumps(value, default=str)}")


AS_SETTING: dict[str, Any] = {"is_eager": True, "expose_value": False, "callback": _add_setting}
"""Arguments of an option that is short for ``--set`` of its name."""
results = option(
    "--results",
    "Folder that holds a folder of results for each workflow.",
    FOLDER,
    default=Path("results"),
)
repeats = option(
    "--repeats NxM", "Repeats of the pattern along the warp and the weft, such as 4x2.", _two_counts
)
where = option("--where EXPRESSION", "Keep the designs for which this holds.")
table_format = option("--format style", kind=["table", "csv", "json"], default="table")
_material = option(
    "--material",
    "Material file with the stripes of another yarn, in place of the paper's.",
    EXISTING,
    **AS_SETTING,
)
_settings = repeatable(
    "--set settings KEY=VALUE",
    "Override a setting of the workflow; a comma makes a list.",
    callback=lambda context, _, texts: (*texts, *context.meta.get(SETTINGS, ())),
)


def settings(command: Callable[..., Any]) -> Callable[..., Any]:
    """The options ``--set`` and ``--material``, which is the setting ``material``."""
    return _material(_settings(command))


select = repeatable(
    "--select selections NAME=VALUE",
    "Keep one value of a coordinate, or several with commas.",
    callback=lambda _, __, texts: read_selections(texts),
)
