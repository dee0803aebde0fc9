"""Relaxation: a sheet taken off the needles folds into its corrugated shape."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from knitlab.equilibrium.equilibrium import find_equilibrium
from knitlab.equilibrium.loading import all_free, between_walls, rigidly_aligned
from knitlab.equilibrium.search import SearchRules
from knitlab.equilibrium.settings import SolverSettings
from knitlab.equilibrium.state import State
from knitlab.equilibrium.stiffness import free_stiffness
from knitlab.equilibrium.subdomains import worth_dividing
from knitlab.equilibrium.system import System, run_each
from knitlab.fabric.configuration import Configuration
from knitlab.fabric.energy import COMPLETE, Point, Stage
from knitlab.fabric.fabric import Fabric, flat_sheet
from knitlab.fabric.network import Network, network

if TYPE_CHECKING:
    from knitlab.fabric.barrier import Barrier


def relax(
    system: System,
    settings: SolverSettings,
    start: Configuration | None = None,
    contact: "Barrier | None" = None,
) -> State:
    """The relaxed shape of a fabric (paper, Sec. "Relaxation of a pattern").

    The rest fold angles are raised to their full value in ``settings.ramp_steps`` equal steps,
    between walls that are soft at first: hard walls would stop every step at the first node that
    touches them, and a node that slides along a wall would do so at every step. Each stage but the
    last is only solved approximately, to ``settings.waypoint_force`` times the largest force that a
    fold exerts on the flat sheet. A sample for clamping relaxes with all edges free and no
    coordinate fixed. It is then rigidly aligned, as far as the walls allow, and solved again.
    Periodic fabric is solved with a convexified stiffness, which is faster; if that collapses a
    cell, where fold angles are undefined, it is solved again by raising μ.
    Without a start it begins with the flat sheet.
    """
    shape, fabric = system.shape, system.fabric
    free = free_stiffness(shape, all_free(shape))
    # From a flat sheet, round-off of single precision may decide which shape is reached.
    whole = SearchRules(free, settings, contact=contact, exact=not worth_dividing(shape))
    flat = flat_sheet(network(shape), fabric)
    begin = np.asarray((flat if start is None else start).flattened())
    ramp, soft = settings.ramp_steps, settings.soft_wall
    stages = [Stage(step / ramp, soft) for step in range(1, ramp)]
    stages += [Stage(1.0, soft * 10.0**k) for k in range(math.ceil(-math.log10(soft)))]
    waypoint = intermediate_settings(settings, fabric)
    passed: list[State] = []
    # A convexified stiffness would rotate a sample with free edges slightly at every step.
    for convexified in (True, False) if shape.periodic else (False,):
        unknowns = begin
        for stage in (*stages, COMPLETE):
            rules = replace(
                whole,
                settings=settings if stage is COMPLETE else waypoint,
                convexified=convexified,
            )
            state = find_equilibrium(system, Point(unknowns, stage), rules, patience=None)
            passed.append(state)
            unknowns = state.unknowns
        if passed[-1].converged:
            break
    if passed[-1].converged and not shape.periodic:
        aligned = rigidly_aligned(shape, flat, passed[-1].configuration)
        at = Point(np.asarray(between_walls(aligned, float(fabric.z_max)).flattened()))
        rules = replace(whole, convexified=False)
        passed.append(find_equilibrium(system, at, rules, patience=None))
    return passed[-1].after(*passed[:-1])


def relax_near(
    system: System,
    settings: SolverSettings,
    start: Configuration,
    contact: "Barrier | None" = None,
) -> State:
    """The relaxed shape next to a configuration that is nearly in equilibrium; as :func:`relax`."""
    free = free_stiffness(system.shape, all_free(system.shape))
    rules = SearchRules(free, settings, convexified=False, contact=contact)
    return find_equilibrium(system, Point(np.asarray(start.flattened())), rules)


def intermediate_settings(settings: SolverSettings, fabric: Fabric) -> SolverSettings:
    """Settings for an intermediate state, which need not be in exact equilibrium."""
    moments = np.asarray(fabric.fold_stiffness) * np.abs(fabric.rest_fold)
    near = settings.waypoint_force * float(moments.max() / fabric.cell_sides.min())
    return replace(settings, tolerance=max(settings.tolerance, near))


def imperfect_sheet(net: Network, fabric: Fabric, seed: int) -> Configuration:
    """A flat sheet with every node displaced at random, by 2 % of a side of a grid cell."""
    flat, sides = flat_sheet(net, fabric), np.asarray(fabric.cell_sides)
    noise = np.random.default_rng(seed).normal(size=flat.positions.shape)
    moved = np.asarray(flat.positions) + 0.02 * float(sides.min()) * noise
    return Configuration(moved, np.asarray(flat.lengths))


def starts_from_periodic(
    samples: Sequence[tuple[Network, Fabric]],
    cells: Sequence[tuple[Network, Fabric]],
    settings: Sequence[SolverSettings],
    seed: int | None = None,
    contacts: Sequence["Barrier | None"] = (),
) -> list[Configuration | None]:
    """Starting shapes of samples of one mesh shape, tiled with their relaxed periodic fabrics.

    The periodic fabrics ``cells`` are of one mesh shape too, and imperfect if there is a seed.
    Returns ``None`` for a sample whose periodic fabric did not relax.
    """
    searches = [
        partial(
            relax,
            settings=own,
            start=None if seed is None else imperfect_sheet(*cell, seed),
            contact=contact,
        )
        for cell, own, contact in zip(cells, settings, contacts or [None] * len(cells), strict=True)
    ]
    relaxed = run_each(cells[0][0].shape, [fabric for _, fabric in cells], searches)
    return [
        tiled(*sample, net, state.configuration) if state.converged else None
        for sample, (net, _), state in zip(samples, cells, relaxed, strict=True)
    ]


def tiled(net: Network, fabric: Fabric, cell: Network, relaxed: Configuration) -> Configuration:
    """A sample tiled with relaxed periodic fabric, in equilibrium except at its edges."""
    rows, columns = np.mgrid[: net.shape.nodes_y, : net.shape.nodes_x]
    turns_y, rows = np.divmod(rows, cell.shape.nodes_y)
    turns_x, columns = np.divmod(columns, cell.shape.nodes_x)
    nodes = np.asarray(relaxed.positions)[rows, columns].copy()
    nodes[..., 0] += turns_x * relaxed.lengths[0]
    nodes[..., 1] += turns_y * relaxed.lengths[1]
    return Configuration(nodes, np.asarray(flat_sheet(net, fabric).lengths))
