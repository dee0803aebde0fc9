"""Writing knitout: lines in order, with the inserting hook let go before it is in the way."""

from collections.abc import Iterable, Sequence
from typing import Literal

Direction = Literal["-", "+"]
LEFTWARD: Direction = "-"
RIGHTWARD: Direction = "+"


def opposite(direction: Direction) -> Direction:
    """The other direction of the carriage."""
    return RIGHTWARD if direction == LEFTWARD else LEFTWARD


def needle(front: bool, number: int) -> str:
    """Name of a needle."""
    return f"{'f' if front else 'b'}{number}"


class KnitoutWriter:
    """Lines of knitout, and what the machine would be doing after them.

    The inserting hook parks to the right of the first stitch of its carrier, and no carrier may
    pass it. It is let go as late as that allows, so that the end of the yarn is held by as many
    stitches as possible.

    Attributes:
        lines: the lines so far.
    """

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._hooked: int | None = None
        self._hook_from: int | None = None
        self._stitch_number: int | None = None
        self._racking = 0
        self._active: set[int] = set()

    def comment(self, text: str) -> None:
        """Write a comment."""
        self.lines.append(f";{text}")

    def stitch_number(self, number: int) -> None:
        """Take a row of the stitch table, unless it is taken already."""
        if number != self._stitch_number:
            self.lines.append(f"x-stitch-number {number}")
            self._stitch_number = number

    def is_in(self, carrier: int) -> bool:
        """Whether a carrier is in action."""
        return carrier in self._active

    def bring_in(self, carrier: int) -> None:
        """Bring a carrier in by the inserting hook; its next stitch must go leftwards."""
        self.release()
        self.lines.append(f"inhook {carrier}")
        self._hooked, self._hook_from = carrier, None
        self._active.add(carrier)

    def release(self) -> None:
        """Let the inserting hook go, if it holds a yarn."""
        if self._hooked is not None:
            self.lines.append(f"releasehook {self._hooked}")
            self._hooked = self._hook_from = None

    def bring_out(self, carrier: int) -> None:
        """Cut the yarn of a carrier and take it out."""
        self.release()
        self.lines.append(f"outhook {carrier}")
        self._active.remove(carrier)

    def knit(self, direction: Direction, front: bool, number: int, carriers: Sequence[int]) -> None:
        """Knit a stitch."""
        self._form("knit", direction, front, number, carriers)

    def tuck(self, direction: Direction, front: bool, number: int, carriers: Sequence[int]) -> None:
        """Tuck yarn onto a needle."""
        self._form("tuck", direction, front, number, carriers)

    def transfer(self, to_front: bool, numbers: Iterable[int]) -> None:
        """Move the loops of some positions to the needles opposite."""
        self.release()
        self.lines += [
            f"xfer {needle(not to_front, number)} {needle(to_front, number)}" for number in numbers
        ]

    def move(self, front: bool, number: int, other: int) -> None:
        """Move the loops of a needle to another position of the bed opposite, by racking for it."""
        self.release()
        # At racking R, back needle B is opposite front needle B + R.
        self.rack(number - other if front else other - number)
        self.lines.append(f"xfer {needle(front, number)} {needle(not front, other)}")

    def rack(self, racking: int) -> None:
        """Move the back bed."""
        if racking != self._racking:
            self.lines.append(f"rack {racking}")
            self._racking = racking

    def drop(self, front: bool, number: int) -> None:
        """Drop the loops of a needle."""
        self.lines.append(f"drop {needle(front, number)}")

    def _form(
        self, opcode: str, direction: Direction, front: bool, number: int, carriers: Sequence[int]
    ) -> None:
        if self._hook_from is not None and number >= self._hook_from:
            self.release()
        elif self._hooked in carriers and self._hook_from is None:
            self._hook_from = number + 1
        named = " ".join(map(str, carriers))
        self.lines.append(f"{opcode} {direction} {needle(front, number)} {named}")
