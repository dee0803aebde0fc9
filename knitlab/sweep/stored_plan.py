"""Plans as ``plan.json`` holds them: read again, and joined."""

from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import ValidationError

from knitlab.io.errors import fault
from knitlab.measure.knit_size import Gauge
from knitlab.simulation.case import Case, case_of
from knitlab.sweep.axes import SweepAxis
from knitlab.sweep.plan import Plan, batched
from knitlab.sweep.settings import SETTINGS


def joined_plan(records: Sequence[Mapping[str, Any]], source: str) -> Plan:
    """The plan with the cases of several plans of one workflow.

    Args:
        records: their records, along the same dimensions.
        source: what they were read from, for a message.

    Returns:
        The plan. If the plans differ, it states no inputs: no workflow file gives all its cases.

    Raises:
        BadInput: if a case was recorded by another version.
    """
    first = records[0]
    cases: dict[str, Case] = {}
    for record in records:
        for case_id, stored in record["cases"].items():
            if case_id not in cases:
                cases[case_id] = _case(case_id, stored, source)
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
        coordinates={
            name: SweepAxis(SETTINGS[name], ()).coordinate
            for name in first["dims"]
            if name in SETTINGS and name not in ("n_stripe", "n_subunit")
        },
        overrides=tuple(first["overrides"]) if alike else (),
        inputs=dict(first["inputs"]) if alike else {},
        stripes=first.get("stripes", ""),
        gauge=Gauge(**first["gauge"]),
    )


def _case(case_id: str, record: dict[str, Any], source: str) -> Case:
    try:
        return case_of(record)
    except (ValidationError, KeyError, TypeError) as error:
        problem = f"was recorded by another version of knitlab ({error}); run it again"
        raise fault(f"{source}: {case_id}", problem) from error
