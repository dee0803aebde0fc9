"""Sweeps on a cluster: the parts of a workflow as jobs of SLURM."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from knitlab.api.sweeps import RESULTS, one_of, plan

if TYPE_CHECKING:  # imports JAX
    from knitlab.runs.slurm import Submission


def submit(
    workflow: str | Path,
    overrides: Sequence[str] = (),
    *,
    parts: int,
    results: str | Path = RESULTS,
    cores: int = 1,
    sbatch: Sequence[str] = (),
    dry_run: bool = False,
    retries: int = 0,
    fail_fast: bool = False,
    case_timeout: float | None = None,
    refresh: bool = False,
    **settings: Any,
) -> "Submission":
    """Submit a workflow to SLURM, as an array job that runs one part of its plan in each task.

    The job is a script in the results folder, which asks for the time and the memory that the plan
    estimates, with a margin. A last job, after all parts, simulates what they have left, builds the
    cube and draws the figures.

    Args:
        workflow: name or path of the workflow.
        overrides: settings to replace as text, ``"n_stripe=4"``, in place of ``settings``.
        parts: number of parts, at most that of the cases.
        results: folder that holds a folder of results for each workflow, seen by all nodes.
        cores: processors of each part.
        sbatch: options of ``sbatch``, which replace what the estimates ask for, as
            ``["partition=short", "time=04:00:00"]``.
        dry_run: whether to write the script only.
        retries: how often a batch that raised an error is tried again.
        fail_fast: whether a part stops at its first case that is not ok.
        case_timeout: longest time for a case [s].
        refresh: whether to recompute stale results, and those that did not converge.
        settings: settings of the workflow to replace.

    Returns:
        The ``script``, what it has ``asked`` of SLURM, and the numbers of the ``job`` of the parts
        and of the ``last`` one, if they were submitted.

    Raises:
        InputError: with everything that is wrong in the workflow and its settings, if there are
            more parts than cases, or if SLURM is not there or refuses the job.

    Example:
        >>> submitted = kl.submit("preview", parts=4, results=folder, dry_run=True)
        >>> submitted.script.name, submitted.job
        ('submit.sh', None)
    """
    from knitlab.runs import slurm
    from knitlab.runs.run_options import RunOptions

    options: dict[str, Any] = {"retries": retries, "fail_fast": fail_fast, "refresh": refresh}
    options["case_timeout"] = case_timeout
    RunOptions(**options)  # refuses invalid ones
    given = slurm.read_options(sbatch)
    chosen = one_of(overrides, settings)
    made = plan(workflow, overrides, results=results, **settings)
    asked = slurm.asked_of_slurm(made, parts, cores, given)
    script = Path(results) / made.workflow / slurm.SCRIPT
    words = slurm.run_words(str(workflow), chosen, Path(results), options)
    slurm.write_script(script, words, parts, cores, asked)
    submitted = slurm.Submission(script, len(made.cases), parts, asked, warnings=made.warnings)
    return submitted if dry_run else slurm.submitted(submitted)
