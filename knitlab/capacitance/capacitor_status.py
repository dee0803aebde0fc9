"""Status of a capacitance in a state. Imports no library, as cubes are read without JAX."""

from enum import IntEnum


class CapacitorStatus(IntEnum):
    """Whether a capacitance is measured, or why not.

    ``touching``: the electrodes are closer than they are thick, or pass through each other.
    ``folded_through``: a fold at them is beyond half a turn, or one of them passes through itself,
    which the model does not prevent. ``unresolved``: finer panels still change it by more than the
    required accuracy.
    """

    measured = 0
    touching = 1
    folded_through = 2
    unresolved = 3
