"""Records of shards: what each did, until the last one to end joins them. Needs no JAX."""

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from knitlab.io.atomic_write import atomic_write

SHARDS = "shards"
"""Folder, in a results folder, of the records that are not yet joined."""


@dataclass(frozen=True)
class ShardRecord:
    """What a shard did since its results were last joined with those of others.

    Attributes:
        simulated: identifiers of the cases that it simulated.
        failures: an entry with its reason for each case that it could not compute.
    """

    simulated: tuple[str, ...]
    failures: tuple[dict[str, Any], ...]


def record_path(folder: Path, number: int, count: int) -> Path:
    """Path of the record of a shard."""
    return folder / SHARDS / f"{number}-of-{count}.json"


def write_record(path: Path, record: ShardRecord) -> None:
    """Write the record of a shard; cases that it simulated before stay in it.

    Raises:
        CannotWrite: if it cannot be written.
    """
    before = [case_id for earlier in _read(path) for case_id in earlier.simulated]
    simulated = dict.fromkeys([*before, *record.simulated])
    with atomic_write(path) as temporary:
        temporary.write_text(
            json.dumps({"simulated": list(simulated), "failures": list(record.failures)})
        )


def read_records(folder: Path) -> list[ShardRecord]:
    """The records of a results folder that are not yet joined."""
    return [record for path in _paths(folder) for record in _read(path)]


def remove_records(folder: Path) -> None:
    """Remove the records of a results folder, once they are joined."""
    for path in _paths(folder):
        path.unlink(missing_ok=True)


def simulated_by(records: Iterable[ShardRecord]) -> set[str]:
    """Identifiers of the cases that shards simulated."""
    return {case_id for record in records for case_id in record.simulated}


def _paths(folder: Path) -> list[Path]:
    return sorted((folder / SHARDS).glob("*.json"))


def _read(path: Path) -> Iterator[ShardRecord]:
    try:
        record = json.loads(path.read_text())
        yield ShardRecord(tuple(record["simulated"]), tuple(record["failures"]))
    except (OSError, ValueError, TypeError, KeyError):
        return  # it may just have been joined, and case files say themselves what is done
