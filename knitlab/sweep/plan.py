"""The plan: everything a run needs, resolved once and frozen into ``plan.json``."""

import hashlib
import json
from collections import defaultdict
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from knitlab.mechanics.newton import SolverSettings
from knitlab.model.fabric import Sheet
from knitlab.model.network import MeshShape, mesh_shape
from knitlab.model.pattern import Pattern, patch_map
from knitlab.model.reading import Reading
from knitlab.model.stripe import GARTER_STITCHES_PER_RIB_STITCH, Knit, Stripe, periods_per_patch
from knitlab.sweep.design_space import DesignSpace, design_space
from knitlab.sweep.faults import BadInput, Gathered
from knitlab.sweep.files import written_whole
from knitlab.sweep.parameters import Parameters, Strict, StripeTable, read_parameters
from knitlab.sweep.shipped import shipped
from knitlab.sweep.workflow import Workflow
from knitlab.sweep.workflow_text import read_workflow, workflow_file

# Unknowns that one vmapped batch may hold: about 1 GiB of element Hessians.
BATCH_UNKNOWNS = 8_000


@dataclass(frozen=True)
class Case:
    """One design under one protocol: all that can change its numbers, and nothing else.

    Attributes:
        n_stripe, n_subunit: the design.
        rib, garter: its stripes.
        sheet: walls, mass and damping.
        reading: the model's open choices.
        pattern: patch map of a unit cell, top course first.
        unit_cells: unit cells of the sample along (y, x).
        applied_strain: strains of the tensile test, ascending from 0.
        solver: how equilibria are searched for.
    """

    n_stripe: int
    n_subunit: int
    rib: Stripe
    garter: Stripe
    sheet: Sheet
    reading: Reading
    pattern: tuple[str, ...]
    unit_cells: tuple[int, int]
    applied_strain: tuple[float, ...]
    solver: SolverSettings

    @property
    def case_id(self) -> str:
        """Identifier: the design, and a hash of the canonical JSON of this case."""
        canonical = json.dumps(asdict(self), sort_keys=True, separators=(",", ":"))
        digest = hashlib.sha256(canonical.encode()).hexdigest()
        return f"{self.n_stripe}-{self.n_subunit}-{digest[:12]}"

    @property
    def periods(self) -> int:
        """Periods of a stripe that fill a patch, P."""
        return periods_per_patch(self.n_stripe, self.n_subunit)

    @property
    def sample(self) -> Pattern:
        """The whole sample: the unit cell's patch map repeated."""
        tile = patch_map(self.pattern, self.periods)
        return Pattern(np.tile(tile.rib, self.unit_cells), self.periods)

    @property
    def mesh_shape(self) -> MeshShape:
        """Its mesh shape; cases that share it can be one batch."""
        return mesh_shape(self.sample, self.reading.boundary)


@dataclass(frozen=True)
class Plan:
    """A workflow, resolved.

    Attributes:
        workflow: its name.
        title: its title.
        figures: the figures that it draws.
        cases: what to simulate, by identifier.
        batches: identifiers of the cases of each batch; a batch shares one mesh shape.
        excluded: (n_stripe, n_subunit) of the grid that no fabric can have, with the reason.
    """

    workflow: str
    title: str
    figures: tuple[str, ...]
    cases: dict[str, Case]
    batches: tuple[tuple[str, ...], ...]
    excluded: dict[tuple[int, int], str]

    @property
    def applied_strain(self) -> tuple[float, ...]:
        """Strains of the protocol, the same for every case."""
        return next(iter(self.cases.values())).applied_strain

    def record(self) -> dict[str, Any]:
        """The plan as JSON holds it."""
        return {
            "workflow": self.workflow,
            "title": self.title,
            "figures": self.figures,
            "batches": self.batches,
            "excluded": [[*design, reason] for design, reason in self.excluded.items()],
            "cases": {case_id: asdict(case) for case_id, case in self.cases.items()},
        }

    def write(self, path: Path) -> None:
        """Freeze the plan into a JSON file."""
        with written_whole(path) as temporary:
            temporary.write_text(json.dumps(self.record(), indent=1) + "\n", encoding="utf-8")


def make_plan(
    workflow: str, overrides: tuple[str, ...] = (), parameter_folder: Path | None = None
) -> Plan:
    """Resolve a workflow, its overrides and the parameters into a plan.

    Args:
        workflow: name of a shipped workflow, or path of a file of the same form.
        overrides: ``KEY=VALUE`` settings that replace the workflow's.
        parameter_folder: where the parameter files lie; by default knitlab's own.

    Raises:
        BadInput: with every fault of every file and override.
    """
    text = read_workflow(workflow_file(workflow), overrides)
    faults = Gathered()
    parameters = read = space = None
    with faults:
        parameters = read_parameters(parameter_folder or shipped("params"))
    with faults:
        read = text.checked()
    with faults:
        if parameters and (section := text.design()):
            space = design_space(section, parameters, text.source)
    if parameters is None or read is None or space is None:
        raise BadInput(faults.all)
    cases = _cases(read, space, parameters)
    name = text.path.stem
    return Plan(name, read.title, read.figures, cases, _batches(cases), space.excluded)


def _cases(workflow: Workflow, space: DesignSpace, parameters: Parameters) -> dict[str, Case]:
    sheet = _merged(parameters.sheet, workflow.model)
    reading = _merged(parameters.reading, workflow.model)
    solver = _merged(parameters.solver, workflow.solver)
    protocol = workflow.protocol
    steps = round(protocol.strain_max / protocol.strain_step)
    applied_strain = tuple(round(step * protocol.strain_step, 12) for step in range(steps + 1))
    cases = (
        Case(
            n_stripe=n_stripe,
            n_subunit=n_subunit,
            rib=_stripe("rib", n_stripe, parameters.stripes.rib),
            garter=_stripe(
                "garter", GARTER_STITCHES_PER_RIB_STITCH * n_stripe, parameters.stripes.garter
            ),
            sheet=Sheet(**sheet),
            reading=Reading(**reading),
            pattern=workflow.design.pattern,
            unit_cells=workflow.design.unit_cells,
            applied_strain=applied_strain,
            solver=SolverSettings(**solver),
        )
        for n_stripe, n_subunit in space.designs
    )
    return {case.case_id: case for case in cases}


def _merged(parameters: Strict, section: Strict) -> dict[str, Any]:
    """Values of a parameter file, each replaced where the workflow's section has one."""
    given = section.model_dump(exclude_none=True)
    return {
        key: given.get(key, getattr(parameters, key).value) for key in type(parameters).model_fields
    }


def _stripe(knit: Knit, stitches: int, table: StripeTable) -> Stripe:
    return Stripe(knit=knit, n=stitches, **table.n[str(stitches)].model_dump())


def _batches(cases: dict[str, Case]) -> tuple[tuple[str, ...], ...]:
    """Cases of one mesh shape together, as many as fit, the longest batches first."""
    by_shape: dict[MeshShape, list[str]] = defaultdict(list)
    for case_id, case in cases.items():
        by_shape[case.mesh_shape].append(case_id)
    batches: list[tuple[int, tuple[str, ...]]] = []
    for shape, members in by_shape.items():
        size = max(1, BATCH_UNKNOWNS // shape.unknowns)
        for first in range(0, len(members), size):
            batch = tuple(members[first : first + size])
            batches.append((shape.unknowns * len(batch), batch))
    return tuple(batch for _, batch in sorted(batches, reverse=True))
