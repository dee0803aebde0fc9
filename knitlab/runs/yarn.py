"""What a material says of its yarn, and of the machine that its swatches were knitted on."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from pydantic import PositiveFloat

from knitlab.io.names import Line

ATTRIBUTE = "material_"  # what an attribute of a cube begins with


@dataclass(frozen=True)
class YarnOnMachine:
    """Yarn, stitch sizes and machine of a material; None is not given.

    Attributes:
        yarn: the yarn of the fabric, in words.
        conductive_yarn: the yarn of electrodes, in words.
        stitch_size: size of a stitch [unit of the machine].
        plated_stitch_size: that of a plated stitch [unit of the machine].
        machine: model of the machine that the sizes and the stripes belong to.
    """

    yarn: Line | None = None
    conductive_yarn: Line | None = None
    stitch_size: PositiveFloat | None = None
    plated_stitch_size: PositiveFloat | None = None
    machine: Line | None = None

    @property
    def given(self) -> dict[str, Any]:
        """What is given, by name."""
        return {name: value for name, value in asdict(self).items() if value is not None}

    @property
    def attributes(self) -> dict[str, Any]:
        """What is given, as attributes of a cube."""
        return {f"{ATTRIBUTE}{name}": value for name, value in self.given.items()}

    @classmethod
    def of_attributes(cls, attributes: Mapping[str, Any]) -> "YarnOnMachine":
        """The yarn that the attributes of a cube state."""
        stated = {name: attributes.get(f"{ATTRIBUTE}{name}") for name in asdict(cls())}
        # A netCDF file returns numbers as those of numpy.
        return cls(**{k: v.item() if isinstance(v, np.generic) else v for k, v in stated.items()})
