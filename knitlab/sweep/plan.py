"""The plan: everything a run needs, resolved once and frozen into ``plan.json``."""

import json
from collections import defaultdict
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from knitlab.model.network import MeshShape
from knitlab.sweep.case import Case
from knitlab.sweep.cases import cases, with_stripe_files
from knitlab.sweep.design_space import Design, DesignSpace, design_space, stripe_space
from knitlab.sweep.faults import BadInput, Gathered
from knitlab.sweep.files import written_whole
from knitlab.sweep.parameters import read_parameters
from knitlab.sweep.shipped import shipped
from knitlab.sweep.workflow_text import read_workflow, workflow_file

# Unknowns that one vmapped batch may hold: about 1 GiB of element Hessians.
BATCH_UNKNOWNS = 8_000


@dataclass(frozen=True)
class Plan:
    """A workflow, resolved.

    Attributes:
        workflow: its name.
        title: its title.
        figures: the figures that it draws.
        cases: what to simulate, by identifier.
        batches: identifiers of the cases of each batch; a batch shares one mesh shape.
        excluded: designs of the grid that no fabric can have, with the reason.
    """

    workflow: str
    title: str
    figures: tuple[str, ...]
    cases: dict[str, Case]
    batches: tuple[tuple[str, ...], ...]
    excluded: dict[Design, str]

    @property
    def dims(self) -> tuple[str, ...]:
        """Dimensions of the cube that its designs lie along."""
        return tuple(next(iter(self.cases.values())).design)

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
    parameters = read = None
    space = DesignSpace((), {})
    with faults:
        parameters = read_parameters(parameter_folder or shipped("params"))
    with faults:
        read = text.checked()
    with faults:
        if parameters and (model := text.section("model")):
            parameters = with_stripe_files(model, parameters, text)
    with faults:
        if parameters and (design := text.section("design")):
            space = design_space(design, parameters, text.source)
    with faults:
        if parameters and (stripes := text.section("stripes")):
            space = stripe_space(stripes, parameters, text.source)
    if parameters is None or read is None or faults.all:
        raise BadInput(faults.all)
    made = {case.case_id: case for case in cases(read, space, parameters)}
    name = text.path.stem
    return Plan(name, read.title, read.figures, made, _batches(made), space.excluded)


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
