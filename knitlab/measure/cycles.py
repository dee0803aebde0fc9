"""Cycles of a test that is pulled and let go again and again."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Cycle:
    """One cycle of a test, by the times of its turns; it is pulled first, then let go.

    Attributes:
        start: when it begins to be pulled.
        turn: when it is let go.
        end: when it is back; ``turn`` if it is not let go.
    """

    start: float
    turn: float
    end: float

    def pulled(self, time: Float[np.ndarray, " record"]) -> np.ndarray:
        """Which times are while it is pulled."""
        return (time >= self.start) & (time <= self.turn)

    def let_go(self, time: Float[np.ndarray, " record"]) -> np.ndarray:
        """Which times are while it is let go."""
        return (time >= self.turn) & (time <= self.end)


def cycles(
    time: Float[np.ndarray, " record"],
    extension: Float[np.ndarray, " record"],
    least_turn: float,
) -> list[Cycle]:
    """Separate the cycles of a test.

    Args:
        time: ascending.
        extension: at these times.
        least_turn: part of the whole range by which the extension must turn to count as turning.

    Returns:
        The cycles in order; what comes before the first pull is left out, and so is a pull at the
        end that is shorter than ``least_turn`` of the range.
    """
    span = np.ptp(extension)
    if not span > 0:
        return []
    turns = _turns(extension, least_turn * span)
    found = []
    for place in range(len(turns) - 1):
        low, high = turns[place], turns[place + 1]
        if extension[high] <= extension[low]:
            continue
        last = turns[place + 2] if place + 2 < len(turns) else high
        found.append(Cycle(float(time[low]), float(time[high]), float(time[last])))
    return found


def _turns(extension: Float[np.ndarray, " record"], least: float) -> list[int]:
    """Places of the lowest and highest extensions in turn, each ``least`` from the one before."""
    lowest = highest = 0
    turns: list[int] = []
    rising = None
    for place, value in enumerate(extension):
        # The last of equal lows and the first of equal highs bound a pull.
        if value <= extension[lowest]:
            lowest = place
        if value > extension[highest]:
            highest = place
        if rising is not False and extension[highest] - value >= least:
            turns += [lowest, highest] if rising is None and lowest < highest else [highest]
            rising, lowest = False, place
        elif rising is not True and value - extension[lowest] >= least:
            turns.append(lowest)
            rising, highest = True, place
    last = highest if rising else lowest
    if rising is not None and last != turns[-1]:
        turns.append(last)
    return turns
