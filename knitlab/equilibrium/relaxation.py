"""Relaxation: the flat sheet taken off the needles folds into its corrugated shape."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from knitlab.equilibrium.domain_decomposition import find_equilibrium_by_subdomains
from knitlab.equilibrium.equilibrium_search import SearchRules
from knitlab.equilibrium.loading import all_free, between_walls, rigidly_aligned
from knitlab.equilibrium.settings import SolverSettings
from knitlab.equilibrium.state import State
from knitlab.equilibrium.subdomains import worth_dividing
from knitlab.equilibrium.system import System
from knitlab.fabric.configuration import Configuration
from knitlab.fabric.energy import COMPLETE, Point, Stage
from knitlab.fabric.fabric import Fabric, flat_sheet
from knitlab.fabric.network import network

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

    Args:
        system: the equations of the fabric.
        settings: settings of the equilibrium solver.
        start: configuration to start from; the flat sheet by default.
        contact: contact of the fabric with itself, if any.
    """
    shape, fabric = system.shape, system.fabric
    whole = SearchRules.of(shape, all_free(shape), fabric, settings, contact=contact)
    # From a flat sheet, round-off of single precision may decide which shape is reached.
    whole = replace(whole, exact=not worth_dividing(shape))
    flat = flat_sheet(network(shape), fabric)
    begin = np.asarray((flat if start is None else start).flattened())
    waypoint = intermediate_settings(settings, fabric)
    stages = [(stage, waypoint) for stage in _stages(settings)] + [(COMPLETE, settings)]
    passed: list[State] = []
    # A convexified stiffness would rotate a sample with free edges slightly at every step.
    for convexified in (True, False) if shape.periodic else (False,):
        unknowns = begin
        for stage, stage_settings in stages:
            rules = replace(whole, settings=stage_settings, convexified=convexified)
            at = Point(unknowns, stage)
            passed.append(find_equilibrium_by_subdomains(system, at, rules, patience=None))
            unknowns = passed[-1].unknowns
        if passed[-1].converged:
            break
    if passed[-1].converged and not shape.periodic:
        aligned = rigidly_aligned(shape, flat, passed[-1].configuration)
        fitting = between_walls(aligned, float(fabric.z_max))
        rules = replace(whole, convexified=False)
        at = Point(np.asarray(fitting.flattened()))
        passed.append(find_equilibrium_by_subdomains(system, at, rules, patience=None))
    return passed[-1].after(*passed[:-1])


def relax_near(
    system: System,
    settings: SolverSettings,
    start: Configuration,
    contact: "Barrier | None" = None,
) -> State:
    """The relaxed shape next to a configuration that is nearly in equilibrium.

    Args:
        system: the equations of the fabric.
        settings: settings of the equilibrium solver.
        start: the configuration [mm].
        contact: contact of the fabric with itself, if any.
    """
    free = all_free(system.shape)
    rules = SearchRules.of(system.shape, free, system.fabric, settings, contact=contact)
    rules = replace(rules, convexified=False)
    begin = Point(np.asarray(start.flattened()))
    return find_equilibrium_by_subdomains(system, begin, rules)


def intermediate_settings(settings: SolverSettings, fabric: Fabric) -> SolverSettings:
    """Settings for an intermediate state, which need not be in exact equilibrium."""
    moments = np.asarray(fabric.fold_stiffness) * np.abs(fabric.rest_fold)
    near = settings.waypoint_force * float(moments.max() / fabric.cell_sides.min())
    return replace(settings, tolerance=max(settings.tolerance, near))


def _stages(settings: SolverSettings) -> Iterator[Stage]:
    """All stages before the complete fabric."""
    for step in range(1, settings.ramp_steps):
        yield Stage(step / settings.ramp_steps, settings.soft_wall)
    for decade in range(math.ceil(-math.log10(settings.soft_wall))):
        yield Stage(1.0, settings.soft_wall * 10.0**decade)
