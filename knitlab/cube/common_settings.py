"""Common settings: the settings that all designs of a cube share, and their differences."""

import json
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray as xr  # slow to import

ATTRIBUTE = "parameters"
"""Attribute of a cube that contains the common settings."""
OF_DESIGNS = ("design", "weft", "warp", "periods")
"""Entries of a record that follow from a design and its stripes."""


@dataclass(frozen=True)
class SettingDifference:
    """One setting in which two sets differ.

    Attributes:
        key: its key, preceded by the tables that contain it.
        before, after: its two values.
    """

    key: tuple[str, ...]
    before: Any
    after: Any

    def __str__(self) -> str:
        name = ".".join(self.key)
        if isinstance(self.before, list):
            return name
        return f"{name} was {self.before}, is {self.after}"


def common_settings(
    records: Iterable[dict[str, Any]], swept: Collection[str], stripes: str
) -> dict[str, Any]:
    """The settings that all cases of a plan share.

    All other settings, including swept ones, are in ``plan.json`` and in each case file.

    Args:
        records: the records of the cases.
        swept: settings that are dimensions, or quantities that have a factor as a dimension.
        stripes: fingerprint of the stripes.
    """
    # Converted to JSON, so that they can be compared with those of a cube.
    first, *others = json.loads(json.dumps(list(records)))
    common: dict[str, Any] = first
    for record in others:
        common = shared(common, record)
    common = {key: value for key, value in common.items() if key not in {*OF_DESIGNS, *swept}}
    common = {
        key: {name: its for name, its in value.items() if name not in swept}
        if isinstance(value, dict)
        else value
        for key, value in common.items()
    }
    return common | {"stripes": stripes}


def parameters_of(cube: "xr.Dataset") -> dict[str, Any]:
    """The common settings in the attributes of a cube."""
    stated: dict[str, Any] = json.loads(cube.attrs.get(ATTRIBUTE, "{}"))
    return stated


def shared(one: dict[str, Any], other: dict[str, Any]) -> dict[str, Any]:
    """The common entries of two records, including those of nested tables."""
    both: dict[str, Any] = {}
    for key, value in one.items():
        if isinstance(value, dict) and isinstance(other.get(key), dict):
            both[key] = shared(value, other[key])
        elif key in other and other[key] == value:
            both[key] = value
    return both


def differences(
    one: dict[str, Any], other: dict[str, Any], within: tuple[str, ...] = ()
) -> tuple[SettingDifference, ...]:
    """Where two records have different values under the same key.

    Args:
        one: the first record.
        other: the second.
        within: keys of the tables that contain the records.

    Returns:
        The differences, ordered as their sentences are.
    """
    found: list[SettingDifference] = []
    for key in one.keys() & other.keys():
        before, after = one[key], other[key]
        if isinstance(before, dict) and isinstance(after, dict):
            found += differences(before, after, (*within, key))
        elif before != after:
            found.append(SettingDifference((*within, key), before, after))
    return tuple(sorted(found, key=str))
