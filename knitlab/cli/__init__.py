"""The command line: ``knitlab plan | run | status | reproduce | query | map | claims | …``."""

import click

from knitlab.cli.calibration import calibrate
from knitlab.cli.cubes import claims, compare, draw_map, query
from knitlab.cli.designing import design
from knitlab.cli.exploring import explore
from knitlab.cli.exporting import export
from knitlab.cli.finding import find
from knitlab.cli.knitting import knit
from knitlab.cli.laboratory import fit, import_group
from knitlab.cli.sweeps import merge, plan, reproduce, run, status

COMMANDS = (
    plan,
    run,
    merge,
    status,
    reproduce,
    query,
    find,
    design,
    knit,
    draw_map,
    explore,
    export,
    claims,
    compare,
    calibrate,
    import_group,
    fit,
)


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="knitlab")
def main() -> None:
    """Simulate folding knits and find the one you need."""


for _command in COMMANDS:
    main.add_command(_command)
