"""Which symbol of a chart is the knit and which the purl: its only reading, or a refusal.

A chart has one symbol for all knits and one for all purls. Blanks and bars separate stitches where
it has two other symbols; beside a single one they may be stitches, too, which the user decides.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

from knitlab.io.errors import invalid

BETWEEN = " |"  # may separate stitches or be stitches; a blank is also an empty cell or line
KNITS, PURLS = "k1.", "p0-."  # by convention; beside another symbol a dot may be either


@dataclass(frozen=True)
class Key:
    """The symbols of a knit and of a purl, None where it is not known."""

    knit: str | None = None
    purl: str | None = None

    def __str__(self) -> str:
        named = (("knit", self.knit), ("purl", self.purl))
        return " and ".join(f"{face} = {symbol!r}" for face, symbol in named if symbol is not None)

    @property
    def symbols(self) -> tuple[str, ...]:
        """The symbols that are known."""
        return tuple(each for each in (self.knit, self.purl) if each is not None)

    def agrees(self, given: "Key") -> bool:
        """Whether it has the symbols that are given; if none are, whether no convention forbids it.

        Symbols without a convention are not forbidden.
        """
        if given.symbols:
            return given.knit in (None, self.knit) and given.purl in (None, self.purl)
        return self.knit not in {*PURLS} - {*KNITS} and self.purl not in {*KNITS} - {*PURLS}


UNKNOWN = Key()


def key_of_chart(path: str, drawn: Sequence[str], between: Sequence[str], given: Key) -> Key:
    """The key of a chart if it can be read in a single way; else InputError with all ways.

    Args:
        path: the file, for messages.
        drawn: the symbols that are stitches in any case, one or two with those that are given.
        between: the symbols that may separate stitches or be stitches.
        given: what the user says of the key.
    """
    symbols = list(dict.fromkeys([*drawn, *given.symbols]))
    alone = list[Key]()
    keys = [Key(*pair) for pair in permutations(symbols)] if len(symbols) == 2 else []
    if len(symbols) == 1:
        alone = [Key(knit=symbols[0]), Key(purl=symbols[0])]
        keys = [Key(*pair) for each in between for pair in permutations((each, symbols[0]))]
    alone = [key for key in alone if key.agrees(given)]
    keys = [key for key in keys if key.agrees(given)] or keys
    readings = [*keys, *alone]
    if len(readings) == 1 and (given.symbols or {*symbols} <= {*KNITS, *PURLS}):
        return readings[0]
    names = " and ".join(map(repr, between if alone and keys else symbols))
    if alone and keys:
        message = f"{names} may be stitches or separate stitches; give"
        hint = f", or remove {names}"
    else:
        message = f"{names} may be knits or purls; give"
        hint = ""
    raise invalid(path, f"{message} {', or '.join(map(str, keys or alone))}{hint}")
