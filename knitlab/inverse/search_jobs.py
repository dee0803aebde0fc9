"""Searches as jobs of the workers: one per start, with its result in a JSON file."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from knitlab.inverse.objective import Objective
from knitlab.inverse.quantities import Measures
from knitlab.inverse.search import DesignSearch, SearchResult
from knitlab.inverse.search_space import DesignLabels, SearchSpace
from knitlab.io.atomic_write import atomic_write
from knitlab.io.errors import BadInput, Fault
from knitlab.io.fingerprint import code_fingerprint
from knitlab.simulation.case import Case
from knitlab.simulation.tensile_tests import Progress
from knitlab.sweep.workers import BatchError, Task, pool_of

TRIALS = "trials"
"""Folder of the case files of trials, in the folder of a design."""
SEARCHES = "searches"
"""Folder of the results of searches."""
ATTEMPTS = 3
"""How often a search is started if its worker dies."""


@dataclass(frozen=True, eq=False)
class SearchJob:
    """One search.

    Attributes:
        space: the search space.
        objective: the objective.
        design: n_stripe and n_subunit of the start.
        budget: largest number of trials.
        deadline: time after which no further trial starts, by :func:`time.time` [s].
        measures: own measures of shapes.
    """

    space: SearchSpace
    objective: Objective
    design: DesignLabels
    budget: int
    deadline: float
    measures: Measures = ()

    @property
    def stamp(self) -> str:
        """Identifies a stored result that may be reused; empty if time or own code affects it.

        Everything else is determined by the request, of which a folder has only one.
        """
        if self.measures or np.isfinite(self.deadline):
            return ""
        return f"{self.budget} simulations, code {code_fingerprint()}"

    @property
    def start(self) -> Case:
        """The case at the start."""
        return self.space.case(self.design, self.space.start(self.design))[0]


def run_searches(
    jobs: Sequence[SearchJob],
    folder: Path,
    workers: int,
    progress: Callable[[DesignLabels, float], None],
) -> list[SearchResult]:
    """Run searches, each in one worker.

    A search that was killed repeats its trials from their files and continues; one whose worker
    died is tried again.

    Args:
        jobs: the searches.
        folder: results folder of the design.
        workers: number of processes on this machine; 0 for this process.
        progress: called with the design and the distance of each trial.

    Raises:
        BadInput: with the reason of every search that failed.
    """
    starts = {start.case_id: start for start in (job.start for job in jobs)}
    by_start = dict(zip(starts, jobs, strict=True))

    def reported(case_id: str, distance: float) -> None:
        progress(by_start[case_id].design, distance)

    task = Task(partial(_search_batch, by_start), folder)
    errors: dict[str, BatchError] = {}
    pending = starts
    with pool_of(task, min(workers, len(jobs)), None, False, reported) as pool:
        for attempt in range(1, ATTEMPTS + 1):
            ended = pool([(case,) for case in pending.values()])
            failed = {batch[0].case_id: error for batch, error in ended if error is not None}
            again = {key for key, error in failed.items() if error.lost and attempt < ATTEMPTS}
            errors |= {key: error for key, error in failed.items() if key not in again}
            pending = {key: starts[key] for key in again}
    if errors:
        labels = {case_id: starts[case_id].label for case_id in errors}
        raise BadInput(
            [Fault(f"search from {labels[key]}", error.reason) for key, error in errors.items()]
        )
    return [_read_result(_result_path(folder, case_id)) for case_id in by_start]


def _search_batch(
    jobs: dict[str, SearchJob], folder: Path, batch: Sequence[Case], progress: Progress
) -> None:
    """Run the search that starts with the only case of a batch."""
    (start,) = batch
    job, path = jobs[start.case_id], _result_path(folder, start.case_id)
    if path.is_file() and job.stamp and json.loads(path.read_text()).get("of") == job.stamp:
        return
    search = DesignSearch(
        job.space,
        job.objective,
        job.design,
        folder / TRIALS,
        job.budget,
        job.deadline,
        lambda distance: progress(start.case_id, distance),
        job.measures,
    )
    record = search.run().record() | {"of": job.stamp}
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(record, indent=1))


def _result_path(folder: Path, case_id: str) -> Path:
    return folder / SEARCHES / f"{case_id}.json"


def _read_result(path: Path) -> SearchResult:
    return TypeAdapter(SearchResult).validate_json(path.read_text())
