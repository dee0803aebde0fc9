"""Commands as a user types them."""

from click.testing import CliRunner, Result

from knitlab.cli import main


def knitlab(*words: object) -> Result:
    """What a command says."""
    return CliRunner().invoke(main, [*map(str, words)])
