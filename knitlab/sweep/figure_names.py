"""Names of the figures that a workflow can ask for and a command can draw. Needs no library."""

from typing import Literal

FigureName = Literal[
    "auxetic",
    "curves",
    "shape",
    "shapes",
    "network",
    "tension",
    "samples",
    "wavelength",
    "sensitivity",
    "sensor",
    "capacitors",
    "electrodes",
    "wedge",
    "readings",
    "relaxation",
    "folding",
    "stripes",
    "departure",
]
