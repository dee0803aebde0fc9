"""The covariance of the numbers of a stripe, with the repeats and degrees of freedom behind it."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

from knitlab.io.errors import invalid

Covariance = Mapping[str, Mapping[str, float]]
Subject = Literal["swatch", "mean"]
"""What is uncertain: a newly knitted swatch, or the mean stripe of all swatches."""
SUBJECTS: tuple[Subject, ...] = ("swatch", "mean")
MIN_REPEATS = 2  # smallest number of repeats whose scatter is known


@dataclass(frozen=True, eq=False)
class StripeCovariance(Covariance):
    """Covariance of the numbers of a mean stripe, as a table of rows by name.

    If S is the covariance of single swatches, that of the mean of R is S/R, which the table holds.
    The covariance of a new swatch about this mean is S(1 + 1/R), which is (R + 1) times the table.
    The error of a linear function of the numbers follows Student's t, exactly if swatches are
    normal.

    Attributes:
        table: covariance of the mean: of ``ln k_s``, ``ln k_t``, ``theta_0`` [rad], ``ln period``.
        degrees_of_freedom: of Student's t; by default infinite, as of normal errors.
        repeats: number R of swatches whose scatter the table was computed from. Without it, as
            of one curve, nothing is known about a new swatch.

    Raises:
        InputError: if the degrees of freedom are not above 0, or there are fewer than two repeats.

    Example:
        >>> import knitlab as kl
        >>> table = {"k_s": {"k_s": 0.0004}}
        >>> five = kl.StripeCovariance(table, degrees_of_freedom=4, repeats=5)
        >>> five["k_s"]["k_s"], round(five.factor("swatch"), 1)
        (0.0004, 6.0)
    """

    table: Covariance
    degrees_of_freedom: float = math.inf
    repeats: int | None = None

    def __post_init__(self) -> None:
        if not self.degrees_of_freedom > 0:
            message = f"is {self.degrees_of_freedom!r}; give a number above 0"
            raise invalid("degrees_of_freedom", message)
        if self.repeats is not None and self.repeats < MIN_REPEATS:
            message = f"is {self.repeats!r}; give {MIN_REPEATS} at least, or leave it out"
            raise invalid("repeats", message)

    @classmethod
    def of(cls, table: Covariance) -> "StripeCovariance":
        """A table as it is, or with normal errors if it is a plain mapping."""
        return table if isinstance(table, cls) else cls(table)

    def factor(self, subject: Subject) -> float:
        """Covariance of the subject over the table; NaN if it is not known."""
        if subject == "mean":
            return 1.0
        return math.nan if self.repeats is None else self.repeats + 1.0

    def __getitem__(self, name: str) -> Mapping[str, float]:
        return self.table[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.table)

    def __len__(self) -> int:
        return len(self.table)
