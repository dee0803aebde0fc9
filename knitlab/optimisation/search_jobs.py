"""Searches as jobs of the workers: one start each, its result kept as a JSON file."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from knitlab.execution.workers import BatchError, Task, pool_of
from knitlab.io.atomic_write import atomic_write
from knitlab.io.errors import BadInput, Fault
from knitlab.io.fingerprint import code_fingerprint
from knitlab.optimisation.objective import Objective
from knitlab.optimisation.quantities import Measures
from knitlab.optimisation.search import Search, SearchResult
from knitlab.optimisation.search_space import DesignLabels, SearchSpace
from knitlab.simulation.case import Case
from knitlab.simulation.reporting import Progress

TRIALS = "trials"
"""Folder of the trials' case files within the folder of a design."""
SEARCHES = "searches"
"""Folder of the results of searches."""


@dataclass(frozen=True, eq=False)
class SearchJob:
    """One search.

    Attributes:
        space: what may vary.
        objective: what is wanted.
        design: n_stripe and n_subunit that it begins with.
        budget: most trials.
        deadline: time of the clock at which no further trial begins [s].
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
        """What a kept result must be of to be taken again; nothing where time or own code decides.

        All else is that of the request, which a folder has one of.
        """
        if self.measures or np.isfinite(self.deadline):
            return ""
        return f"{self.budget} simulations, code {code_fingerprint()}"

    @property
    def start(self) -> Case:
        """The case that it begins with."""
        return self.space.case(self.design, self.space.start(self.design))[0]


def run_searches(
    jobs: Sequence[SearchJob],
    folder: Path,
    workers: int,
    progress: Callable[[DesignLabels, float], None],
) -> list[SearchResult]:
    """Run searches, each in one worker.

    A search that was killed repeats its trials from their files and goes on.

    Args:
        jobs: the searches.
        folder: of the results of the design.
        workers: processes on this machine; 0 for this process.
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
    with pool_of(task, min(workers, len(jobs)), None, False, reported) as pool:
        for batch, error in pool([(case,) for case in starts.values()]):
            if error is not None:
                errors[batch[0].case_id] = error
    if errors:
        labels = {case_id: starts[case_id].label for case_id in errors}
        raise BadInput(
            [Fault(f"search from {labels[its]}", error.reason) for its, error in errors.items()]
        )
    return [_read_result(_result_path(folder, case_id)) for case_id in by_start]


def _search_batch(
    jobs: dict[str, SearchJob], folder: Path, batch: Sequence[Case], progress: Progress
) -> None:
    """Run the search that begins with the only case of a batch."""
    (start,) = batch
    job, path = jobs[start.case_id], _result_path(folder, start.case_id)
    if path.is_file() and job.stamp and json.loads(path.read_text()).get("of") == job.stamp:
        return
    search = Search(
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
