"""A case: one design under one protocol."""

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields, replace
from functools import cache, cached_property
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import numpy as np
from pydantic import BeforeValidator, TypeAdapter

from knitlab.model.cell_grid import CellGrid, central
from knitlab.model.contact_layers import ContactLayers, contact_layers
from knitlab.model.electrodes import Capacitor, Electrodes, StitchCounts, place_electrodes
from knitlab.model.network import MeshShape, Network, Spans, mesh_shape
from knitlab.model.pattern import CELLS_PER_PERIOD, Grading, PatchGrid, SingleFold, graded_pattern
from knitlab.model.settings import NO_FRICTION, Friction, ModelOptions, PlainKnit, Sheet
from knitlab.model.stitches import Stitches
from knitlab.model.stripe import Stripe
from knitlab.solvers.dynamics.settings import Dynamics
from knitlab.solvers.equilibrium.settings import Solver
from knitlab.solvers.loads import WARP, load_of
from knitlab.solvers.loads.load import Load

if TYPE_CHECKING:  # these import JAX
    from knitlab.model.fabric import Fabric
    from knitlab.model.inertia import Inertia
    from knitlab.model.layout import FabricLayout
    from knitlab.model.stripe_numbers import StripePair
    from knitlab.solvers.equilibrium.contact_barrier import Barrier

Label = int | float | str
Name = TypeVar("Name")
Given = TypeVar("Given")

OF_CONTACT = ("thickness", "contact_pressure")  # numbers of the sheet that only contact uses


