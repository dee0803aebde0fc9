"""Names that are not known: what was meant, or what there is."""

import difflib
from collections.abc import Iterable

MOST_NAMES = 20
"""Names that a message lists."""


def unknown(name: str, known: Iterable[str], kind: str = "") -> str:
    """Say that a name is not known, and which may have been meant or what there is.

    Args:
        name: the name.
        known: the names that there are.
        kind: what they are names of, such as "setting".
    """
    names = sorted(known)
    problem = f"there is no {kind} {name!r}" if kind else f"there is no {name!r}"
    by_case = {each.casefold(): each for each in names}
    nearest = difflib.get_close_matches(name.casefold(), by_case, n=2)
    if nearest:
        return f"{problem}; did you mean {' or '.join(repr(by_case[near]) for near in nearest)}?"
    if len(names) > MOST_NAMES:
        return f"{problem}; it is none of the {len(names)} that there are; check its spelling"
    return f"{problem}; choose from {', '.join(names)}"
