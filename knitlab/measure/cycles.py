"""Cycles of loading and unloading."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Cycle:
    """One cycle of loading and unloading, by the times of its reversals.

    Attributes:
        start: start of loading.
        turn: end of loading and start of unloading.
        end: end of unloading; ``turn`` if there is none.
    """

    start: float
    turn: float
    end: float

    def loaded(self, time: Float[np.ndarray, " record"]) -> np.ndarray:
        """Whether times are during loading."""
        return (time >= self.start) & (time <= self.turn)

    def unloaded(self, time: Float[np.ndarray, " record"]) -> np.ndarray:
        """Whether times are during unloading."""
        return (time >= self.turn) & (time <= self.end)


def cycles(
    time: Float[np.ndarray, " record"],
    extension: Float[np.ndarray, " record"],
    least_turn: float,
) -> list[Cycle]:
    """Separate the cycles of a test.

    Args:
        time: times, ascending.
        extension: extension at these times.
        least_turn: change of extension after a reversal, over its full range, below which the
            reversal is ignored.

    Returns:
        The cycles in order, without records before the first loading, and without a final loading
        by less than ``least_turn`` of the range.
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
    """Indices of alternating minima and maxima, each ``least`` away from the previous one."""
    lowest = highest = 0
    turns: list[int] = []
    rising = None
    for place, value in enumerate(extension):
        # Loading is from the last of equal minima to the first of equal maxima.
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
