"""The plan: everything that a run needs, resolved once and stored in ``plan.json``."""

import json
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from knitlab.cube.common_settings import common_settings
from knitlab.cube.schema import Variable
from knitlab.io.atomic_write import atomic_write
from knitlab.io.errors import BadInput, ErrorCollector, Fault, fault
from knitlab.io.fingerprint import code_fingerprint, digests, package_fingerprint, text_fingerprint
from knitlab.io.shipped import shipped
from knitlab.measure.knit_size import Gauge
from knitlab.simulation.case import Case, case_of
from knitlab.sweep import workflow_text
from knitlab.sweep.batches import Batch, Shard, batched, split
from knitlab.sweep.cases import (
    Design,
    DesignSpace,
    cases,
    design_space,
    electrode_problems,
    overridden,
    stripe_space,
    unusual_values,
    with_pattern_files,
)
from knitlab.sweep.material import MATERIAL, with_material_file
from knitlab.sweep.parameters import Parameters, read_parameters
from knitlab.sweep.workflow import CHANGES, SETTINGS, SPRING_LAW_CHANGES, Workflow
from knitlab.sweep.workflow_file import Overrides, workflow_file
from knitlab.sweep.workflow_text import SweepAxis, WorkflowText


@dataclass(frozen=True)
class Plan:
    """A workflow, resolved into cases by their identifiers, and these into batches."""

    workflow: str
    title: str
    figures: tuple[str, ...]
    cases: dict[str, Case]
    batches: tuple[Batch, ...]
    excluded: dict[Design, str]  # impossible designs of the grid, with the reason
    coordinates: dict[str, Variable]  # of the settings that are given as lists
    overrides: dict[str, Any]  # values that replace the workflow's, by the name of their setting
    inputs: dict[str, str]  # SHA-256 of every file that the plan was made from, by path
    stripes: str  # fingerprint of the stripe tables, with the changes that all cases share
    gauge: Gauge  # size of a stitch, for the cube's sizes in cloth; no case depends on it
    material: str | None = None  # name of a material in place of the paper's yarn
    warnings: tuple[str, ...] = ()  # values that may be mistakes

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

    def part(self, shard: Shard) -> "Plan":
        """The part that one shard simulates; without cases if there are more shards than cases."""
        batches = split(self.batches, self.cases, shard.count)[shard.number - 1]
        wanted = {case_id for batch in batches for case_id in batch.cases}
        cases = {case_id: case for case_id, case in self.cases.items() if case_id in wanted}
        return replace(self, cases=cases, batches=batches)

    @cached_property
    def common(self) -> dict[str, Any]:
        """The settings that all cases share."""
        settings = [SETTINGS[dim] for dim in self.coordinates if dim in SETTINGS]
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
            "material": self.material,
            "parameters": self.common,
            "batches": [asdict(batch) for batch in self.batches],
            "excluded": [[*design, reason] for design, reason in self.excluded.items()],
            "cases": {case_id: case.record for case_id, case in self.cases.items()},
        }

    def write(self, path: Path) -> None:
        """Write the plan into a JSON file, one line for each case."""
        record = self.record()
        cases = record.pop("cases").items()
        lines = (f"  {json.dumps(case_id)}: {json.dumps(case)}" for case_id, case in cases)
        head = json.dumps(record, indent=1).removesuffix("\n}")
        with atomic_write(path) as temporary:
            temporary.write_text(f'{head},\n "cases": {{\n' + ",\n".join(lines) + "\n }\n}\n")


def make_plan(
    workflow: str, overrides: Overrides = (), parameter_folder: Path | None = None
) -> Plan:
    """The plan of a workflow, by name or file, with overrides; BadInput has every fault."""
    text = workflow_text.read_workflow(workflow_file(workflow), overrides)
    folder = parameter_folder or shipped("params")
    faults = ErrorCollector()
    parameters = read = None
    axes: tuple[SweepAxis, ...] = ()
    space = DesignSpace((), {})
    made: dict[str, Case] = {}
    inputs = [text.path, *folder.glob("*.toml")]
    with faults:
        parameters = read_parameters(folder)
    with faults:
        if parameters and (model := text.section("model")):
            if model.material is not None:
                inputs.append(text.folder(MATERIAL) / model.material)
                parameters, text = with_material_file(inputs[-1], parameters, text)
            if (interpolate := model.interpolate_stripes) is not None:
                stripes = parameters.stripes.model_copy(update={"interpolate": interpolate})
                parameters = replace(parameters, stripes=stripes)
    with faults:
        read, axes = text.checked()
    with faults:
        if parameters and (design := text.section("design")):
            parameters, files = with_pattern_files(design, parameters, text)
            inputs += files
            space = design_space(design, parameters, text.source)
        elif parameters and (pure := text.section("stripes")):
            space = stripe_space(pure, parameters, text.source)
    with faults:
        if parameters and read and not faults.all:
            made = {
                case.case_id: case
                for labels, chosen in workflow_text.combinations(read, axes)
                for case in cases(chosen, labels, space, parameters, text.source)
            }
            faults.all += _misplaced_electrodes(made, text)
    if parameters is None or read is None or faults.all:
        raise BadInput(faults.all)
    return Plan(
        workflow=text.path.stem,
        title=read.title,
        figures=read.figures,
        cases=made,
        batches=batched(made),
        excluded=space.excluded,
        coordinates=workflow_text.coordinates(next(iter(made.values())).design),
        overrides=text.overrides,
        inputs=digests(sorted(inputs)),
        stripes=_stripes_fingerprint(parameters, read, axes),
        gauge=overridden(parameters.gauge, read.gauge),
        material=parameters.material,
        warnings=unusual_values(read, made.values(), parameters),
    )


def _misplaced_electrodes(made: dict[str, Case], text: WorkflowText) -> list[Fault]:
    """Faults of the electrodes of cases; one fault for all designs that have it."""
    designs: dict[str, list[str]] = defaultdict(list)
    for case in made.values():
        for problem in electrode_problems(case):
            designs[problem].append(case.label)
    given = text.table.get("electrodes", {})
    source = text.source(f"electrodes.{'mask' if 'mask' in given else 'layout'}")
    return [
        Fault(source, f"{problem} (in {labels[0]}{' and others' if len(labels) > 1 else ''})")
        for problem, labels in designs.items()
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


def joined_plan(records: Sequence[Mapping[str, Any]], source: str) -> Plan:
    """Recorded plans of one workflow as one; it states inputs only if they have the same cases."""
    first = records[0]
    cases: dict[str, Case] = {}
    for record in records:
        for case_id, stored in record["cases"].items():
            if case_id in cases:
                continue
            try:
                cases[case_id] = case_of(stored)
            except (ValidationError, KeyError, TypeError) as error:
                problem = f"was recorded by another version of knitlab ({error}); run it again"
                raise fault(f"{source}: {case_id}", problem) from error
    designs = {tuple(case.design.values()) for case in cases.values()}
    excluded = {tuple(row[:-1]): row[-1] for record in records for row in record["excluded"]}
    alike = all(record["cases"].keys() == first["cases"].keys() for record in records)
    return Plan(
        workflow=first["workflow"],
        title=first["title"],
        figures=tuple(first["figures"]),
        cases=cases,
        batches=batched(cases),
        excluded={design: why for design, why in excluded.items() if design not in designs},
        coordinates=workflow_text.coordinates(first["dims"]),
        overrides=dict(first["overrides"]) if alike else {},
        inputs=dict(first["inputs"]) if alike else {},
        stripes=first.get("stripes", ""),
        gauge=Gauge(**first["gauge"]),
        material=first.get("material"),
    )
