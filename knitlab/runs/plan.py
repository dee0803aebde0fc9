"""The plan: everything that a run needs, resolved once and stored in ``plan.json``."""

import json
import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from knitlab.cubes.common_settings import common_settings
from knitlab.io.atomic_write import atomic_write
from knitlab.io.checksum import json_with_checksum
from knitlab.io.errors import ErrorCollector, InputError, Mistake, invalid
from knitlab.io.limits import MAX_CASES
from knitlab.io.provenance import MODEL, file_digests, package_digest, text_digest
from knitlab.io.shipped import shipped
from knitlab.model.settings import PlainKnit
from knitlab.model.stitches import Gauge
from knitlab.observables.observable import Variable
from knitlab.observables.schema import SAMPLE
from knitlab.runs import workflow_text
from knitlab.runs.batches import Batch, Shard, batched, split
from knitlab.runs.case_settings import CaseSettings, Designs, overridden
from knitlab.runs.cases import KINDS, cases, electrode_problems, with_pattern_files
from knitlab.runs.declared_fields import FACTOR
from knitlab.runs.material import MATERIAL, with_material_file
from knitlab.runs.parameters import Parameters, defaults
from knitlab.runs.recorded_plan import Labels
from knitlab.runs.remarks import unusual_values
from knitlab.runs.workflow import CHANGES, SETTINGS, SPRING_LAW_CHANGES, Workflow
from knitlab.runs.workflow_file import Overrides, workflow_file
from knitlab.runs.workflow_text import WorkflowText
from knitlab.runs.yarn import YarnOnMachine
from knitlab.solvers.case import Case

RECORDED = ("workflow", "title", "figures", "dims", "overrides", "inputs", "stripes", "material")
"""Attributes of a plan that its file has as they are."""


@dataclass(frozen=True)
class Plan:
    """A workflow, resolved into cases by their identifiers, and these into batches."""

    workflow: str
    title: str
    figures: tuple[str, ...]
    cases: dict[str, Case]
    batches: tuple[Batch, ...]
    excluded: dict[Labels, str]  # impossible designs of the grid, with the reason
    coordinates: dict[str, Variable]  # of the settings that are given as lists
    overrides: dict[str, Any]  # values that replace the workflow's, by the name of their setting
    inputs: dict[str, str]  # SHA-256 of every file that the plan was made from, by path
    stripes: str  # digest of the stripe tables, with the changes that all cases share
    gauge: Gauge  # size of a stitch, for the cube's sizes in cloth; no case depends on it
    material: str | None = None  # name of a material in place of the paper's yarn
    yarn: YarnOnMachine | None = None  # what that says of its yarn and machine
    plain: PlainKnit | None = None  # of the material; its file does not have it
    warnings: tuple[str, ...] = ()  # values that may be mistakes

    def __repr__(self) -> str:
        counts = f"{len(self.cases)} cases in {len(self.batches)} batches"
        return f"<Plan {self.workflow}: {counts}, {len(self.excluded)} designs excluded>"

    @property
    def dims(self) -> tuple[str, ...]:
        """Dimensions of the cube along which its designs are ordered."""
        return tuple(next(iter(self.cases.values())).design)

    @property
    def designs(self) -> dict[str, Labels]:
        """Labels of the cases, by identifier."""
        return {case_id: tuple(case.design.values()) for case_id, case in self.cases.items()}

    def share(self, shard: Shard) -> "Plan":
        """The share of one shard; without cases if there are more shards than cases."""
        batches = split(self.batches, self.cases, shard.count)[shard.number - 1]
        wanted = {case_id for batch in batches for case_id in batch.cases}
        cases = {case_id: case for case_id, case in self.cases.items() if case_id in wanted}
        return replace(self, cases=cases, batches=batches)

    @cached_property
    def common(self) -> dict[str, Any]:
        """The settings that all cases share."""
        # A factor on a number changes this number too.
        swept = {*self.dims, *(each.removesuffix(FACTOR) for each in self.dims)}
        return common_settings((case.record for case in self.cases.values()), swept, self.stripes)

    @property
    def applied_strain(self) -> tuple[float, ...]:
        """Strains of the protocol, the same for every case."""
        return next(iter(self.cases.values())).applied_strain

    def write(self, path: Path) -> None:
        """Write the plan into a JSON file, one line for each case."""
        record = {name: getattr(self, name) for name in RECORDED} | {
            "code": MODEL,
            "package": package_digest(),
            "gauge": asdict(self.gauge),
            "yarn": self.yarn and self.yarn.given,
            "parameters": self.common,
            "batches": [asdict(batch) for batch in self.batches],
            "excluded": [[*design, reason] for design, reason in self.excluded.items()],
        }
        cases = self.cases.items()
        lines = (f"  {json.dumps(case_id)}: {json.dumps(case.record)}" for case_id, case in cases)
        head = json.dumps(record, indent=1).removesuffix("\n}")
        with atomic_write(path) as temporary:
            text = f'{head},\n "cases": {{\n' + ",\n".join(lines) + "\n }\n}\n"
            temporary.write_text(json_with_checksum(text), encoding="utf-8")


