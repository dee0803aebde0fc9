"""Design: candidates for targets are searched, tested with their perturbed copies and ranked."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from knitlab.cubes.cube_file import open_cube, write_cube
from knitlab.cubes.find import CROSSINGS, Found, find_designs
from knitlab.design.candidates import (
    Candidate,
    Conflict,
    candidates_plan,
    completed,
    ranked,
    trials_table,
    worst_conflict,
    write_workflow,
)
from knitlab.design.objective import Objective, all_met, check_targets
from knitlab.design.request import DesignRequest
from knitlab.design.search import SEARCHES, TRIALS, DesignSearch, SearchResult, run_searches
from knitlab.design.search_space import DesignLabels, SearchSpace, search_space
from knitlab.design.trial import ShapeFunctions
from knitlab.io.atomic_write import atomic_write
from knitlab.io.cube_path import CUBE
from knitlab.io.errors import invalid
from knitlab.io.lock import locked
from knitlab.io.progress import Progress
from knitlab.runs.plan import make_plan
from knitlab.runs.results_folder import label_text
from knitlab.runs.run import run_plan
from knitlab.runs.run_options import RunOptions
from knitlab.runs.workers import interrupted_by_signals
from knitlab.runs.workflow import PATTERN

REQUEST = "request.json"
PAPERS_PATTERN = "checkerboard"  # pattern of a cube that names none


@dataclass(frozen=True)
class Designed:
    """The result of a design."""

    request: DesignRequest
    folder: Path  # results folder, with the cube of the candidates, their workflows and all trials
    cube: xr.Dataset  # the candidates, simulated again with their perturbed copies
    ranking: Found  # the candidates by their worst distance within the spread, the best first
    searches: tuple[SearchResult, ...]  # in the order of the candidates' numbers
    trials: pd.DataFrame  # a row for each trial of the searches: values, distances, identifiers
    simulations: int  # number of simulations of the searches and the coarse sweep
    workflows: tuple[Path, ...]  # reproduce the candidates, in the order of their numbers
    unknown: tuple[DesignLabels, ...] = ()  # allowed designs without results, not considered

    def __repr__(self) -> str:
        counts = f"{len(self.table)} candidates, {self.simulations} simulations"
        return f"<Designed {self.request.name}: {counts}>"

    @property
    def table(self) -> pd.DataFrame:
        """The candidates, the best first."""
        return self.ranking.table

    @property
    def met(self) -> bool:
        """Whether the best candidate, simulated again, meets all targets and constraints."""
        best = [float(each.off_by[0]) for each in self.ranking.reached if len(each.off_by)]
        return bool(best) and all_met(self.request.wanted, best)

    @property
    def conflict(self) -> Conflict | None:
        """The two targets or constraints that conflict most in the trials, if any do."""
        return worst_conflict(self.request.wanted, self.trials)

    def summary(self) -> Iterator[str]:
        """Lines about each candidate, the best first, and about targets that could not be met."""
        return _summary(self)


def run_design(
    request: DesignRequest,
    folder: Path,
    *,
    own: ShapeFunctions = (),
    workers: int = 0,
    budget: int = 60,
    minutes: float | None = None,
    show_progress: bool = True,
) -> Designed:
    """Search for designs that meet the targets, and test them; see :func:`knitlab.design`."""
    began = time.time()
    if own and workers:
        raise invalid("workers", "cannot compute your own measures; give workers = 0")
    space = search_space(request)
    objective = Objective(request, own, space.parameter_slopes())
    check_targets(request.wanted, own, space.case(space.designs[0])[0])
    if not objective.has_gradient and find_spec("cmaes") is None:
        message = "is needed for targets without derivatives; pip install 'knitlab[design]'"
        raise invalid("the package cmaes", message)
    text = request.text.encode()
    path = folder / REQUEST
    if path.is_file() and path.read_bytes() != text:
        message = "holds the results of another request; choose another folder, or delete it"
        raise invalid(str(folder), message)
    run = RunOptions(workers=workers, show_progress=show_progress)
    # The run that tests the candidates locks the folder itself.
    with locked(folder / SEARCHES), interrupted_by_signals():
        starts = _starts(objective, space, folder / TRIALS, run, budget)
        with atomic_write(path) as temporary:
            temporary.write_bytes(text)
        left = max(budget - starts.simulations, 1)
        designs = starts.designs[:left]
        # The numbers of simulations of two searches differ by at most one.
        shares = [left // len(designs) + (k < left % len(designs)) for k in range(len(designs))]
        at_once = max(workers, 1)
        seconds = np.inf if minutes is None else 60 * minutes / -(-len(designs) // at_once)
        searches = [
            DesignSearch(
                space, objective, design, folder, share, began + seconds * (number // at_once + 1)
            )
            for number, (design, share) in enumerate(zip(designs, shares, strict=True))
        ]
        results = tuple(_searched(searches, folder, workers, show_progress))
        winners = []
        for number, result in enumerate(results, start=1):
            if (best := result.winner) is not None:
                case, gauge = space.case(result.design, np.array(best.point))
                labels = space.labels(result.design)
                winners.append(Candidate(number, labels, best.values, case, gauge))
        if not winners:
            message = "no start converges; try other designs, bounds or settings"
            raise invalid(request.name, message)
        # An earlier cube may hold candidates that no longer exist.
        for old in (folder / CUBE, *folder.glob("candidate_*.toml")):
            old.unlink(missing_ok=True)
        plan = candidates_plan(request, space, winners)
        tested = run_plan(plan, folder, replace(run, refresh=True))
        if tested.stopped:
            raise KeyboardInterrupt
    ranking, cube = ranked(completed(tested.cube, space, winners, own, folder), objective)
    write_cube(cube, folder / CUBE)
    trials = trials_table(request, space.dims, results)
    with atomic_write(folder / "trials.csv") as temporary:
        trials.to_csv(temporary, index=False)
    return Designed(
        request,
        folder,
        cube,
        ranking,
        results,
        trials,
        starts.simulations + len(trials),
        tuple(write_workflow(folder, request, space, winner) for winner in winners),
        starts.unknown,
    )


class _Starts(NamedTuple):
    """Where searches begin."""

    designs: tuple[DesignLabels, ...]  # the nearest first
    simulations: int = 0  # of the coarse sweep
    unknown: tuple[DesignLabels, ...] = ()  # allowed designs without results


def _starts(
    objective: Objective, space: SearchSpace, folder: Path, options: RunOptions, budget: int
) -> _Starts:
    """The designs nearest to the targets, by given cubes or by a coarse sweep."""
    request = objective.request
    cubes = [open_cube(path, lazily=True) for path in request.cubes]
    simulations = 0
    if not cubes:
        if (count := len(space.designs)) <= request.starts:
            return _Starts(space.designs)
        if budget <= count:
            message = f"is less than the coarse sweep of {count} designs takes; raise it, or give"
            raise invalid(f"budget {budget}", f"{message} cubes to start from")
        plan = make_plan(space.workflow, {**space.settings, **request.choices})
        if run_plan(plan, folder, options).stopped:
            raise KeyboardInterrupt
        cubes = [open_cube(folder / CUBE)]
        simulations = len(plan.cases)
    # No cube has own functions; refining may fulfil constraints.
    targets = [target for target in request.wanted if target.name not in dict(objective.own)]
    if not targets:
        return _Starts(space.designs[: request.starts], simulations)
    table = find_designs(cubes, targets).table
    if PATTERN not in table:
        table = table.assign(**{PATTERN: PAPERS_PATTERN})
    known: list[DesignLabels] = [*map(tuple, table[[*space.dims]].to_numpy(object).tolist())]
    allowed = [design for design in dict.fromkeys(known) if design in space.designs]
    if not allowed:
        labels = ", ".join(map(str, space.designs))
        raise invalid("cubes", f"have none of the allowed designs; simulate {labels} first")
    unknown = tuple(design for design in space.designs if design not in known)
    return _Starts(tuple(allowed[: request.starts]), simulations, unknown)


def _searched(
    searches: Sequence[DesignSearch], folder: Path, workers: int, show_progress: bool
) -> list[SearchResult]:
    timed = any(np.isfinite(search.deadline) for search in searches)
    total = None if timed else sum(search.budget for search in searches)
    count, best, by = 0, np.inf, ""
    with Progress("searching", show_progress, total) as progress:

        def ended(design: DesignLabels, distance: float) -> None:
            nonlocal count, best, by
            count += 1
            if distance < best:
                best, by = distance, f", best distance {distance:.3g} by {design}"
            progress.reached(count, f"simulation {count}{by}")

        return run_searches(searches, folder, workers, ended)


def _summary(designed: Designed) -> Iterator[str]:
    dims = [str(dim) for dim in designed.cube["status"].dims if dim != "candidate"]
    crossings = designed.table.set_index("candidate").get(CROSSINGS)
    for number in map(int, designed.table["candidate"]):
        search = designed.searches[number - 1]
        best = search.winner.values if search.winner else {}
        values = ", ".join(f"{name} {value:.4g}" for name, value in best.items())
        yield f"candidate {number}: {label_text(dims, search.design)}  {values}".rstrip()
        how = " then ".join(search.methods) or "as it is"
        yield f"  {len(search.trials)} simulations by {how}; {search.ended}"
        if crossings is not None and crossings[number] > 0:
            yield "  passes through itself at its lowest ratio; real fabric cannot"
        if search.held_by:
            yield f"  at the bound {', '.join(search.held_by)}"
        determined = search.determined_to
        if weak := [f"{name} (± {100 * determined[name]:.0f} %)" for name in search.undetermined]:
            yield f"  hardly determined by the targets: {', '.join(weak)}"
    if not designed.met:
        yield from _missed(designed)
    names = [variable.name for variable in designed.request.variables]
    if one_knit := [name for name in names if name.startswith(("rib_", "garter_"))]:
        factors = (name.partition("_")[2] for name in one_knit if "factor" in name)
        both = ", ".join(dict.fromkeys(factors))
        hint = f"; vary {both}, if both are knitted alike" if both else ""
        yield f"{', '.join(one_knit)} change one knit alone, but yarn and stitch size both{hint}"
    if designed.unknown:
        labels = "; ".join(label_text(dims, design) for design in designed.unknown)
        yield f"not considered, as no cube has results of them: {labels}"


def _missed(designed: Designed) -> Iterator[str]:
    """Which targets the best candidate misses, and what holds it back."""
    numbers = [int(number) - 1 for number in designed.table["candidate"]]
    ranked_searches = [designed.searches[number] for number in numbers] or designed.searches
    nearest = next(search for search in ranked_searches if search.winner)
    off_by = nearest.winner.off_by if nearest.winner else []
    for target, off in zip(designed.request.wanted, off_by, strict=True):
        if off is not None and off > target.allowance:
            yield f"not met: {target.text}: the nearest is off by {off:.4g}"
    if nearest.held_by:
        yield f"held back by {', '.join(nearest.held_by)}: widen it, or relax a target"
    elif (conflict := designed.conflict) is not None:
        one, other = conflict.targets
        yield f"{one!r} and {other!r} conflict; relax one of them"
    else:
        yield "no bound is active: vary more parameters, add designs, or raise the budget"
