"""Stability of one design: branches of its equilibria, and the shapes that it may relax to."""

from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from knitlab.api.single_design import single_design
from knitlab.api.sweeps import one_of
from knitlab.figures.figure_files import maybe_draw
from knitlab.figures.stability import branches_figure, shapes_figure
from knitlab.io.errors import invalid, shown
from knitlab.io.progress import Progress, part
from knitlab.model.computing import computing
from knitlab.runs.figure_names import check_figure_suffix
from knitlab.runs.workflow_text import Overrides
from knitlab.solvers.branches.continuation import (
    Kind,
    PathPoint,
    at_parameter,
    equilibrium,
    follow,
    switched,
)
from knitlab.solvers.branches.equations import FabricEquations
from knitlab.solvers.branches.shapes import barriers, relaxed_shapes
from knitlab.solvers.case import Case
from knitlab.solvers.equilibrium.system import System, one_thread_of_blas
from knitlab.solvers.equilibrium.tensile_test import stretch

MAX_BRANCHES = 6
MAX_STARTS = 10_000  # sheets to relax for shapes
ONTO_BRANCH = 0.01  # distance from a branch point at which the other branch begins
SAME_ENERGY = 1e-8  # relative difference of the energies of copies of a state
BELOW_REST = 0.02  # compression to which branches are followed
MAX_SHAPES = 6  # shapes between which energies are computed


@computing()
def branches(
    workflow: str | Path = "periodic",
    overrides: Sequence[str] = (),
    *,
    output: str | Path | None = None,
    **settings: Any,
) -> xr.Dataset:
    """Branches of equilibria of one design under a load, stable and unstable.

    The branch of the relaxed fabric is followed by arc-length continuation up to the largest strain
    of the protocol, through limit points, where a test snaps, and onto the branches that cross it
    at branch points. Copies of a branch, moved, shifted or mirrored, are left out.

    Args:
        workflow: name or path of the workflow that all settings are taken from.
        overrides: settings to replace as text, ``"n_stripe=4"``, in place of ``settings``.
        output: figure to write: force and lowest eigenvalue against the strain.
        settings: settings of the workflow to replace, which leave one design: ``n_stripe=4``,
            ``n_subunit=16``.

    Returns:
        Along ``point``, in the order of each branch: its number ``branch`` from 1, that of the
        relaxed fabric, ``applied_strain`` [1], also below 0 by at most 2 % and a step beyond,
        ``energy`` [N mm], ``reaction_force`` [N], ``lowest_eigenvalue`` of the stiffness [N/mm],
        ``unstable`` (the number of negative ones) and ``kind``: regular, limit or branch.

    Raises:
        InputError: if the settings give no single design in equilibrium, or are invalid.

    Example:
        >>> path = kl.branches("periodic", n_stripe=4, n_subunit=8, contact="none", strain_max=0.03)
        >>> bool((path["lowest_eigenvalue"] > 0).all())
        True
    """
    case = _single(workflow, one_of(overrides, settings), output)
    net, fabric = case.assemble()
    with Progress("relaxing", total=None), one_thread_of_blas():
        system = System(net.shape, fabric)
        test = stretch(system, case.applied_strain[:1], case.equilibrium_solver, load=case.load)
        if test.loading is None:
            raise invalid(case.label, "does not relax; raise max_iterations")
        equations = FabricEquations(system, test.loading)
        until = -BELOW_REST, case.applied_strain[-1]
        followed: list[list[PathPoint]] = []
        crossings: deque[PathPoint] = deque()

        def follow_from(start: PathPoint) -> None:
            with part(name=f"branch {len(followed) + 1}"):
                followed.append(follow(equations, start, until))
            crossings.extend(point for point in followed[-1] if point.kind is Kind.branch)

        follow_from(equilibrium(equations, equations.start, 0.0))
        while crossings and len(followed) < MAX_BRANCHES:
            for side in switched(equations, crossings.popleft(), ONTO_BRANCH):
                if len(followed) < MAX_BRANCHES and not _is_known(equations, side, followed):
                    follow_from(side)
    table = _table(equations, followed)
    table.attrs["design"] = case.label
    return maybe_draw(branches_figure, table, output)


def _single(workflow: str | Path, overrides: Overrides, output: str | Path | None) -> Case:
    """The one case of a workflow."""
    check_figure_suffix(output)
    case = single_design(workflow, overrides, {}).case
    where = f"workflow {workflow}"
    if case.solver is None or case.solver.drag:
        hint = "take method = equilibrium and drag = 0"
        raise invalid(where, f"has states that are no equilibria; {hint}")
    if case.friction.acts:
        raise invalid(where, "has friction, which branches leave out; take fold_friction = 0")
    if case.options.contact != "none":
        raise invalid(where, "has contact, which branches leave out; take contact = none")
    return case


