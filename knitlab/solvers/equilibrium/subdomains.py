"""Subdomains: overlapping rectangles of a large sample, each with its boundary held."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import jax
import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int

from knitlab.model.fabric import Fabric
from knitlab.model.network import MeshShape, network
from knitlab.solvers.equilibrium.stiffness import FreeStiffness, free_stiffness

CELLS = 24
"""Grid cells along each side of a subdomain, without its overlap: with fewer, most of the work is
in the overlap; with more, a snap in one place takes longer."""
OVERLAP = 4  # grid cells by which neighbouring subdomains overlap
REACH = 2  # extent of an element in grid cells, and so the width of the held boundary
MIN_SUBDOMAINS = 6  # number of subdomains from which domain decomposition pays off


@dataclass(frozen=True, eq=False)
class Subdomain:
    """A rectangle of a sample."""

    dofs: Int[np.ndarray, " unknown"]  # its unknowns among those of the sample, with L_x and L_y
    free: FreeStiffness
    springs: Int[np.ndarray, " spring"]  # their indices in the sample
    hinges: Int[np.ndarray, " hinge"]

    def fabric(self, whole: Fabric) -> Fabric:
        """The sample's fabric in the subdomain."""

        def of_elements(chosen: Int[np.ndarray, " element"], *names: str) -> dict[str, Any]:
            # NumPy indexes without compiling, which JAX does for every size.
            whole_values = {name: getattr(whole, name) for name in names}
            return jax.tree.map(lambda values: np.asarray(values)[chosen], whole_values)

        springs = of_elements(self.springs, "rest_length", "stretch_stiffness", "spring_law")
        return replace(whole, **springs, **of_elements(self.hinges, "rest_fold", "fold_stiffness"))

    def force(self, gradient: Float[np.ndarray, " whole"]) -> float:
        """Largest force on its free unknowns [N]."""
        return float(np.abs(gradient[self.dofs[self.free.dofs]]).max(initial=0.0))


def worth_dividing(shape: MeshShape) -> bool:
    """Whether a rectangular sample has enough subdomains for them to pay off."""
    return (
        not shape.periodic
        and shape.spans is None
        and len(_spans(shape.cells_y)) * len(_spans(shape.cells_x)) >= MIN_SUBDOMAINS
    )


def grid_subdomains(free: FreeStiffness) -> Iterator[Subdomain]:
    """The subdomains of a sample with these free unknowns."""
    shape = free.shape
    net = network(free.shape)
    movable = np.zeros(shape.unknowns, dtype=bool)
    movable[free.dofs] = True
    for rows in _spans(shape.cells_y):
        for columns in _spans(shape.cells_x):
            (bottom, top), (left, right) = (
                (max(low - REACH, 0), min(high + REACH, cells))
                for (low, high), cells in ((rows, shape.cells_y), (columns, shape.cells_x))
            )
            row, column = np.mgrid[bottom : top + 1, left : right + 1].reshape(2, -1)
            nodes = row * shape.nodes_x + column
            own_shape = MeshShape(top - bottom, right - left, periodic=False)
            dofs = np.append(
                (3 * nodes[:, None] + np.arange(3)).ravel(), shape.unknowns - np.array([2, 1])
            )
            inner = (row >= rows[0]) & (row <= rows[1])
            inner &= (column >= columns[0]) & (column <= columns[1])
            movable_here = np.append(np.repeat(inner, 3), [False, False]) & movable[dofs]
            within = np.zeros(shape.nodes, dtype=bool)
            within[nodes] = True
            yield Subdomain(
                dofs,
                free_stiffness(own_shape, np.flatnonzero(movable_here)),
                *(
                    np.flatnonzero(within[elements.nodes].all(axis=1))
                    for elements in (net.springs, net.hinges)
                ),
            )


def couplings(
    subdomains: Sequence[Subdomain], unknowns: int
) -> Bool[np.ndarray, "subdomain subdomain"]:
    """Which pairs of subdomains are coupled: free unknowns of one affect the other."""

    def membership(sets: Sequence[Int[np.ndarray, " _"]]) -> sp.csr_array:
        ends = np.cumsum([0, *map(len, sets)])
        return sp.csr_array(
            (np.ones(ends[-1]), np.concatenate(sets), ends), shape=(len(sets), unknowns)
        )

    touched = membership([subdomain.dofs for subdomain in subdomains])
    free = membership([subdomain.dofs[subdomain.free.dofs] for subdomain in subdomains])
    coupled = (touched @ free.T).toarray() > 0
    return coupled | coupled.T | np.eye(len(subdomains), dtype=bool)


def independent_groups(
    forces: Float[np.ndarray, " subdomain"], coupled: Bool[np.ndarray, "subdomain subdomain"]
) -> Iterator[list[int]]:
    """Groups of uncoupled subdomains, those with the largest forces first."""
    waiting = np.argsort(-forces).tolist()
    while waiting:
        group: list[int] = []
        for subdomain in waiting:
            if not coupled[subdomain, group].any():
                group.append(subdomain)
        waiting = [subdomain for subdomain in waiting if subdomain not in group]
        yield group


def _spans(cells: int) -> list[tuple[int, int]]:
    """First and last node row (or column) of the free part of every subdomain along a side."""
    lines = np.linspace(0, cells, max(1, round(cells / CELLS)) + 1).round().astype(int)
    return [
        (max(low - OVERLAP, 0), min(high + OVERLAP, cells))
        for low, high in pairwise(lines.tolist())
    ]
