"""A variable of a case or of a cube: its dims, units and meaning."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Variable:
    """One variable, as a case holds it; a cube adds the dimensions of its designs.

    Attributes:
        dims: its dimensions within a case.
        units: UDUNITS text.
        long_name: the label of a figure's axis.
        description: what it is, where the name leaves a question.
        in_cube: whether the cube has it, or the case alone.
        of: what cases have it: all, those reached by dynamics, those of a pure stripe, those of
            rib and garter patches, those of which sensitivities were asked for, those with
            electrodes, those with electrodes that are let go again, those with siblings,
            measured ones, or candidates of a design. What is of a design or of its stripes is in
            the cube alone, as a case's file states it among its parameters; what is of cloth too,
            as the cube's gauge makes it of a case with rib and garter patches.
    """

    dims: tuple[str, ...]
    units: str
    long_name: str
    description: str = ""
    in_cube: bool = True
    of: Literal[
        "all",
        "dynamics",
        "stripe",
        "patches",
        "sensitivities",
        "capacitor",
        "unloading",
        "robustness",
        "laboratory",
        "design",
        "stripes",
        "cloth",
        "candidate",
    ] = "all"

    @property
    def attributes(self) -> dict[str, str]:
        """Its CF attributes."""
        described = {"description": self.description} if self.description else {}
        return {"units": self.units, "long_name": self.long_name, **described}
