"""Common parameters: what all designs of a cube share, and in what two sets of them differ."""

import json
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray as xr

    from knitlab.study.plan import Plan

ATTRIBUTE = "parameters"
OF_DESIGNS = ("design", "weft", "warp", "periods")
"""What follows from a design and the stripes."""


def common_parameters(plan: "Plan") -> dict[str, Any]:
    """What all cases of a plan share beside their designs.

    The rest, what is a dimension included, is in ``plan.json`` and in each case file.
    """
    # As JSON holds them, so that they compare with what a cube states.
    records = json.loads(json.dumps([case.record for case in plan.cases.values()]))
    common: dict[str, Any] = records[0]
    for record in records[1:]:
        common = shared(common, record)
    swept = {dim.removesuffix("_factor") for dim in plan.dims}
    common = {key: value for key, value in common.items() if key not in {*OF_DESIGNS, *swept}}
    common = {
        key: {name: its for name, its in value.items() if name not in swept}
        if isinstance(value, dict)
        else value
        for key, value in common.items()
    }
    return common | {"stripes": plan.stripes}


def parameters_of(cube: "xr.Dataset") -> dict[str, Any]:
    """The common parameters that a cube states."""
    stated: dict[str, Any] = json.loads(cube.attrs.get(ATTRIBUTE, "{}"))
    return stated


def shared(one: dict[str, Any], other: dict[str, Any]) -> dict[str, Any]:
    """What two records have in common, tables within them likewise."""
    both: dict[str, Any] = {}
    for key, value in one.items():
        if isinstance(value, dict) and isinstance(other.get(key), dict):
            both[key] = shared(value, other[key])
        elif key in other and other[key] == value:
            both[key] = value
    return both


def differences(one: dict[str, Any], other: dict[str, Any], path: str = "") -> tuple[str, ...]:
    """Where two records that both say something say different things, in words."""
    found: list[str] = []
    for key in one.keys() & other.keys():
        before, after = one[key], other[key]
        if isinstance(before, dict) and isinstance(after, dict):
            found += differences(before, after, f"{path}{key}.")
        elif before != after:
            long = isinstance(before, list)
            found.append(f"{path}{key}" if long else f"{path}{key} was {before}, is {after}")
    return tuple(sorted(found))
