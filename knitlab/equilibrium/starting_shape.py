"""Starting shapes of a relaxation: imperfect sheets, and samples tiled with periodic fabric."""

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from knitlab.equilibrium.relaxation import relax
from knitlab.equilibrium.runners import run_each
from knitlab.equilibrium.settings import SolverSettings
from knitlab.fabric.configuration import Configuration
from knitlab.fabric.fabric import Fabric, flat_sheet
from knitlab.fabric.network import Network

if TYPE_CHECKING:
    from knitlab.fabric.barrier import Barrier

IMPERFECTION = 0.02
"""Standard deviation of the nodes of an imperfect sheet, over the shorter side of a grid cell."""


def imperfect_sheet(net: Network, fabric: Fabric, seed: int) -> Configuration:
    """A flat sheet with every node displaced slightly, at random.

    Args:
        net: network of the fabric.
        fabric: the fabric.
        seed: seed of the random numbers.
    """
    flat, sides = flat_sheet(net, fabric), np.asarray(fabric.cell_sides)
    noise = np.random.default_rng(seed).normal(size=flat.positions.shape)
    moved = np.asarray(flat.positions) + IMPERFECTION * float(sides.min()) * noise
    return Configuration(moved, np.asarray(flat.lengths))


def starts_from_periodic(
    samples: Sequence[tuple[Network, Fabric]],
    cells: Sequence[tuple[Network, Fabric]],
    settings: Sequence[SolverSettings],
    seed: int | None = None,
    contacts: Sequence["Barrier | None"] = (),
) -> list[Configuration | None]:
    """Starting shapes of samples of one mesh shape, tiled with their relaxed periodic fabrics.

    Args:
        samples: network and fabric of each sample.
        cells: network and fabric of each sample's periodic fabric, all of one mesh shape.
        settings: settings of the equilibrium solver, for each sample.
        seed: seed of the imperfections of the periodic fabrics; without imperfections by default.
        contacts: contact of each periodic fabric with itself; none by default.

    Returns:
        The starting shape of each sample; ``None`` if its periodic fabric did not relax.
    """
    searches = [
        partial(
            relax,
            settings=own_settings,
            start=None if seed is None else imperfect_sheet(*cell, seed),
            contact=contact,
        )
        for cell, own_settings, contact in zip(
            cells, settings, contacts or [None] * len(cells), strict=True
        )
    ]
    relaxed = run_each(cells[0][0].shape, [fabric for _, fabric in cells], searches)
    return [
        tiled(*sample, net, state.configuration) if state.converged else None
        for sample, (net, _), state in zip(samples, cells, relaxed, strict=True)
    ]


def tiled(net: Network, fabric: Fabric, cell: Network, relaxed: Configuration) -> Configuration:
    """A sample tiled with relaxed periodic fabric, in equilibrium except at its edges.

    Args:
        net: network of the sample.
        fabric: its fabric.
        cell: network of the periodic fabric.
        relaxed: its relaxed configuration.
    """
    rows, columns = np.mgrid[: net.shape.nodes_y, : net.shape.nodes_x]
    turns_y, rows = np.divmod(rows, cell.shape.nodes_y)
    turns_x, columns = np.divmod(columns, cell.shape.nodes_x)
    nodes = np.asarray(relaxed.positions)[rows, columns].copy()
    nodes[..., 0] += turns_x * relaxed.lengths[0]
    nodes[..., 1] += turns_y * relaxed.lengths[1]
    return Configuration(nodes, np.asarray(flat_sheet(net, fabric).lengths))
