"""Sweeps: planning, running and merging workflows."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from knitlab.io.errors import Mistake, invalid
from knitlab.io.names import as_texts
from knitlab.io.progress import Progress
from knitlab.runs.workflow_file import Overrides

if TYPE_CHECKING:  # slow to import
    import xarray as xr

    from knitlab.runs.merge import Merge
    from knitlab.runs.plan import Plan

RESULTS = Path("results")  # default folder for the results folders of all workflows


class NotAllOk(UserWarning):
    """A run with cases that are not ok, stale or unfinished."""


def run(
    workflow: str | Path,
    overrides: Sequence[str] = (),
    *,
    results: str | Path = RESULTS,
    workers: int = 0,
    scheduler: str | None = None,
    retries: int = 0,
    fail_fast: bool = False,
    case_timeout: float | None = None,
    refresh: bool = False,
    shard: tuple[int, int] | None = None,
    figures: bool = False,
    progress: bool = True,
    **settings: Any,
) -> "xr.Dataset":
    """Run a workflow: simulate the missing cases and build its cube.

    Args:
        workflow: name of a shipped workflow, such as ``"preview"``, or path of a TOML file.
        overrides: settings to replace as text, ``"n_stripe=4"``, in place of ``settings``.
        results: folder that holds a folder of results for each workflow.
        workers: number of processes on this machine; 0 simulates in this process. A script that
            uses workers needs the guard ``if __name__ == "__main__":``, as they are spawned.
        scheduler: address of an existing dask scheduler, used instead of ``workers``.
        retries: how often a batch that raised an error is tried again.
        fail_fast: whether to stop at the first case that is not ok.
        case_timeout: longest time for a case [s].
        refresh: whether to recompute stale results, and those that did not converge.
        shard: the part of the plan to run, as ``(3, 40)``, beside processes that run the others
            in the same results folder, or each in its own for :func:`merge`.
        figures: whether to draw the workflow's figures into the results folder.
        progress: whether to show progress, after two seconds.
        settings: settings of the workflow to replace; a list makes a dimension of the cube:
            ``k_t_factor=[0.8, 1.0, 1.2]``.

    Returns:
        The cube, with every design of the results folder; of a shard, the designs of its part. The
        last shard to end writes ``cube.nc`` with the designs of all.

    Raises:
        InputError: with everything that is wrong in the workflow and its settings, or if the
            folder is in use or its cube has other dimensions.

    Warns:
        NotAllOk: if a case is not ok, stale or unfinished.

    Example:
        >>> cube = kl.run("periodic", n_stripe=4, n_subunit=8, strain_max=0.06, results=folder)
        >>> cube["status"].item() == 1
        True
    """
    result = run_and_draw(
        workflow,
        one_of(overrides, settings),
        Path(results),
        figures=figures,
        again=True,
        warn=lambda text: warnings.warn(text, UserWarning, stacklevel=3),
        workers=workers,
        scheduler=scheduler,
        retries=retries,
        fail_fast=fail_fast,
        case_timeout=case_timeout,
        refresh=refresh,
        shard=shard,
        show_progress=progress,
    )
    for remark in [*result.remarks, *map(str, result.mistakes)]:
        warnings.warn(remark, NotAllOk, stacklevel=2)
    from knitlab.cubes.derived import with_derived
    from knitlab.io.cube_path import CUBE

    cube = result.make_cube()
    if shard is None:
        cube.encoding["source"] = str(result.folder / CUBE)
    return with_derived(cube)


@dataclass(frozen=True)
class RunResult:
    """What a run did."""

    folder: Path
    make_cube: Callable[[], Any]
    excluded: list[str]  # impossible designs, with the reasons
    simulated: int  # cases
    reused: int  # cases that were there
    all_ok: bool = True
    joined: bool = True  # whether the cube was written: other shards may still run
    figures: Sequence[Path] = ()
    mistakes: Sequence[Mistake] = ()  # why some figures cannot be drawn
    remarks: Sequence[str] = ()  # on cases that are not ok, stale or unfinished


def run_and_draw(
    workflow: str | Path,
    overrides: Overrides,
    results: Path,
    *,
    figures: bool = True,
    again: bool = False,
    warn: Callable[[str], None],
    shard: "tuple[int, int] | str | None" = None,
    **options: Any,
) -> RunResult:
    """Run a workflow and draw its figures; the ``options`` are those of ``RunOptions``.

    If there is nothing to run or draw, what exists is returned, unless the cube is to be built
    ``again``. ``warn`` is called with each warning of the plan.
    """
    # What is invalid is said before anything slow is imported.
    from knitlab.runs.batches import Shard
    from knitlab.runs.plan import make_plan
    from knitlab.runs.run_options import RunOptions

    own = Shard.of(shard) if isinstance(shard, str) else shard and Shard(*shard)
    run_options = RunOptions(**options, shard=own)
    if own is None and not again:
        finished = _finished(str(workflow), overrides, results)
        if finished is not None:
            return finished
    plan = make_plan(str(workflow), overrides)
    for warning in plan.warnings:
        warn(warning)
    from knitlab.runs.results_folder import CaseState
    from knitlab.runs.run import run_plan

    folder = results / plan.workflow
    done = run_plan(plan, folder, run_options)
    drawn = list[Path]()
    mistakes = list[Mistake]()
    if figures and own is None:
        from knitlab.figures.drawing import draw_figures  # imports matplotlib

        with Progress("figures", run_options.show_progress):
            drawn, mistakes = draw_figures(plan.figures, folder)
    return RunResult(
        folder,
        lambda: done.cube,
        excluded_designs(plan.dims, plan.excluded),
        len(done.simulated),
        len(done.left_in(CaseState.done, CaseState.stale_code)),
        done.all_ok,
        done.joined,
        drawn,
        mistakes,
        done.remarks(plan.dims, folder),
    )


def _finished(workflow: str, overrides: Overrides, results: Path) -> RunResult | None:
    """What exists, if there is nothing to run or draw; without importing JAX or matplotlib."""
    from knitlab.runs.recorded_plan import same_plan

    record = same_plan(workflow, overrides, results)
    if record is None:
        return None
    from knitlab.figures.figure_files import is_drawn, requested_figures  # import xarray
    from knitlab.runs.status import finished_cube

    folder = results / record["workflow"]
    cube = finished_cube(record, folder)
    if cube is None:
        return None
    figures, mistakes = requested_figures(record["figures"], cube, folder)
    if not all(is_drawn(figure.output, figure.fingerprint) for figure in figures):
        return None
    excluded = {tuple(design): reason for *design, reason in record["excluded"]}
    files = [figure.output for figure in figures]
    lines = excluded_designs(record["dims"], excluded)
    cases = len(record["cases"])
    return RunResult(folder, lambda: cube, lines, 0, cases, figures=files, mistakes=mistakes)


def one_of(overrides: Overrides, settings: Mapping[str, Any]) -> Overrides:
    """The settings to replace, as text or as keywords; InputError if both are given."""
    if overrides and settings:
        message = "is given beside overrides; give all settings in one way"
        raise invalid(", ".join(settings), message)
    return settings or (overrides if isinstance(overrides, Mapping) else as_texts(overrides))


def excluded_designs(dims: Sequence[str], excluded: Mapping[tuple[Any, ...], str]) -> list[str]:
    """Lines that name the designs that are excluded, and say why."""
    from knitlab.runs.results_folder import label_text

    return [f"{label_text(dims, design)}: {reason}" for design, reason in excluded.items()]


def merge(
    *folders: str | Path, results: str | Path = RESULTS, any_code: bool = False
) -> "xr.Dataset":
    """Join results folders of one workflow, as of shards that ran on several machines.

    The folders are compared before anything is written, and are not changed.

    Args:
        folders: results folders of a workflow, or folders that hold them.
        results: folder that holds a folder of results for each workflow; what is there is kept.
        any_code: whether results of different versions of the model may be joined.

    Returns:
        The cube, with every design of all folders.

    Raises:
        InputError: if the folders differ in dimensions, settings, gauge or code, if a design is
            another case in two of them, or the same case with other numbers.

    Warns:
        NotAllOk: if a case file is damaged, and left out.

    Example:
        >>> kl.merge("results/reference/periodic", results=folder).sizes["n_stripe"]
        4
    """
    merged = merge_folders(folders, results, any_code=any_code)
    for path in merged.damaged:
        warnings.warn(f"damaged, and left out: {path}", NotAllOk, stacklevel=2)
    from knitlab.cubes.derived import with_derived
    from knitlab.io.cube_path import CUBE

    merged.cube.encoding["source"] = str(merged.folder / CUBE)
    return with_derived(merged.cube)


def merge_folders(folders: Sequence[str | Path], results: str | Path, *, any_code: bool) -> "Merge":
    """Join results folders, as :func:`merge`; returned is what was done."""
    from knitlab.runs import merge

    paths = [Path(folder) for folder in folders]
    with Progress("merging", total=None):
        return merge.merge_folders(paths, Path(results), any_code=any_code)


def plan(
    workflow: str | Path,
    overrides: Sequence[str] = (),
    *,
    results: str | Path | None = None,
    **settings: Any,
) -> "Plan":
    """Resolve a workflow and settings, as for :func:`run`, into the cases that it would run.

    Args:
        workflow: name or path of the workflow.
        overrides: settings to replace as text, ``"n_stripe=4"``, in place of ``settings``.
        results: folder that holds a folder of results for each workflow, into which ``plan.json``
            is written; by default nothing is written.
        settings: settings of the workflow to replace.

    Returns:
        The plan, with its ``cases``, ``excluded`` designs, and ``batches`` with estimates of
        time [s] and memory [byte].

    Raises:
        InputError: with everything that is wrong in the workflow and its settings.

    Example:
        >>> len(kl.plan("preview").cases)
        10
    """
    from knitlab.io.lock import locked
    from knitlab.runs.plan import make_plan
    from knitlab.runs.recorded_plan import PLAN

    made = make_plan(str(workflow), one_of(overrides, settings))
    if results is not None:
        folder = Path(results) / made.workflow
        with locked(folder):
            made.write(folder / PLAN)
    return made
