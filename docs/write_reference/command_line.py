"""The reference of the command line, from what each command prints with ``--help``."""

import inspect
from collections.abc import Iterator

import click
from markdown_text import code, plain, table

from knitlab.cli import main


def page() -> str:
    """Every command: its usage, what it does, and its options."""
    return "\n\n".join(part for name in main.commands for part in _section(name))


def _section(name: str) -> Iterator[str]:
    command = main.commands[name]
    program = click.Context(main, info_name="knitlab", **main.context_settings)
    context = click.Context(command, program, info_name=name)
    yield f"## knitlab {name}"
    yield f"    {command.get_usage(context).removeprefix('Usage: ')}"
    yield plain(inspect.cleandoc(command.help or ""))
    options = [each for each in command.params if isinstance(each, click.Option)]
    records = filter(None, (option.get_help_record(context) for option in options))
    rows = [(code(names), plain(meaning.replace("  [", " ["))) for names, meaning in records]
    if rows:
        yield table(("option", "meaning"), rows)
