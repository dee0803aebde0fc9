"""The settings that several cases or cubes share, and where two differ."""

import json
from collections.abc import Collection, Iterable
from functools import reduce
from typing import Any, NamedTuple

OF_DESIGNS = ("design", "weft", "warp", "periods", "lengths_ratio")
"""Entries of a record that depend on the design."""


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
    """Settings that all records share, but for swept ones, with the digest of the stripes."""
    left_out = {*OF_DESIGNS, *swept}
    kept = ({key: record[key] for key in record if key not in left_out} for record in records)
    # Converted to JSON, so that they can be compared with those of a cube; many are the same.
    listed: list[dict[str, Any]] = [*map(json.loads, dict.fromkeys(map(json.dumps, kept)))]
    common: dict[str, Any] = reduce(shared, listed)
    # Settings of the sheet that some records leave out are kept: without contact they mean nothing.
    if all("sheet" in record for record in listed):
        sheets = [record["sheet"] for record in listed]
        stated = {name: value for sheet in sheets for name, value in sheet.items()}
        common["sheet"] = {
            name: value
            for name, value in stated.items()
            if all(sheet.get(name, value) == value for sheet in sheets)
        }
    unswept = {
        key: {name: inner for name, inner in value.items() if name not in swept}
        if isinstance(value, dict)
        else value
        for key, value in common.items()
    }
    return unswept | {"stripes": stripes}


def shared(one: dict[str, Any], other: dict[str, Any]) -> dict[str, Any]:
    """The common entries of two records, including those of nested tables."""
    both: dict[str, Any] = {}
    for key in (key for key in one if key in other):
        tables = isinstance(one[key], dict) and isinstance(other[key], dict)
        if tables or one[key] == other[key]:
            both[key] = shared(one[key], other[key]) if tables else one[key]
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
