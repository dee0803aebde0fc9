"""Commands on what a laboratory recorded: ``import``."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from knitlab.commands.common import explains_bad_input, results_option

if TYPE_CHECKING:
    from knitlab.laboratory.description import Kind


@click.group(name="import")
def import_group() -> None:
    """Bring what a laboratory recorded into a cube, beside simulations."""


def _importing(kind: "Kind", summary: str) -> click.Command:
    @click.command(name=kind, help=summary)
    @click.argument("description", type=click.Path(path_type=Path, dir_okay=False))
    @results_option
    @explains_bad_input
    def command(description: Path, results: Path) -> None:
        from knitlab.laboratory.experiment import import_records

        imported = import_records(kind, description, results)
        for line in imported.summary:
            click.echo(line)
        click.echo(f"cube    {imported.path}")

    return command


_SUMMARIES: "dict[Kind, str]" = {
    "markers": "Import the tracked markers that DESCRIPTION, a TOML file, tells of.",
    "tensile": "Import the tensile test that DESCRIPTION, a TOML file, tells of.",
    "capacitance": "Import the LCR meter's log that DESCRIPTION, a TOML file, tells of.",
}
for _kind, _summary in _SUMMARIES.items():
    import_group.add_command(_importing(_kind, _summary))
