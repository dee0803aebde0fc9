"""The central unit cells of a sample, over which its strains are averaged."""

import math


def central(count: int) -> slice:
    """The central ones of ``count`` unit cells along one direction.

    They are the cells whose middle is in the middle third, or if there are none the two next to the
    middle: 1 of 1, 2 of 2, 1 of 3, 2 of 4, 1 of 5, 3 of 11, 8 of 22. The paper averages over a
    central block whose size it shows but does not state.
    """
    first = min(math.ceil(count / 3 - 0.5), (count - 1) // 2)
    return slice(first, count - first)