def make_plan(workflow: str, overrides: Overrides = ()) -> Plan:
    """The plan of a workflow, by name or file, with overrides; InputError has every mistake."""
    text = workflow_text.read_workflow(workflow_file(workflow), overrides)
    mistakes, parameters, checked = ErrorCollector(), defaults(), None
    axes = workflow_text.Axes()
    designs = Designs()
    planned: dict[str, Case] = {}
    inputs = [text.path, *shipped("params").glob("*.toml")]
    with mistakes:
        if model := text.section("model"):
            if model.material is not None:
                inputs.append(text.folder(MATERIAL) / model.material)
                parameters, text = with_material_file(inputs[-1], parameters, text)
            if (interpolate := model.interpolate_stripes) is not None:
                stripes = parameters.stripes.model_copy(update={"interpolate": interpolate})
                parameters = replace(parameters, stripes=stripes)
    with mistakes:
        checked, axes = text.checked()
    with mistakes:
        if design := text.section("design"):
            parameters, files = with_pattern_files(design, parameters, text)
            inputs += files
        for name, kind in KINDS.items():
            if section := text.section(name):
                designs = kind.designs(section, parameters, text.source)
    with mistakes:
        if checked and not mistakes.all:
            sets = math.prod(len(axes[name]) for name in {*axes} - {*text.paired[1:]})
            if (number := len(designs) * sets) > MAX_CASES:
                message = f"asks for {number:,} cases, above {MAX_CASES:,}; give shorter lists"
                raise invalid(str(text.path), message)
            planned = {
                case.case_id: case
                for labels, chosen in workflow_text.combinations(checked, axes, text.paired)
                for case in cases(CaseSettings(chosen, labels, parameters, text.source), designs)
            }
            mistakes.all += _misplaced_electrodes(planned, text)
    if checked is None or mistakes.all:
        raise InputError(mistakes.all)
    # Paired settings share the last dimension.
    dims = [name for name in axes if name not in text.paired] + [SAMPLE] * bool(text.paired)
    return Plan(
        workflow=text.path.stem,
        title=checked.title,
        figures=checked.figures,
        cases=planned,
        batches=batched(planned),
        excluded={design: reason for design, reason in designs.items() if reason},
        coordinates={dim: workflow_text.coordinate(dim) for dim in dims},
        overrides=text.overrides,
        inputs=file_digests(sorted(inputs)),
        stripes=_stripes_digest(parameters, checked, set(axes)),
        gauge=overridden(parameters.gauge, checked.gauge),
        material=parameters.material,
        yarn=parameters.yarn,
        plain=parameters.plain,
        warnings=unusual_values(
            CaseSettings(checked, {}, parameters, text.source), planned.values()
        ),
    )


def _misplaced_electrodes(planned: dict[str, Case], text: WorkflowText) -> list[Mistake]:
    """Mistakes in the electrodes of cases, each once for all designs that have it."""
    designs: dict[str, list[str]] = defaultdict(list)
    for case in planned.values():
        for message in electrode_problems(case):
            designs[message].append(case.label)
    given = text.table.get("electrodes", {})
    source = text.source(f"electrodes.{'mask' if 'mask' in given else 'layout'}")
    return [
        Mistake(source, f"{message} (in {labels[0]}{' and others' if len(labels) > 1 else ''})")
        for message, labels in designs.items()
    ]


def _stripes_digest(parameters: Parameters, workflow: Workflow, swept: set[str]) -> str:
    changes = workflow.model.model_dump(include=set(CHANGES) - swept)
    # For linear springs the digest is that of a version without other laws.
    changes = {k: v for k, v in changes.items() if k not in SPRING_LAW_CHANGES or v is not None}
    tables = parameters.stripes.model_dump(exclude_none=True)
    return text_digest(json.dumps([tables, changes]))


def joined_plan(records: Sequence[Mapping[str, Any]], source: str) -> Plan:
    """Recorded plans of one workflow as one; it states inputs only if they have the same cases."""
    from knitlab.cubes.recorded_case import case_of_record  # imports xarray

    first, cases = records[0], dict[str, Case]()
    for case_id, stored in dict(item for each in records for item in each["cases"].items()).items():
        cases[case_id] = case_of_record(stored, f"{source}: {case_id}")
    designs = {tuple(case.design.values()) for case in cases.values()}
    excluded = {tuple(row[:-1]): row[-1] for record in records for row in record["excluded"]}
    alike = all(record["cases"].keys() == cases.keys() for record in records)
    return Plan(
        workflow=first["workflow"],
        title=first["title"],
        figures=tuple(first["figures"]),
        cases=cases,
        batches=batched(cases),
        excluded={design: why for design, why in excluded.items() if design not in designs},
        coordinates={
            name: workflow_text.coordinate(name)
            for name in first["dims"]
            if name in (*SETTINGS, SAMPLE) and name not in ("n_stripe", "n_subunit")
        },
        overrides=dict(first["overrides"]) if alike else {},
        inputs=dict(first["inputs"]) if alike else {},
        stripes=first["stripes"],
        gauge=Gauge(**first["gauge"]),
        material=first["material"],
        yarn=first["yarn"] and YarnOnMachine(**first["yarn"]),
    )
