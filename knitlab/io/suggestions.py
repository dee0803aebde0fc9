"""Messages about unknown names: similar names, or the known ones."""

import difflib
from collections.abc import Iterable

MOST_NAMES = 20
"""Largest number of names that a message lists."""


def unknown(name: str, known: Iterable[str], kind: str = "") -> str:
    """Message that a name is unknown, with similar names or the list of known ones.

    Args:
        name: the name.
        known: the known names.
        kind: what the names refer to, such as "setting".
    """
    names = sorted(known)
    problem = f"there is no {kind} {name!r}" if kind else f"there is no {name!r}"
    by_case = {each.casefold(): each for each in names}
    nearest = difflib.get_close_matches(name.casefold(), by_case, n=2)
    if nearest:
        return f"{problem}; did you mean {' or '.join(repr(by_case[near]) for near in nearest)}?"
    if len(names) > MOST_NAMES:
        return f"{problem}; it is not one of the {len(names)} known ones; check its spelling"
    return f"{problem}; choose from {', '.join(names)}"
