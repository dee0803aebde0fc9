"""The plan: everything that a run needs, resolved once and stored in ``plan.json``."""

import itertools
import json
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from knitlab.cube.common_settings import common_settings
from knitlab.cube.schema import Variable
from knitlab.io.atomic_write import atomic_write
from knitlab.io.errors import BadInput, ErrorCollector, Fault
from knitlab.io.fingerprint import (
    code_fingerprint,
    digests,
    package_fingerprint,
    text_fingerprint,
)
from knitlab.io.shipped import shipped
from knitlab.measure.knit_size import Gauge
from knitlab.simulation.case import Case, by_test
from knitlab.sweep.axes import SweepAxis
from knitlab.sweep.cases import (
    cases,
    electrode_problems,
    overridden,
    pattern_inputs,
    stripe_files,
    with_pattern_files,
    with_stripe_files,
)
from knitlab.sweep.design_space import Design, DesignSpace, design_space, stripe_space
from knitlab.sweep.estimate import bytes_needed, seconds
from knitlab.sweep.overrides import Overrides, as_text
from knitlab.sweep.parameters import Parameters, read_parameters
from knitlab.sweep.settings import SETTINGS
from knitlab.sweep.unusual import unusual_values
from knitlab.sweep.workflow import CHANGES, SPRING_LAW_CHANGES, Workflow
from knitlab.sweep.workflow_file import workflow_file
from knitlab.sweep.workflow_text import WorkflowText, read_workflow

# Unknowns that one vmapped batch may hold: about 1 GiB of element Hessians.
BATCH_UNKNOWNS = 8_000


@dataclass(frozen=True)
class Batch:
    """Cases that one worker simulates together, by one vmapped program.

    Attributes:
        cases: their identifiers.
        unknowns: number of unknowns of all of them.
        estimated_seconds: their time on one core [s].
        estimated_bytes: memory of their worker [bytes].
    """

    cases: tuple[str, ...]
    unknowns: int
    estimated_seconds: float
    estimated_bytes: float


@dataclass(frozen=True)
class Plan:
    """A workflow, resolved.

    Attributes:
        workflow: its name.
        title: its title.
        figures: the figures that it draws.
        cases: the cases to simulate, by identifier.
        batches: the cases by mesh shape, as many together as memory allows.
        excluded: impossible designs of the grid, with the reason.
        coordinates: coordinates of the settings that are given as lists.
        overrides: the ``KEY=VALUE`` overrides.
        inputs: SHA-256 of every file that the plan was made from, by path.
        stripes: fingerprint of the stripe tables, with the changes that all cases share.
        gauge: size of a stitch, for the cube's sizes in cloth; no case depends on it.
        warnings: values that may be mistakes.
    """

    workflow: str
    title: str
    figures: tuple[str, ...]
    cases: dict[str, Case]
    batches: tuple[Batch, ...]
    excluded: dict[Design, str]
    coordinates: dict[str, Variable]
    overrides: tuple[str, ...]
    inputs: dict[str, str]
    stripes: str
    gauge: Gauge
    warnings: tuple[str, ...] = ()

    def __repr__(self) -> str:
        counts = f"{len(self.cases)} cases in {len(self.batches)} batches"
        return f"<Plan {self.workflow}: {counts}, {len(self.excluded)} designs excluded>"

    @property
    def dims(self) -> tuple[str, ...]:
        """Dimensions of the cube along which its designs are ordered."""
        return tuple(next(iter(self.cases.values())).design)

    @property
    def designs(self) -> dict[str, Design]:
        """Labels of the cases, by identifier."""
        return {case_id: tuple(case.design.values()) for case_id, case in self.cases.items()}

    @cached_property
    def common(self) -> dict[str, Any]:
        """The settings that all cases share."""
        settings = [SETTINGS[dim] for dim in self.coordinates]
        swept = {*self.dims, *(setting.factor_on for setting in settings if setting.factor_on)}
        return common_settings([case.record for case in self.cases.values()], swept, self.stripes)

    @property
    def applied_strain(self) -> tuple[float, ...]:
        """Strains of the protocol, the same for every case."""
        return next(iter(self.cases.values())).applied_strain

    def record(self) -> dict[str, Any]:
        """The plan as a JSON object."""
        return {
            "workflow": self.workflow,
            "title": self.title,
            "figures": self.figures,
            "dims": self.dims,
            "overrides": self.overrides,
            "inputs": self.inputs,
            "code": code_fingerprint(),
            "package": package_fingerprint(),
            "gauge": asdict(self.gauge),
            "stripes": self.stripes,
            "parameters": self.common,
            "batches": [asdict(batch) for batch in self.batches],
            "excluded": [[*design, reason] for design, reason in self.excluded.items()],
            "cases": {case_id: case.record for case_id, case in self.cases.items()},
        }

    def write(self, path: Path) -> None:
        """Write the plan into a JSON file, one line for each case.

        Raises:
            CannotWrite: if it cannot be written.
        """
        record = self.record()
        cases = record.pop("cases").items()
        lines = (f"  {json.dumps(case_id)}: {json.dumps(case)}" for case_id, case in cases)
        head = json.dumps(record, indent=1).removesuffix("\n}")
        with atomic_write(path) as temporary:
            temporary.write_text(f'{head},\n "cases": {{\n' + ",\n".join(lines) + "\n }\n}\n")


