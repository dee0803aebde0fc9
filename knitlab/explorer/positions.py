"""Positions of nodes along a test, packed as text that a browser unpacks by itself.

Every component is rounded to 4096 levels between its smallest and its largest value of the test.
Second differences along the strain are small, as fabric moves almost steadily; interleaved with
their sign, split into low and high bytes and deflated, they take a third of a byte each.
"""

import base64
import zlib
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

BITS = 12
LEVELS = (1 << BITS) - 1
SMALLEST_STEP = 1e-9
"""Step of a component that does not vary [mm]."""


@dataclass(frozen=True)
class PackedPositions:
    """Positions of the nodes of a test.

    Attributes:
        origin: smallest x, y and z [mm].
        step: distance between two levels of x, y and z [mm]; positions are off by half of it at
            most.
        text: the levels, packed; they are in the order strain, component, row, column.
    """

    origin: tuple[float, float, float]
    step: tuple[float, float, float]
    text: str

    @property
    def error(self) -> tuple[float, float, float]:
        """Largest error of x, y and z by rounding [mm]."""
        x, y, z = self.step
        return x / 2, y / 2, z / 2


def pack_positions(positions: Float[np.ndarray, "strain node_y node_x 3"]) -> PackedPositions:
    """Round positions to 12 bits a component, and pack them.

    Args:
        positions: of all nodes at every strain, none of them missing [mm].

    Raises:
        ValueError: if a position is missing.
    """
    if not np.isfinite(positions).all():
        raise ValueError("positions are missing; pack those of states that were reached")
    nodes = (0, 1, 2)
    origin = positions.min(axis=nodes)
    step = np.maximum(np.ptp(positions, axis=nodes) / LEVELS, SMALLEST_STEP)
    levels = np.rint((positions - origin) / step).astype(np.int32)
    packed = zlib.compress(_split_bytes(_second_differences(np.moveaxis(levels, -1, 1))), 9)
    x, y, z = origin.tolist()
    step_x, step_y, step_z = step.tolist()
    return PackedPositions(
        (x, y, z), (step_x, step_y, step_z), base64.b64encode(packed).decode("ascii")
    )


def _second_differences(levels: Int[np.ndarray, "strain *node"]) -> Int[np.ndarray, "strain *node"]:
    """Second differences along the strain; before the first strain everything is 0."""
    before = np.zeros_like(levels[:1])
    return np.diff(levels, n=2, axis=0, prepend=np.concatenate([before, before]))


def _split_bytes(differences: Int[np.ndarray, "*node"]) -> bytes:
    """All low bytes, then all high ones: those are nearly all 0 if small numbers have no sign."""
    unsigned = ((differences << 1) ^ (differences >> 31)).astype(np.uint16)
    low, high = unsigned & 0xFF, unsigned >> 8
    return low.astype(np.uint8).tobytes() + high.astype(np.uint8).tobytes()
