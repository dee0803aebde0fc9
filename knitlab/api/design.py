"""Designing a knit for targets, by simulation."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from knitlab.api.sweeps import RESULTS
from knitlab.design.request import checked_request, read_request
from knitlab.io.errors import invalid, shortened
from knitlab.io.names import named_folder

if TYPE_CHECKING:  # these are slow to import
    from knitlab.api.cubes import Wanted
    from knitlab.design.design import Designed
    from knitlab.design.trial import ShapeFunction

UNLIMITED = 1_000_000  # number of simulations if the budget is a time


def design(
    file: str | Path | None = None,
    *,
    targets: "Wanted | Sequence[Wanted]" = (),
    vary: Mapping[str, Any] | None = None,
    subject_to: "Wanted | Sequence[Wanted]" = (),
    workflow: str | Path = "periodic",
    cubes: str | Path | Sequence[str | Path] = (),
    starts: int = 3,
    robustness: int = 4,
    measures: "Mapping[str, ShapeFunction] | None" = None,
    budget: int | str = 60,
    workers: int = 0,
    results: str | Path = RESULTS,
    name: str = "design",
    figures: bool = False,
    progress: bool = True,
    **settings: Any,
) -> "Designed":
    """Find the stripes and sizes that come closest to targets, by simulation.

    The nearest designs of ``cubes``, or of a coarse sweep, are refined within the bounds of
    ``vary``: by least squares with exact adjoint derivatives, with constraints by SLSQP, and
    without derivatives, or at a snap, by the evolution strategy CMA-ES. Results are simulated
    again from the flat sheet, with perturbed copies, and ranked by the worst within that spread. An
    interrupted design continues when it is run again.

    Args:
        file: TOML file of the request, instead of ``targets`` to ``robustness`` and settings.
        targets: targets, as for :func:`knitlab.find`. The default tolerance is 5 % of the value.
        vary: ``n_stripe`` and ``n_subunit`` as lists; lowest and highest value of numbers of
            stripes and gauge, such as ``rib_k_t_factor`` or ``garter_theta_0`` [mm, N, rad].
        subject_to: targets that must be met.
        workflow: name or path of the workflow that all other settings are taken from.
        cubes: cubes of designs to start from; a coarse sweep by default.
        starts: largest number of designs that are refined.
        robustness: number of perturbed copies of each result.
        measures: own functions of a configuration, in JAX, that targets may refer to by name:
            ``{"height": lambda shape: shape.positions[..., 2].max()}``.
        budget: largest number of simulations of sweep and searches, or a time such as
            ``"30min"``; the tests of the results are extra.
        workers: number of processes on this machine; 0 simulates in this process.
        results: folder that holds a folder of results for each request.
        name: name of that folder; with ``file`` it is that of the file.
        figures: whether to draw the targets and the results into ``figures/`` of that folder.
        progress: whether to show progress, with the best distance so far.
        settings: settings of the workflow to replace, as for :func:`knitlab.run`.

    Returns:
        The candidates: ``table``, best first, ``cube``, ``trials``, ``workflows`` that reproduce
        them, ``met``, and each search with its active bounds.

    Raises:
        InputError: with everything that is wrong in the request, or if targets contradict
            each other.

    Example:
        >>> wanted = "poisson_ratio = -0.1 ± 0.02 @ 0.03:0.06"
        >>> bounds = {"n_stripe": [4], "n_subunit": [8], "garter_k_t_factor": [0.2, 2.0]}
        >>> designed = kl.design(targets=wanted, vary=bounds, robustness=0, results=folder)
        >>> designed.table["candidate"].tolist()
        [1]
    """
    if file is not None:
        if targets or subject_to or vary or cubes or settings:
            message = "already gives targets, bounds and settings; leave out the others"
            raise invalid("file", message)
        request = read_request(Path(file))
    else:
        table = {
            "targets": targets,
            "subject_to": subject_to,
            "vary": vary or {},
            "workflow": str(workflow),
            "cubes": [*map(str, [cubes] if isinstance(cubes, str | Path) else cubes)],
            "starts": starts,
            "robustness": robustness,
            "settings": settings,
        }
        request = checked_request(name, table)
    most, minutes = _read_budget(str(budget).strip())
    from knitlab.design.design import run_design  # imports JAX
    from knitlab.model.computing import computing

    with computing():
        designed = run_design(
            request,
            named_folder(Path(results), request.name),
            own=tuple((measures or {}).items()),
            workers=workers,
            budget=most,
            minutes=minutes,
            show_progress=progress,
        )
    if figures:
        _draw(designed)
    return designed


def _read_budget(budget: str) -> tuple[int, float | None]:
    """The largest number of simulations, and minutes if the budget is a time."""
    timed = budget.endswith("min")
    try:
        number = float(budget.removesuffix("min")) if timed else int(budget)
    except ValueError:
        number = 0
    if not 0 < number <= UNLIMITED:
        message = f"is neither a number of simulations up to {UNLIMITED:,} nor a time such as 30min"
        raise invalid(f"budget {shortened(budget)}", message)
    return (UNLIMITED, number) if timed else (int(number), None)


def _draw(designed: "Designed") -> None:
    """Draw targets and results, and the Pareto front if two targets conflict, into ``figures/``."""
    from knitlab.figures.figure_files import draw_into
    from knitlab.figures.nearest_designs import nearest_figure, pareto_figure

    folder = designed.folder / "figures"
    wanted = partial(nearest_figure, designed.ranking, "candidates", bands=True)
    draw_into(wanted, folder / "wanted.png")
    (folder / "pareto.png").unlink(missing_ok=True)
    if (conflict := designed.conflict) is not None:
        draw_into(partial(pareto_figure, *conflict), folder / "pareto.png")
