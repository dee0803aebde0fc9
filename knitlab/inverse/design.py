"""Design: candidates for targets are searched, tested with their siblings and ranked."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from tqdm import tqdm

from knitlab.cube.cube_file import CUBE, write_cube
from knitlab.cube.find import Found, find_designs
from knitlab.cube.schema import described
from knitlab.cube.strain_window import STRAIN
from knitlab.cube.target import Target
from knitlab.inverse.candidate_workflow import write_workflow
from knitlab.inverse.objective import (
    Objective,
    all_met,
    check_targets,
    distance_of,
    violation_of,
)
from knitlab.inverse.quantities import Measures
from knitlab.inverse.request import DesignRequest
from knitlab.inverse.search import SearchResult, TrialRecord
from knitlab.inverse.search_jobs import SEARCHES, TRIALS, SearchJob, run_searches
from knitlab.inverse.search_space import DesignLabels, SearchSpace, search_space
from knitlab.inverse.starts import starting_designs
from knitlab.inverse.trial import run_trial
from knitlab.io.atomic_write import atomic_write
from knitlab.io.errors import fault
from knitlab.io.fingerprint import text_fingerprint
from knitlab.io.lock import held
from knitlab.measure.knit_size import ALONG_X, ALONG_Y, Gauge
from knitlab.simulation.case import Case, Label
from knitlab.sweep.cube import GAUGE_ATTRIBUTES
from knitlab.sweep.declared_fields import declared
from knitlab.sweep.plan import Plan, batched
from knitlab.sweep.run import RunOptions, run_plan
from knitlab.sweep.workers import interrupted_by_signals

REQUEST = "request.json"
WORST = "distance_worst"
BUDGET = 60
"""Default number of simulations of the searches."""


@dataclass(frozen=True)
class DesignOptions:
    """How a design is run; of these options only the budget changes the result.

    Attributes:
        workers: number of processes on this machine; 0 simulates in this process.
        budget: largest number of simulations of the coarse sweep and the searches together; the
            tests of the candidates with their siblings are extra.
        minutes: time after which no further trial starts, if any.
        show_progress: whether to draw a progress bar.
    """

    workers: int = 0
    budget: int = BUDGET
    minutes: float | None = None
    show_progress: bool = False


@dataclass(frozen=True)
class Designed:
    """The result of a design.

    Attributes:
        request: the request.
        folder: results folder, with the cube of the candidates, their workflows and all trials.
        cube: the candidates, simulated again with their siblings.
        found: the candidates by their worst distance within the spread, the best first.
        searches: results of the searches, in the order of the candidates' numbers.
        trials: one row for each trial of the searches: values, distances, identifiers.
        simulations: number of simulations of the searches and the coarse sweep.
        workflows: files that reproduce the candidates, in the order of their numbers.
        unknown: allowed designs that no cube has results of, and that were not considered.
    """

    request: DesignRequest
    folder: Path
    cube: xr.Dataset
    found: Found
    searches: tuple[SearchResult, ...]
    trials: pd.DataFrame
    simulations: int
    workflows: tuple[Path, ...]
    unknown: tuple[DesignLabels, ...] = ()

    def __repr__(self) -> str:
        counts = f"{len(self.table)} candidates, {self.simulations} simulations"
        return f"<Designed {self.request.name}: {counts}>"

    @property
    def table(self) -> pd.DataFrame:
        """The candidates, the best first."""
        return self.found.table

    @property
    def met(self) -> bool:
        """Whether the best candidate, simulated again, meets all targets and constraints."""
        wanted = (*self.request.targets, *self.request.subject_to)
        best = [float(each.off_by[0]) for each in self.found.reached if len(each.off_by)]
        return bool(best) and all_met(wanted, best)


def run_design(
    request: DesignRequest,
    folder: Path,
    options: DesignOptions,
    measures: Measures = (),
) -> Designed:
    """Search for designs that meet the targets, and test them.

    Args:
        request: the request.
        folder: results folder; trials of an interrupted design in it are reused.
        options: how to run it.
        measures: own measures of shapes that targets may refer to.

    Raises:
        BadInput: if the request cannot be run, the folder holds another request, or a search
            failed.
        KeyboardInterrupt: if it is interrupted; finished simulations are kept.
    """
    if measures and options.workers:
        raise fault("workers", "own measures run in this process only; give workers = 0")
    space = search_space(request)
    objective = Objective(
        request.targets, request.subject_to, tuple(dict(measures)), space.acts_on()
    )
    first, _ = space.case(space.designs[0], space.start(space.designs[0]))
    check_targets((*request.targets, *request.subject_to), objective.own, first)
    if not objective.has_gradient and find_spec("cmaes") is None:
        problem = "is needed for targets without derivatives; pip install 'knitlab[design]'"
        raise fault("the package cmaes", problem)
    _check_folder(request, folder)
    began = time.time()
    run = RunOptions(workers=options.workers)
    # The run that tests the candidates locks the folder itself.
    with held(folder / SEARCHES), interrupted_by_signals():
        coarse = not request.cubes and len(space.designs) > request.starts
        if coarse and options.budget <= len(space.designs):
            problem = (
                f"is used up by the coarse sweep of {len(space.designs)} designs; raise it, or"
            )
            raise fault(f"budget {options.budget}", f"{problem} give cubes to start from")
        starts = starting_designs(request, space, folder / TRIALS, run, objective.own)
        with atomic_write(folder / REQUEST) as temporary:
            temporary.write_text(request.fingerprint)
        budget = options.budget - starts.simulations
        jobs = _jobs(space, objective, starts.designs, options, budget, began, measures)
        searches = _searched(jobs, folder, options)
        plan = _candidates_plan(request, space, searches)
        if not plan.cases:
            problem = "no start converges; try other designs, bounds or settings"
            raise fault(request.name, problem)
        # An earlier cube may hold candidates that are no longer any.
        for old in (folder / CUBE, *folder.glob("candidate_*.toml")):
            old.unlink(missing_ok=True)
        tested = run_plan(plan, folder, replace(run, refresh=True))
        if tested.stopped:
            raise KeyboardInterrupt
    cube = _completed(tested.cube, space, searches, measures, folder)
    found = _ranked(cube, request)
    cube = _with_distances(cube, found)
    write_cube(cube, folder / CUBE)
    workflows = tuple(
        write_workflow(folder / f"candidate_{number}.toml", request, space, search)
        for number, search in enumerate(searches, start=1)
        if search.winner is not None
    )
    trials = trials_table(request, space.dims, searches)
    with atomic_write(folder / "trials.csv") as temporary:
        trials.to_csv(temporary, index=False)
    return Designed(
        request,
        folder,
        cube,
        found,
        tuple(searches),
        trials,
        starts.simulations + len(trials),
        workflows,
        starts.unknown,
    )


def _check_folder(request: DesignRequest, folder: Path) -> None:
    path = folder / REQUEST
    if path.is_file() and path.read_text() != request.fingerprint:
        problem = "holds the design of another request; name another results folder, or remove it"
        raise fault(str(folder), problem)


def _jobs(
    space: SearchSpace,
    objective: Objective,
    starts: Sequence[DesignLabels],
    options: DesignOptions,
    budget: int,
    began: float,
    measures: Measures,
) -> list[SearchJob]:
    """Searches from the starts, which share the budget."""
    starts = starts[: max(budget, 1)]
    rounds = -(-len(starts) // max(options.workers, 1))
    seconds = np.inf if options.minutes is None else 60 * options.minutes
    jobs = []
    for place, design in enumerate(starts):
        share = budget // len(starts) + (place < budget % len(starts))
        turn = place // max(options.workers, 1) + 1
        deadline = began + seconds * turn / rounds
        jobs.append(SearchJob(space, objective, design, max(share, 1), deadline, measures))
    return jobs


def _searched(
    jobs: Sequence[SearchJob], folder: Path, options: DesignOptions
) -> list[SearchResult]:
    best = np.inf
    with tqdm(
        total=None if options.minutes else sum(job.budget for job in jobs),
        unit="simulation",
        disable=not options.show_progress,
        bar_format="{n_fmt}/{total_fmt} simulations |{bar}| {elapsed} elapsed, {desc}",
    ) as bar:

        def progress(design: DesignLabels, distance: float) -> None:
            nonlocal best
            if distance < best:
                best = distance
                bar.set_description_str(f"best distance {best:.3g} by {design}")
            bar.update()

        return run_searches(jobs, folder, options.workers, progress)


def _candidates_plan(
    request: DesignRequest, space: SearchSpace, searches: Sequence[SearchResult]
) -> Plan:
    """The best trial of each search, to be simulated from the flat sheet with siblings."""
    cases: dict[str, Case] = {}
    for number, search in enumerate(searches, start=1):
        if search.winner is None:
            continue
        case, _ = space.case(search.design, np.array(search.winner.place))
        labels: dict[str, Label] = {**space.labels(search.design), "candidate": number}
        tested = replace(case, design=labels, robustness=request.robustness)
        cases[tested.case_id] = tested
    return Plan(
        workflow=request.name,
        title=f"Candidates of the design {request.name}",
        figures=(),
        cases=cases,
        batches=batched(cases),
        excluded={},
        coordinates={},
        overrides={},
        inputs={},
        stripes=text_fingerprint(request.fingerprint),
        gauge=space.plan(space.designs[0], {}).gauge,
    )


def _completed(
    cube: xr.Dataset,
    space: SearchSpace,
    searches: Sequence[SearchResult],
    measures: Measures,
    folder: Path,
) -> xr.Dataset:
    """The cube with own measures, and with sizes in cloth at the gauge of each candidate."""
    dims = cube["status"].dims
    own = {
        name: np.full((*cube["status"].shape, cube.sizes[STRAIN]), np.nan) for name, _ in measures
    }
    sizes = {name: cube[name].values.copy() for name in (*ALONG_X, *ALONG_Y)}
    stitches = {name: np.full(cube["status"].shape, np.nan) for name in declared(Gauge)}
    for number, search in enumerate(searches, start=1):
        if search.winner is None:
            continue
        case, gauge = space.case(search.design, np.array(search.winner.place))
        trial = run_trial(folder / TRIALS, case, gauge, measures)
        labels = space.labels(search.design) | {"candidate": number}
        place = _place(cube, labels)
        for name, values in own.items():
            values[place] = trial.values(name)
        for name, values in sizes.items():
            values[place] = trial.values(name)[0]
        for name, values in stitches.items():
            values[place] = getattr(gauge, name)
    completed = cube.assign({name: ((*dims, STRAIN), values) for name, values in own.items()})
    if set(declared(Gauge)) & set(space.names):
        varied = sizes | stitches
        completed = completed.assign({name: (dims, values) for name, values in varied.items()})
        completed.attrs = {
            name: value
            for name, value in cube.attrs.items()
            if name not in GAUGE_ATTRIBUTES.values()
        }
    return completed


def _ranked(cube: xr.Dataset, request: DesignRequest) -> Found:
    """The candidates that meet the constraints, then the others; by their worst distance."""
    wanted, held = request.targets, request.subject_to
    found = find_designs([cube], [*wanted, *held])
    reached, constraints = found.reached[: len(wanted)], found.reached[len(wanted) :]

    worst = distance_of(wanted, [each.worst for each in reached])
    violation = np.array(
        [
            violation_of(held, [each.worst[place] for each in constraints])
            for place in range(len(found.table))
        ]
    )
    order = np.lexsort((worst, violation))
    table = found.table.assign(distance=distance_of(wanted, [each.off_by for each in reached]))
    table.insert(list(table.columns).index("distance") + 1, WORST, worst)
    if held:
        table.insert(list(table.columns).index(WORST) + 1, "violation", violation)
    return Found(
        table.iloc[order].reset_index(drop=True),
        tuple(each.in_order(order) for each in found.reached),
        found.passed_over,
    )


def _with_distances(cube: xr.Dataset, found: Found) -> xr.Dataset:
    for name in ("distance", WORST):
        values = np.full(cube["status"].shape, np.nan)
        for _, row in found.table.iterrows():
            values[_place(cube, row)] = row[name]
        cube[name] = (cube["status"].dims, values)
    return described(cube)


def _place(cube: xr.Dataset, labels: Mapping[str, Any] | pd.Series) -> tuple[int, ...]:
    """Index of the candidate with these labels along the design dimensions."""
    dims = map(str, cube["status"].dims)
    return tuple(int(np.flatnonzero(cube[dim].values == labels[dim])[0]) for dim in dims)


def trials_table(
    request: DesignRequest, dims: Sequence[str], searches: Sequence[SearchResult]
) -> pd.DataFrame:
    """One row for each trial: design, values, distance, and how far it is from each target."""
    targets: list[Target] = [*request.targets, *request.subject_to]
    return pd.DataFrame(
        [
            {
                "candidate": number,
                **dict(zip(dims, search.design, strict=True)),
                **trial.values,
                "converged": trial.converged,
                "snapped": trial.snapped,
                "distance": trial.distance,
                "violation": trial.violation,
                **_off_by(targets, trial),
                "case_id": trial.case_id,
            }
            for number, search in enumerate(searches, start=1)
            for trial in search.trials
        ]
    )


def _off_by(targets: Sequence[Target], trial: TrialRecord) -> Mapping[str, float | None]:
    off_by = trial.off_by or [None] * len(targets)
    return {f"off_by_{k}": off for k, off in enumerate(off_by, start=1)}
