"""Common settings: the settings that all designs of a cube share, and their differences."""

import json
from collections.abc import Collection, Iterable
from functools import reduce
from typing import Any, NamedTuple

import xarray as xr

ATTRIBUTE = "parameters"  # of a cube, with the common settings
OF_DESIGNS = ("design", "weft", "warp", "periods")  # entries of a record that follow from these


class SettingDifference(NamedTuple):
    """A setting, by its key and those of the tables around it, that has two values."""

    key: tuple[str, ...]
    before: Any
    after: Any

    def __str__(self) -> str:
        name = ".".join(self.key)
        known = not isinstance(self.before, list)
        return f"{name} was {self.before}, is {self.after}" if known else name


def common_settings(
    records: Iterable[dict[str, Any]], swept: Collection[str], stripes: str
) -> dict[str, Any]:
    """Settings that all records share, but for swept ones, with the fingerprint of the stripes."""
    # Converted to JSON, so that they can be compared with those of a cube.
    common: dict[str, Any] = reduce(shared, json.loads(json.dumps(list(records))))
    kept = {
        key: {name: inner for name, inner in value.items() if name not in swept}
        if isinstance(value, dict)
        else value
        for key, value in common.items()
        if key not in {*OF_DESIGNS, *swept}
    }
    return kept | {"stripes": stripes}


def parameters_of(cube: xr.Dataset) -> dict[str, Any]:
    """The common settings in the attributes of a cube."""
    stated: dict[str, Any] = json.loads(cube.attrs.get(ATTRIBUTE, "{}"))
    return stated


def shared(one: dict[str, Any], other: dict[str, Any]) -> dict[str, Any]:
    """The common entries of two records, including those of nested tables."""
    both: dict[str, Any] = {}
    for key in [key for key in one if key in other]:
        if isinstance(one[key], dict) and isinstance(other[key], dict):
            both[key] = shared(one[key], other[key])
        elif one[key] == other[key]:
            both[key] = one[key]
    return both


def differences(
    one: dict[str, Any], other: dict[str, Any], within: tuple[str, ...] = ()
) -> tuple[SettingDifference, ...]:
    """Where records, within tables of some keys, differ under the same key, sorted as sentences."""
    changed: list[SettingDifference] = []
    for key in one.keys() & other.keys():
        before, after = one[key], other[key]
        if isinstance(before, dict) and isinstance(after, dict):
            changed += differences(before, after, (*within, key))
        elif before != after:
            changed.append(SettingDifference((*within, key), before, after))
    return tuple(sorted(changed, key=str))
