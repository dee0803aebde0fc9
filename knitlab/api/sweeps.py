"""Sweeps: planning, running and merging workflows."""

import warnings
from pathlib import Path
from typing import Any

import xarray as xr

from knitlab.cubes.cube_file import CUBE, with_derived
from knitlab.io.errors import Mistake
from knitlab.runs.batches import Shard
from knitlab.runs.merge import merge_folders
from knitlab.runs.plan import Plan, make_plan
from knitlab.runs.run import Run, RunOptions, run_plan

RESULTS = Path("results")  # default folder for the results folders of all workflows


class NotAllOk(UserWarning):
    """A run with cases that are not ok, stale or unfinished."""


def run(
    workflow: str | Path,
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
    progress: bool = False,
    **settings: Any,
) -> xr.Dataset:
    """Run a workflow: simulate the missing cases and build its cube.

    Args:
        workflow: name of a shipped workflow, such as ``"preview"``, or path of a TOML file.
        results: folder that holds a folder of results for each workflow.
        workers: number of processes on this machine; 0 simulates in this process. A script that
            uses workers needs the guard ``if __name__ == "__main__":``, as they are spawned.
        scheduler: address of an existing dask scheduler, used instead of ``workers``.
        retries: how often a batch that raised an error is tried again.
        fail_fast: whether to stop at the first case that is not ok.
        case_timeout: longest time for a case [s].
        refresh: whether to recompute stale results.
        shard: the part of the plan to run, as ``(3, 40)``, beside processes that run the others
            in the same results folder, or each in its own for :func:`merge`.
        figures: whether to draw the workflow's figures into the results folder.
        progress: whether to draw a progress bar.
        settings: settings of the workflow to replace; a list makes a dimension of the cube:
            ``k_t_factor=[0.8, 1.0, 1.2]``.

    Returns:
        The cube, with every design of the results folder; of a shard, the designs of its part. The
        last shard to end writes ``cube.nc`` with the designs of all.

    Raises:
        InputError: with every fault of the workflow and its settings, or if the folder is in use
            or its cube has other dimensions.

    Warns:
        NotAllOk: if a case is not ok, stale or unfinished.

    Example:
        >>> cube = kl.run("periodic", n_stripe=4, n_subunit=8, strain_max=0.06, results=folder)
        >>> cube["status"].item() == 1
        True
    """
    options = RunOptions(
        workers=workers,
        scheduler=scheduler,
        retries=retries,
        fail_fast=fail_fast,
        case_timeout=case_timeout,
        refresh=refresh,
        shard=None if shard is None else Shard(*shard),
        show_progress=progress,
    )
    made = plan(workflow, **settings)
    for warning in made.warnings:
        warnings.warn(warning, UserWarning, stacklevel=2)
    done, folder, _, mistakes = carried_out(made, Path(results), options, figures)
    for remark in [*done.remarks(made.dims, folder), *map(str, mistakes)]:
        warnings.warn(remark, NotAllOk, stacklevel=2)
    if shard is None:
        done.cube.encoding["source"] = str(folder / CUBE)
    return with_derived(done.cube)


def carried_out(
    made: Plan, results: Path, options: RunOptions, figures: bool = True
) -> tuple[Run, Path, list[Path], list[Mistake]]:
    """A run of a plan, its folder, the figures that it drew, and why others cannot be drawn."""
    folder = results / made.workflow
    done = run_plan(made, folder, options)
    if options.shard is not None or not figures:
        return done, folder, [], []
    # Matplotlib is imported only to draw.
    from knitlab.figures.drawing import draw_figures

    return done, folder, *draw_figures(made.figures, folder)


def merge(
    *folders: str | Path, results: str | Path = RESULTS, any_code: bool = False
) -> xr.Dataset:
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
    done = merge_folders([Path(each) for each in folders], Path(results), any_code=any_code)
    for path in done.damaged:
        warnings.warn(f"damaged, and left out: {path}", NotAllOk, stacklevel=2)
    done.cube.encoding["source"] = str(done.folder / CUBE)
    return with_derived(done.cube)


def plan(workflow: str | Path, **settings: Any) -> Plan:
    """Resolve a workflow and settings, as for :func:`run`, into the cases that it would run.

    Returns:
        The plan, with its ``cases``, ``excluded`` designs, and ``batches`` with estimates of
        time [s] and memory [byte].

    Raises:
        InputError: with every fault of the workflow and its settings.

    Example:
        >>> len(kl.plan("preview").cases)
        10
    """
    return make_plan(str(workflow), settings)
