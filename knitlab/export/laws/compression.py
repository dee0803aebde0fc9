"""Classes of compression, of ``params/compression.toml``."""

import math
from dataclasses import dataclass

import pandas as pd

from knitlab.io.errors import invalid, unknown
from knitlab.io.shipped import shipped
from knitlab.io.toml import read_toml


@dataclass(frozen=True)
class CompressionClass:
    """Pressures that a standard wants at the ankle or the wrist [mmHg]."""

    lowest: float
    source: str
    highest: float = math.inf

    @property
    def middle(self) -> float:
        """The pressure to aim at."""
        return self.lowest if math.isinf(self.highest) else (self.lowest + self.highest) / 2

    def judge(self, table: pd.DataFrame) -> str:
        """Mark where a sleeve lies in the class; the pressure at its narrowest place, in words."""
        table["in_class"] = table["pressure_mmHg"].between(self.lowest, self.highest)
        place = table.iloc[int(table["circumference"].argmin())]
        wanted = f"{self.lowest:g} to {self.highest:g}"
        if math.isinf(self.highest):
            wanted = f"{self.lowest:g} and more"
        reached = f"{place['pressure_mmHg']:.3g} ± {place['error_mmHg']:.2g} mmHg"
        kpa = f"{place['pressure']:.3g} kPa"
        return f"{reached} ({kpa}) at the narrowest place; {self.source}: {wanted} mmHg"


def compression_class(name: str) -> CompressionClass:
    """A class by its name; InputError names those that there are."""
    classes = read_toml(shipped("params") / "compression.toml")
    if name not in classes:
        raise invalid("compression_class", unknown(name, classes, "class of compression"))
    return CompressionClass(**classes[name])
