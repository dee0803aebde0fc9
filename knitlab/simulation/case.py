"""A case: one design under one protocol."""

import hashlib
import json
from dataclasses import asdict, dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, Literal

import numpy as np
from pydantic import TypeAdapter

from knitlab.capacitance.capacitor import Capacitor
from knitlab.mechanics.dynamics import DynamicsSettings
from knitlab.mechanics.solver import SolverSettings
from knitlab.model.electrode_layout import CELLS_PER_STRIPE, place_electrodes
from knitlab.model.electrodes import Electrodes
from knitlab.model.fabric import Fabric, Sheet, assemble_fabric
from knitlab.model.inertia import MassAndDrag
from knitlab.model.network import MeshShape, Network, mesh_shape
from knitlab.model.options import Boundary, ModelOptions
from knitlab.model.pattern import Pattern, patch_map
from knitlab.model.stripe import SPRING_LAWS, Stripe

Method = Literal["equilibrium", "dynamics"]
Label = int | float | str


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
        sensitivities: whether derivatives of its results by the stripe parameters are computed.
        unloading: whether the fabric is let go again, through the same strains.
        capacitor: the electrodes on it, if any.
        robustness: siblings that are tested beside it, to see how far its results spread.
    """

    design: dict[str, Label]
    weft: Stripe
    warp: Stripe
    sheet: Sheet
    mass_and_drag: MassAndDrag | None
    reading: ModelOptions
    pattern: tuple[str, ...]
    periods: int
    unit_cells: tuple[int, int]
    applied_strain: tuple[float, ...]
    method: Method
    solver: SolverSettings | DynamicsSettings
    sensitivities: bool = False
    unloading: bool = False
    capacitor: Capacitor | None = None
    robustness: int = 0

    @cached_property
    def record(self) -> dict[str, Any]:
        """The case as JSON holds it; :func:`case_of` reads it.

        Without siblings robustness is left out, and so is the law of linear springs: the identifier
        is that of a version without them.
        """
        record = asdict(self)
        for stripe in (record["weft"], record["warp"]):
            for name in SPRING_LAWS:
                if stripe[name] is None:
                    del stripe[name]
        if not self.robustness:
            del record["robustness"]
        return record

    @cached_property
    def case_id(self) -> str:
        """Identifier: the design, and a hash of the canonical JSON of this case.

        Every field enters, so that one added later makes every case another.
        """
        canonical = json.dumps(self.record, sort_keys=True, separators=(",", ":"))
        digest = hashlib.sha256(canonical.encode()).hexdigest()
        return "-".join([*map(str, self.design.values()), digest[:12]])

    @property
    def states(self) -> int:
        """States that its tests have, those of its siblings included."""
        return len(self.applied_strain) * (1 + self.robustness)

    @property
    def label(self) -> str:
        """The design in words."""
        return "  ".join(f"{name} {value}" for name, value in self.design.items())

    @property
    def sample(self) -> Pattern:
        """The whole sample: the unit cell's patch map repeated."""
        return _sample(self.pattern, self.periods, self.unit_cells)

    @property
    def mesh_shape(self) -> MeshShape:
        """Its mesh shape; cases of one plan that share it can be one batch."""
        return _mesh_shape(self.pattern, self.periods, self.unit_cells, self.reading.boundary)

    @property
    def pure(self) -> bool:
        """Whether it is one stripe, corrugated in a single direction."""
        return self.weft == self.warp

    @property
    def all_corners_held(self) -> bool:
        """Whether every corner of a unit cell lies on a clamp: then none can move across."""
        return self.reading.boundary == "clamped" and self.unit_cells[0] == 1

    @property
    def periodic_cell(self) -> "Case":
        """One unit cell of the same fabric, periodic: a clamped sample starts as a tiling of it."""
        periodic = replace(self.reading, boundary="periodic")
        return replace(self, unit_cells=(1, 1), reading=periodic)

    @property
    def electrodes(self) -> Electrodes:
        """What is plated on it.

        Raises:
            BadLayout: if its layout is none that it can carry.
            TypeError: if it has no capacitor.
        """
        if self.capacitor is None:
            raise TypeError(f"case {self.case_id} has no capacitor")
        cells_per_stitch = self.weft.n / CELLS_PER_STRIPE, self.warp.n / CELLS_PER_STRIPE
        return place_electrodes(self.capacitor.layout, self.sample, self.reading, cells_per_stitch)

    @property
    def equilibrium_solver(self) -> SolverSettings:
        """Settings of the equilibrium solver.

        Raises:
            TypeError: if this case is solved by dynamics.
        """
        if not isinstance(self.solver, SolverSettings):
            raise TypeError(f"case {self.case_id} has no settings of the equilibrium solver")
        return self.solver

    def assemble(self) -> tuple[Network, Fabric]:
        """Its network, and its fabric: the numbers on that."""
        return assemble_fabric(self.sample, self.weft, self.warp, self.sheet, self.reading)


def case_of(record: dict[str, Any]) -> Case:
    """The case that its record, ``asdict(case)`` as JSON holds it, describes.

    Raises:
        ValidationError: if the record is not of a case of this version.
    """
    settings = DynamicsSettings if record["method"] == "dynamics" else SolverSettings
    # Left to itself, the union would take the first kind that all keys fit.
    solver = settings(**record["solver"])
    return replace(TypeAdapter(Case).validate_python(record), solver=solver)


@lru_cache(maxsize=256)
def _sample(pattern: tuple[str, ...], periods: int, unit_cells: tuple[int, int]) -> Pattern:
    return Pattern(np.tile(patch_map(pattern, periods).rib, unit_cells), periods)


@lru_cache(maxsize=256)
def _mesh_shape(
    pattern: tuple[str, ...], periods: int, unit_cells: tuple[int, int], boundary: Boundary
) -> MeshShape:
    return mesh_shape(_sample(pattern, periods, unit_cells), boundary)
