"""Status of a capacitance in a state. Imports no library, as cubes are read without JAX."""

from enum import IntEnum


class CapacitorStatus(IntEnum):
    """Whether a capacitance is measured, or why not.

    ``touching``: bare electrodes are closer than ``clearance``, or electrodes pass through each
    other.
    ``folded_through``: a fold at the electrodes is beyond half a turn, or an electrode passes
    through itself, which the model does not prevent. ``unresolved``: finer panels change the
    capacitance by more than the required accuracy.
    """

    measured = 0
    touching = 1
    folded_through = 2
    unresolved = 3
