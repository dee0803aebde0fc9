"""What there is of a capacitance in a state. Needs no library, for cubes are read without JAX."""

from enum import IntEnum


class CapacitorStatus(IntEnum):
    """Whether a capacitance is measured, or why not.

    ``touching``: the electrodes are nearer than they are thick, or pass through each other.
    ``folded_through``: a fold at them is past half a turn, or one of them passes through itself;
    the model has no contact, and goes on where no fabric does. ``unresolved``: finer panels still
    change it by more than the required accuracy.
    """

    measured = 0
    touching = 1
    folded_through = 2
    unresolved = 3
