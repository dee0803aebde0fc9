"""A case: one design under one protocol."""

import hashlib
import json
from dataclasses import asdict, dataclass
from typing import Literal

import numpy as np

from knitlab.mechanics.dynamics import DynamicsSettings
from knitlab.mechanics.newton import SolverSettings
from knitlab.model.fabric import Fabric, Sheet, weave
from knitlab.model.inertia import MassAndDrag
from knitlab.model.network import MeshShape, Network, mesh_shape
from knitlab.model.pattern import Pattern, patch_map
from knitlab.model.reading import Reading
from knitlab.model.stripe import Stripe

Method = Literal["equilibrium", "dynamics"]
Label = int | str


@dataclass(frozen=True)
class Case:
    """One design under one protocol: all that can change its numbers, and nothing else.

    Attributes:
        design: its labels, by the dimension of the cube that they lie along.
        weft, warp: the stripe of its rib and of its garter patches; one stripe is both if pure.
        sheet: the walls.
        mass_and_drag: what makes it move; ``None`` where the method knows no time.
        reading: the model's open choices.
        pattern: patch map of a unit cell, top course first.
        periods: periods of a stripe that fill a patch, P.
        unit_cells: unit cells of the sample along (y, x).
        applied_strain: strains of the tensile test, ascending from 0.
        method: how its states are reached.
        solver: settings of that method.
    """

    design: dict[str, Label]
    weft: Stripe
    warp: Stripe
    sheet: Sheet
    mass_and_drag: MassAndDrag | None
    reading: Reading
    pattern: tuple[str, ...]
    periods: int
    unit_cells: tuple[int, int]
    applied_strain: tuple[float, ...]
    method: Method
    solver: SolverSettings | DynamicsSettings

    @property
    def case_id(self) -> str:
        """Identifier: the design, and a hash of the canonical JSON of this case."""
        canonical = json.dumps(asdict(self), sort_keys=True, separators=(",", ":"))
        digest = hashlib.sha256(canonical.encode()).hexdigest()
        return "-".join([*map(str, self.design.values()), digest[:12]])

    @property
    def label(self) -> str:
        """The design in words."""
        return "  ".join(f"{name} {value}" for name, value in self.design.items())

    @property
    def sample(self) -> Pattern:
        """The whole sample: the unit cell's patch map repeated."""
        tile = patch_map(self.pattern, self.periods)
        return Pattern(np.tile(tile.rib, self.unit_cells), self.periods)

    @property
    def mesh_shape(self) -> MeshShape:
        """Its mesh shape; cases of one plan that share it can be one batch."""
        return mesh_shape(self.sample, self.reading.boundary)

    @property
    def pure(self) -> bool:
        """Whether it is one stripe, corrugated in a single direction."""
        return self.weft == self.warp

    def woven(self) -> tuple[Network, Fabric]:
        """Its network and fabric."""
        return weave(self.sample, self.weft, self.warp, self.sheet, self.reading)