@dataclass(frozen=True)
class Case:
    """One design under one protocol: all that can change its numbers, and nothing else."""

    design: dict[str, Label]  # by dimension of the cube
    # Of the rib and garter patches, equal if pure; if graded, those that ``grading`` varies.
    weft: Stripe
    warp: Stripe
    sheet: Sheet
    options: ModelOptions
    pattern: tuple[str, ...]  # patch map of a unit cell, top course first
    periods: int  # of a stripe, that fill a patch: P
    unit_cells: tuple[int, int]  # of the sample, along (y, x)
    applied_strain: tuple[float, ...]  # ascending from 0
    method: str  # of METHODS
    solver: Solver | None  # None if the test does not use it
    dynamics: Dynamics | None = None  # the same
    sensitivities: bool = False
    unloading: bool = False
    capacitor: Capacitor | None = None
    robustness: int = 0  # number of perturbed copies
    grading: Grading | None = None
    folds: tuple[SingleFold, ...] = ()
    cell_patches: tuple[int, int] | None = None  # of a unit cell (y, x), if not the whole pattern
    plain: PlainKnit | None = None
    load: Annotated[Load, BeforeValidator(load_of)] = WARP
    friction: Friction = NO_FRICTION
    lengths_ratio: float = 1.0  # lengths of its network over those of walls and thickness
    cycle: int = 1  # between zero and the largest strain, that is measured
    spans: Spans | None = None  # of a shaped piece

    def __repr__(self) -> str:
        return f"<Case {self.label}: {len(self.applied_strain)} strains by {self.method}>"

    def __getstate__(self) -> dict[str, Any]:
        """Its fields, without what is cached beside them."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @cached_property
    def record(self) -> dict[str, Any]:
        """The case as JSON holds it; :func:`case_of` reads it."""
        return self._fields()

    @cached_property
    def case_id(self) -> str:
        """Identifier: the design, and a hash of all that differs from its default in code.

        So a field that is added later keeps every identifier, and a default in code never changes.
        What users get is the value in ``params/``.
        """
        differing = self._fields(exclude_defaults=True)
        return "-".join([*map(str, self.design.values()), _digest(differing)[:12]])

    def _fields(self, *, exclude_defaults: bool = False) -> dict[str, Any]:
        """Its fields and those of its tables, without numbers that its model does not use."""
        # Much faster than dataclasses.asdict; mypy takes the hash of an instance for its class's.
        schema = _schema(type(self))  # type: ignore[arg-type]
        fields: dict[str, Any] = schema.dump_python(self, exclude_defaults=exclude_defaults)
        for table, name in self._unused():
            if fields.get(table):
                fields[table].pop(name, None)
                if not fields[table]:
                    del fields[table]
        return fields

    def _unused(self) -> Iterator[tuple[str, str]]:
        if self.options.cells_per_period == CELLS_PER_PERIOD:
            yield "options", "ridge_fraction"
        if self.options.contact == "none":
            yield from (("sheet", name) for name in OF_CONTACT)
        if not (self.sheet.cloth_stitch_width or self.sheet.cloth_stitch_height):
            yield from (("sheet", name) for name in ("cloth_stitch_width", "cloth_stitch_height"))
        if not self.friction.fold_friction:
            yield from (("friction", name) for name in ("fold_slide", "fold_hardening"))
        if self.capacitor is not None and self.capacitor.ground == "none":
            yield "capacitor", "ground_distance"
        if self.dynamics is not None:
            by_steps = self.dynamics.ending == "steps"
            unused = ("relax_time", "strain_rate") if by_steps else ("relax_steps", "step_strain")
            yield from (("dynamics", name) for name in unused)

    @cached_property
    def test_id(self) -> str:
        """Identifier of its tests, on which neither the design's labels nor electrodes act."""
        labels = ("design", "capacitor")
        return _digest({key: value for key, value in self.record.items() if key not in labels})

    @property
    def states(self) -> int:
        """States of its tests, those of its perturbed copies included."""
        return len(self.applied_strain) * (1 + self.robustness)

    @property
    def label(self) -> str:
        """The design in words."""
        return "  ".join(f"{name} {value}" for name, value in self.design.items())

    @cached_property
    def sample(self) -> PatchGrid:
        """The whole sample: the patch map repeated."""
        return graded_pattern(
            self.pattern,
            self.periods,
            self.unit_cells,
            self.grading,
            self.folds,
            self.options.cells_per_period,
        )

    @cached_property
    def mesh_shape(self) -> MeshShape:
        """Its mesh shape; cases that share it can be one batch."""
        return mesh_shape(self.sample, self.options.boundary, self.spans)

    @cached_property
    def cell_grid(self) -> CellGrid:
        """Its unit cells on the grid: whole patterns, or blocks of ``cell_patches``."""
        sample = self.sample
        height, width = self.cell_patches or (len(self.pattern), len(self.pattern[0]))
        rows, columns = sample.row_borders[::height], sample.column_borders[::width]
        return CellGrid(tuple(rows.tolist()), tuple(columns.tolist()))

    def _per_central_cell(self, of_rows: Any, of_columns: Any) -> tuple[float, float]:
        """Mean over the central unit cells of sums over their rows, and over their columns."""

        def mean(lines: tuple[int, ...], values: Any) -> float:
            cells = central(len(lines) - 1)
            total = float(values[lines[cells.start] : lines[cells.stop]].sum())
            return total / (cells.stop - cells.start)

        return mean(self.cell_grid.rows, of_rows), mean(self.cell_grid.columns, of_columns)

    @property
    def flat_cell(self) -> tuple[float, float]:
        """Mean flat sides (x, y) of the central unit cells [mm]."""
        _, fabric = self.assemble()
        height, width = self._per_central_cell(fabric.cell_y, fabric.cell_x)
        return width, height

    @property
    def stitches(self) -> Stitches:
        """Its stitches: in the central unit cells, and in the whole fabric."""
        courses, wales = self.stitches_per_cell
        in_cell = self._per_central_cell(courses, wales)
        return Stitches(*in_cell, courses=float(courses.sum()), wales=float(wales.sum()))

    @property
    def _stripes(self) -> tuple[tuple[Stripe, ...], tuple[Stripe, ...]]:
        if self.grading is None:
            return (self.weft,), (self.warp,)
        return self.grading.weft, self.grading.warp

    @property
    def stripes(self) -> tuple[Stripe, ...]:
        """Its stripes, of both knits."""
        weft, warp = self._stripes
        return *weft, *warp

    @property
    def stripe_pair(self) -> "StripePair":
        """The numbers of its stripes: of each knit one, or several along an axis."""
        from knitlab.model.stripe_numbers import StripePair

        return StripePair.of(*self._stripes)

    def with_stripes(
        self, rib: Callable[[Stripe], Stripe], garter: Callable[[Stripe], Stripe]
    ) -> "Case":
        """The case with every rib and every garter stripe changed; a pure stripe by ``rib``."""
        grading = self.grading
        if grading is not None:
            grading = replace(
                grading,
                row_stripes=tuple(map(garter, grading.row_stripes)),
                column_stripes=tuple(map(rib, grading.column_stripes)),
            )
        warp = rib(self.warp) if self.pure else garter(self.warp)
        return replace(self, weft=rib(self.weft), warp=warp, grading=grading)

    @property
    def pure(self) -> bool:
        """Whether it is one stripe, corrugated in a single direction."""
        return self.weft == self.warp

    @property
    def all_corners_held(self) -> bool:
        """Whether every corner of a unit cell lies on a clamp: then none can move across."""
        clamped = self.options.boundary == "clamped"
        return clamped and self.load.holds_every_corner(self.cell_grid)

    @property
    def periodic_cell(self) -> "Case":
        """One unit cell of the same fabric, periodic: a clamped sample starts as a tiling of it."""
        periodic = replace(self.options, boundary="periodic")
        return replace(self, unit_cells=(1, 1), options=periodic, spans=None).without_unused()

    @property
    def electrodes(self) -> Electrodes:
        """What is plated on it; BadLayout if the fabric cannot carry it."""
        return place_electrodes(
            self.given_capacitor.layout, self.sample, self.options, self.stitches_per_cell
        )

    @property
    def given_capacitor(self) -> Capacitor:
        """The capacitor plated on it; a TypeError if it has none."""
        return self._given(self.capacitor, "capacitor")

    def _given(self, value: Given | None, name: str) -> Given:
        if value is None:
            raise TypeError(f"case {self.case_id} has no {name}")
        return value

    @property
    def stitches_per_cell(self) -> StitchCounts:
        """Courses in every row of grid cells, and wales in every column."""
        sample, (weft, warp) = self.sample, self._stripes
        cells_per_stripe = sample.cells_per_period / 2
        courses = np.array([stripe.n for stripe in warp])[sample.row_stripe[sample.patch_of_row]]
        wales = np.array([stripe.n for stripe in weft])
        wales = wales[sample.column_stripe[sample.patch_of_column]]
        return courses / cells_per_stripe, wales / cells_per_stripe

    @property
    def equilibrium_solver(self) -> Solver:
        """Settings of the equilibrium solver; a TypeError if it is solved by dynamics."""
        return self._given(self.solver, "settings of the equilibrium solver")

    @property
    def motion(self) -> Dynamics:
        """Settings of the dynamics; a TypeError if nothing of it moves in time."""
        return self._given(self.dynamics, "settings of the dynamics")

    @property
    def relaxes_by_dynamics(self) -> bool:
        """Whether its relaxation is a motion in time."""
        if self.solver is None:
            return True
        return self.options.boundary == "clamped" and self.solver.start == "dynamics"

    def without_unused(self) -> "Case":
        """The case without settings that it does not use: of dynamics, or of contact."""
        case = self if self.relaxes_by_dynamics else replace(self, dynamics=None)
        if case.options.contact == "none":
            unused = {name: getattr(Sheet, name) for name in OF_CONTACT}
            case = replace(case, sheet=replace(self.sheet, **unused))
        return case

    @property
    def layout(self) -> "FabricLayout":
        """Its fabric but for the numbers of its stripes."""
        from knitlab.model.layout import fabric_layout

        sheet = self.sheet_of_network
        if self.options.contact != "none":
            # The gap between the walls that is left to the middle surface.
            sheet = replace(sheet, z_max=sheet.z_max - sheet.thickness / 2)
        return fabric_layout(self.sample, sheet, self.options, self.plain, self.spans)

    @property
    def sheet_of_network(self) -> Sheet:
        """Its walls and thickness in the lengths of its network."""
        return self.sheet.on_network(self.lengths_ratio)

    @property
    def contact_layers(self) -> ContactLayers:
        """How far its parts keep apart, if it has contact."""
        _, fabric = self.assemble()
        cell = float(np.mean(fabric.cell_x)), float(np.mean(fabric.cell_y))
        sheet, refinement = self.sheet_of_network, self.options.cells_per_period
        return contact_layers(sheet.thickness, sheet.contact_pressure, cell, refinement)

    @property
    def contact(self) -> "Barrier | None":
        """Its contact with itself; ``None`` if it may pass through itself."""
        if self.options.contact == "none":
            return None
        from knitlab.solvers.equilibrium.contact_barrier import Barrier  # seconds to import

        return Barrier(self.mesh_shape, self.contact_layers)

    def assemble(self) -> "tuple[Network, Fabric]":
        """Its network, and its fabric: the numbers on that."""
        layout = self.layout
        return layout.net, layout.fabric(self.stripe_pair)

    def inertia(self) -> "Inertia":
        """Its mass and drag; a TypeError if nothing of it moves in time."""
        from knitlab.model.inertia import inertia

        density, ratio = self.motion.surface_density, self.motion.damping_ratio
        sample = None if self.grading is None else self.sample
        return inertia(*self._stripes, self.options, density, ratio, sample)


def by_test(named: Iterable[tuple[Name, Case]]) -> list[list[Name]]:
    """Names of cases, grouped by the tests that cases share which differ in electrodes alone."""
    sharing: dict[str, list[Name]] = {}
    for name, case in named:
        sharing.setdefault(case.test_id, []).append(name)
    return list(sharing.values())


def _digest(record: dict[str, Any]) -> str:
    canonical = json.dumps(record, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(canonical.encode()).hexdigest()


def case_of(record: dict[str, Any]) -> Case:
    """The case that a record describes; ValidationError if it is of another version."""
    case: Case = _schema(Case).validate_python(record)
    return case


@cache
def _schema(kind: type[Any]) -> TypeAdapter[Any]:
    return TypeAdapter(kind)  # slow to make