def make_plan(
    workflow: str, overrides: Overrides = (), parameter_folder: Path | None = None
) -> Plan:
    """Resolve a workflow, its overrides and the parameters into a plan.

    Args:
        workflow: name of a shipped workflow, or path of a file of the same form.
        overrides: settings that replace the workflow's, as ``KEY=VALUE`` text or as Python values
            by their names, such as ``{"n_stripe": 4, "k_t_factor": [0.8, 1.0]}``.
        parameter_folder: folder of the parameter files; by default knitlab's own.

    Raises:
        BadInput: with every fault of every file and override.
    """
    text = read_workflow(workflow_file(workflow), overrides)
    folder = parameter_folder or shipped("params")
    faults = ErrorCollector()
    parameters = shipped_parameters = read = None
    axes: tuple[SweepAxis, ...] = ()
    space = DesignSpace((), {})
    made: dict[str, Case] = {}
    inputs = [text.path, *folder.glob("*.toml")]
    with faults:
        parameters = shipped_parameters = read_parameters(folder)
    with faults:
        read = text.checked()
    with faults:
        axes = text.checked_axes()
    with faults:
        if parameters and (model := text.section("model")):
            parameters = with_stripe_files(model, parameters, text)
            inputs += stripe_files(model, text)
    with faults:
        if parameters and (design := text.section("design")):
            parameters = with_pattern_files(design, parameters, text)
            inputs += pattern_inputs(design, parameters, text)
            space = design_space(design, parameters, text.source)
    with faults:
        if parameters and (stripes := text.section("stripes")):
            space = stripe_space(stripes, parameters, text.source)
    with faults:
        if parameters and read and not faults.all:
            made = {
                case.case_id: case for case in cases(read, axes, space, parameters, text.source)
            }
            faults.all += _misplaced_electrodes(made, text)
    if parameters is None or shipped_parameters is None or read is None or faults.all:
        raise BadInput(faults.all)
    return Plan(
        workflow=text.path.stem,
        title=read.title,
        figures=read.figures,
        cases=made,
        batches=batched(made),
        excluded=space.excluded,
        coordinates={axis.name: axis.coordinate for axis in axes},
        overrides=as_text(overrides),
        inputs=digests(inputs),
        stripes=_stripes_fingerprint(parameters, read, axes),
        gauge=overridden(parameters.gauge, read.gauge),
        warnings=(*unusual_values(made.values(), shipped_parameters), *_left_out(read)),
    )


def _left_out(read: Workflow) -> Iterator[str]:
    """Settings of a workflow that its method ignores."""
    protocol = read.protocol
    if protocol.robustness and protocol.method != "equilibrium":
        siblings = "siblings are tested in equilibrium only"
        yield f"robustness = {protocol.robustness} is ignored by {protocol.method}: {siblings}"


def _misplaced_electrodes(made: dict[str, Case], text: WorkflowText) -> list[Fault]:
    """Faults of the electrodes of cases; one fault for all designs that have it."""
    designs: dict[str, list[str]] = defaultdict(list)
    for case in made.values():
        for problem in electrode_problems(case):
            designs[problem].append(case.label)
    given = text.table.get("electrodes", {})
    source = text.source(f"electrodes.{'mask' if 'mask' in given else 'layout'}")
    return [
        Fault(source, f"{problem} (in {found[0]}{' and others' if len(found) > 1 else ''})")
        for problem, found in designs.items()
    ]


def _stripes_fingerprint(
    parameters: Parameters, read: Workflow, axes: tuple[SweepAxis, ...]
) -> str:
    swept = {axis.name for axis in axes}
    changes = read.model.model_dump(include=set(CHANGES) - swept)
    # For linear springs the fingerprint is that of a version without other laws.
    changes = {
        name: value
        for name, value in changes.items()
        if value is not None or name not in SPRING_LAW_CHANGES
    }
    tables = parameters.stripes.model_dump(exclude_none=True)
    return text_fingerprint(json.dumps([tables, changes]))


def batched(cases: dict[str, Case]) -> tuple[Batch, ...]:
    """Batches of cases that can be stacked, as large as memory allows, the longest first."""
    alike: dict[tuple[Any, ...], list[str]] = defaultdict(list)
    for case_id, case in cases.items():
        dynamics = case.dynamics
        if dynamics is not None:
            # Mass and damping are numbers of each fabric in a batch.
            dynamics = replace(dynamics, damping_ratio=0.0, surface_density=1.0)
        key = case.mesh_shape, case.options.fold_angle, case.spring_kinds, dynamics
        alike[key].append(case_id)
    batches = []
    for (shape, *_), members in alike.items():
        size = max(1, BATCH_UNKNOWNS // shape.unknowns)
        sharing = by_test((case_id, cases[case_id]) for case_id in members)
        for first in range(0, len(sharing), size):
            together = itertools.chain.from_iterable(sharing[first : first + size])
            batches.append(batch_of(tuple(together), cases))
    return tuple(sorted(batches, key=lambda batch: batch.estimated_seconds, reverse=True))


def batch_of(members: Sequence[str], cases: Mapping[str, Case]) -> Batch:
    """The batch of some cases that share a mesh shape."""
    # Cases that share a test take the time and the memory of one.
    sharing = by_test((case_id, cases[case_id]) for case_id in members)
    unknowns = cases[members[0]].mesh_shape.unknowns * len(sharing)
    time = seconds(cases[those[0]] for those in sharing)
    return Batch(tuple(members), unknowns, time, bytes_needed(unknowns, cases[members[0]].method))