def _is_known(equations: FabricEquations, side: PathPoint, followed: list[list[PathPoint]]) -> bool:
    """Whether a branch passes a point or its copy: the same shape moved, shifted or mirrored.

    Copies have the same energy and the same number of unstable motions. Their eigenvalues may
    differ: a shift along periodic fabric is no rotation of the unknowns.
    """
    return any(
        abs(there.energy - side.energy) < SAME_ENERGY * abs(side.energy)
        and there.unstable == side.unstable
        for points in followed
        for there in at_parameter(equations, points, side.parameter)
    )


def _table(equations: FabricEquations, followed: list[list[PathPoint]]) -> xr.Dataset:
    points = [(number, point) for number, those in enumerate(followed, 1) for point in those]

    def column(of: Any, units: str, name: str) -> tuple[str, np.ndarray, dict[str, str]]:
        values = np.array([of(point) for _, point in points])
        return "point", values, {"units": units, "long_name": name}

    def force(point: PathPoint) -> float:
        gradient = equations.gradient(point.unknowns, point.parameter)
        loading = equations.loading
        return loading.load.reaction_force(loading, gradient)

    return xr.Dataset(
        {
            "branch": ("point", [number for number, _ in points], {"long_name": "branch"}),
            "applied_strain": column(lambda point: point.parameter, "1", "applied strain"),
            "energy": column(lambda point: point.energy, "N mm", "elastic energy"),
            "reaction_force": column(force, "N", "reaction force"),
            "lowest_eigenvalue": column(
                lambda point: point.eigenvalues[0], "N/mm", "lowest eigenvalue of the stiffness"
            ),
            "unstable": column(lambda point: point.unstable, "1", "unstable motions"),
            "kind": column(lambda point: point.kind.name, "1", "kind of point"),
        }
    )


@computing()
def shapes(
    workflow: str | Path = "periodic",
    overrides: Sequence[str] = (),
    *,
    starts: int = 30,
    output: str | Path | None = None,
    **settings: Any,
) -> xr.Dataset:
    """The shapes that one design may relax to, and the energy to go from one to another.

    Each start is a sheet with other noise. Shapes that differ by a symmetry of the fabric are one.
    Energies between the six lowest are those of a path, estimates of the barriers.

    Args:
        workflow: name or path of the workflow that all settings are taken from.
        overrides: settings to replace as text, ``"n_stripe=4"``, in place of ``settings``.
        starts: number of sheets.
        output: figure to write: heights of the shapes, and energies between them.
        settings: settings of the workflow to replace, which leave one design.

    Returns:
        Along ``shape``, the lowest energy first: ``energy`` [N mm], ``starts`` that led to it,
        ``length_x`` and ``length_y`` [mm] if periodic, ``height`` above the mean (shape, node_y,
        node_x) [mm], and ``barrier`` (shape, to) [N mm], missing beyond the six lowest.
        ``attrs["not_converged"]`` counts other starts.

    Raises:
        InputError: if the settings give no single design in equilibrium, or are invalid.

    Example:
        >>> atlas = kl.shapes("periodic", starts=3, n_stripe=4, n_subunit=8, contact="none")
        >>> int(atlas["starts"].sum()) + atlas.attrs["not_converged"]
        3
    """
    if not 1 <= starts <= MAX_STARTS:
        raise invalid("starts", f"is {shown(starts)}; give 1 to {MAX_STARTS:,}")
    case = _single(workflow, one_of(overrides, settings), output)
    net, fabric = case.assemble()
    with Progress("relaxing"):
        known, failed = relaxed_shapes(net, fabric, case.equilibrium_solver, starts)
    if not known:
        raise invalid(case.label, "does not relax from any start; raise max_iterations")
    count = len(known)
    barrier = np.full((count, count), np.nan)
    with Progress("energies between shapes"), one_thread_of_blas():
        few = known[:MAX_SHAPES]
        barrier[: len(few), : len(few)] = barriers(System(net.shape, fabric), few)
    states = [each.state.configuration for each in known]
    heights = [np.asarray(state.positions)[..., 2] for state in states]
    centred = np.stack([height - height.mean() for height in heights])
    numbers = np.arange(1, count + 1)
    about = {"design": case.label, "not_converged": failed}
    table = xr.Dataset(coords={"shape": numbers, "to": numbers}, attrs=about)
    table["energy"] = "shape", [each.energy for each in known], {"units": "N mm"}
    table["starts"] = "shape", [each.starts for each in known], {"units": "1"}
    table["height"] = ("shape", "node_y", "node_x"), centred, {"units": "mm"}
    table["barrier"] = ("shape", "to"), barrier, {"units": "N mm"}
    if net.shape.periodic:
        for axis, name in enumerate(("length_x", "length_y")):
            lengths = [float(state.lengths[axis]) for state in states]
            table[name] = ("shape", lengths, {"units": "mm"})
    return maybe_draw(shapes_figure, table, output)
