"""A variable of a case or of a cube: its dimensions, unit and meaning."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Variable:
    """One variable, as a case holds it; a cube adds the dimensions of its designs.

    Attributes:
        dims: its dimensions within a case.
        units: unit in UDUNITS notation.
        long_name: label for the axis of a figure.
        description: further explanation, if the name needs one.
        in_cube: whether cubes have it, rather than case files only.
        of: which cases have it: all, those computed by dynamics, those of a pure stripe, those of
            rib and garter patches, those with sensitivities, those with electrodes, those with
            electrodes and unloading, those with siblings, those with contact, experiments, or
            candidates of a design. Variables of a ``design``, of its ``stripes`` or of ``cloth``
            are in the cube only: case files state the first two among their parameters, and the
            last follow from the gauge of the cube, for cases with rib and garter patches.
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
        "contact",
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
