"""Boundary elements against FastCap2: ``python -m benchmarks.capacitance``.

Both cut the same conductors into the same panels, ever finer, and find the capacitance between
the two. The command prints how long each took and how far it was off, and from that how long each
takes for one accuracy. FastCap2 uses one processor; for knitlab set ``PJRT_NPROC=1`` to compare
like with like. Nothing of it is a test: figures depend on the machine.
"""

import importlib
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from statistics import median
from typing import Any

import click
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from knitlab.observables.capacitance.boundary_elements import (
    maxwell_matrices,
    near_pairs,
    two_terminal,
)
from knitlab.observables.capacitance.maxwell import STATES_AT_ONCE
from knitlab.observables.capacitance.panels import graded

Panels = Float[np.ndarray, "panel 4 3"]
Pair = tuple[Panels, Panels]

PLATE, APART = 1.0, 0.2
"""Side of the plates and distance between them [mm]."""
FLANK, ANGLE, RIDGE = 1.0, 1.0, 10
"""Width of a flank [mm], angle between two of them [rad], and the ridges' length in flanks."""
REFINEMENTS = (1, 2, 3, 4)
DOUBLED = ((0, 1), (1, 3))
"""Which of them are twice as fine as which."""
REFERENCE = (6, 12, 24)
"""Refinements that the reference is extrapolated from."""
PICOFARADS = 1e9
"""FastCap2 counts metres and farads; here lengths are mm."""


@dataclass(frozen=True)
class Shape:
    """A pair of conductors, as finely cut as one likes."""

    name: str
    cut: Callable[[int], Pair]


@dataclass(frozen=True)
class Method:
    """A way to find the capacitance between two conductors.

    Attributes:
        name: what it is called in the table.
        solve: the capacitance [pF].
        states: states that one call solves, which share its time.
    """

    name: str
    solve: Callable[[Pair], float]
    states: int = 1


@dataclass(frozen=True)
class Row:
    """One solution, of panels of one size.

    Attributes:
        panels: number of panels.
        seconds: time for a state.
        capacitance: as found [pF].
        error: how far that is from the reference, over it.
    """

    panels: int
    seconds: float
    capacitance: float
    error: float


@click.command()
@click.option("--accuracy", default=0.01, show_default=True, help="Error to compare times at.")
@click.option("--repeats", default=3, show_default=True, help="Runs of which the median counts.")
def main(accuracy: float, repeats: int) -> None:
    """Compare time and error of knitlab's boundary elements with FastCap2's."""
    try:
        fastcap = importlib.import_module("fastcap2")
    except ImportError:
        click.echo("FastCap2 is not installed; pip install fastcap2", err=True)
        sys.exit(2)
    methods = (
        Method("knitlab, one state", lambda pair: by_elements(pair, 1)),
        Method(
            f"knitlab, {STATES_AT_ONCE} states",
            lambda pair: by_elements(pair, STATES_AT_ONCE),
            STATES_AT_ONCE,
        ),
        Method("FastCap2 as it comes", lambda pair: by_fastcap(fastcap, pair, 2, 1e-2)),
        Method("FastCap2, order 4", lambda pair: by_fastcap(fastcap, pair, 4, 1e-4)),
    )
    for shape in (Shape("square plates", plates), Shape("open ridges", ridges)):
        reference = limit(*(by_fastcap(fastcap, shape.cut(level), 6, 1e-6) for level in REFERENCE))
        click.echo(f"{shape.name}, {reference:.6g} pF")
        click.echo(f"{'method':29}{'panels':>7}{'seconds':>10}{'pF':>11}{'error':>11}")
        reached = []
        for method in methods:
            rows = list(measured(method, shape, reference, repeats))
            limits = [extrapolated(rows[one], rows[other], reference) for one, other in DOUBLED]
            for name, of in ((method.name, rows), (f"{method.name}, limit", limits)):
                for row in of:
                    click.echo(
                        f"{name:29}{row.panels:7d}{row.seconds:10.4f}{row.capacitance:11.6f}"
                        f"{row.error:11.2e}"
                    )
                reached.append(f"{name:29}{time_for(accuracy, of)}")
        click.echo(f"time for an error of {accuracy:g}")
        click.echo("\n".join([*reached, ""]))


def measured(method: Method, shape: Shape, reference: float, repeats: int) -> Iterator[Row]:
    """Solutions by one method, from coarse panels to fine ones."""
    for level in REFINEMENTS:
        pair = shape.cut(level)
        # The first call compiles.
        found = method.solve(pair)
        seconds = []
        for _ in range(repeats):
            began = time.perf_counter()
            found = method.solve(pair)
            seconds.append((time.perf_counter() - began) / method.states)
        panels = sum(map(len, pair))
        yield Row(panels, median(seconds), found, abs(found / reference - 1))


def by_elements(pair: Pair, states: int) -> float:
    """Capacitance by knitlab's boundary elements, of so many states at once [pF]."""
    panels = np.repeat(np.concatenate(pair)[None], states, axis=0)
    membership = np.repeat(np.eye(2), [len(each) for each in pair], axis=0)
    near = jnp.asarray(near_pairs(panels))
    matrices = maxwell_matrices(jnp.asarray(panels), jnp.asarray(membership), near)
    return float(two_terminal(np.asarray(matrices))[0])


def by_fastcap(fastcap: Any, pair: Pair, order: int, tolerance: float) -> float:
    """Capacitance by FastCap2, with multipoles of an order and iterations to a tolerance [pF]."""
    problem = fastcap.Problem()
    problem.expansion_order, problem.iter_tol = order, tolerance
    for name, panels in zip("AB", pair, strict=True):
        surface = fastcap.Surface(name)
        for panel in panels.tolist():
            surface.add_quad(*map(tuple, panel))
        problem.add(surface)
    return PICOFARADS * float(two_terminal(np.array(problem.solve())))


def plates(level: int) -> Pair:
    """Two square plates above each other."""
    lines = PLATE * graded(level, low_free=True, high_free=True)
    lower = sheet(lines, np.stack([lines, 0 * lines], axis=-1))
    return lower, lower + np.array([0, 0, APART])


def ridges(level: int) -> Pair:
    """Two ridges of a folded zigzag strip, beside each other."""
    flank = graded(level, low_free=True, high_free=False)
    x, z = (FLANK * part for part in (np.sin(ANGLE / 2), np.cos(ANGLE / 2)))
    half = np.stack([x * (flank - 1), z * flank], axis=-1)
    outline = np.concatenate([half, half[-2::-1] * [-1, 1]])
    cells = [
        cell + graded(level, cell == 0, cell == RIDGE - 1)[(cell > 0) :] for cell in range(RIDGE)
    ]
    ridge = sheet(FLANK * np.concatenate(cells), outline)
    return ridge, ridge + np.array([4 * x, 0, 0])


def sheet(y: Float[np.ndarray, " line"], outline: Float[np.ndarray, "point 2"]) -> Panels:
    """Panels of a sheet that runs along y on an outline (x, z)."""
    points = np.empty((len(y), len(outline), 3))
    points[..., 0], points[..., 2] = outline.T
    points[..., 1] = y[:, None]
    corners = points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]
    return np.stack(corners, axis=2).reshape(-1, 4, 3)


def extrapolated(coarse: Row, fine: Row, reference: float) -> Row:
    """What is made of two solutions, one twice as fine, if they converge by the second order."""
    value = fine.capacitance + (fine.capacitance - coarse.capacitance) / 3
    seconds = coarse.seconds + fine.seconds
    return Row(fine.panels, seconds, value, abs(value / reference - 1))


def limit(coarse: float, middle: float, fine: float) -> float:
    """Limit of three solutions, each twice as fine, whatever their order (Aitken)."""
    return fine + (fine - middle) ** 2 / ((middle - coarse) - (fine - middle))


def time_for(accuracy: float, rows: list[Row]) -> str:
    """Time for an error, between the rows on either side of it, on logarithmic scales."""
    if rows[0].error <= accuracy:
        return f"less than {rows[0].seconds:.4f} s"
    for row, finer in pairwise(rows):
        if finer.error <= accuracy:
            part = np.log(row.error / accuracy) / np.log(row.error / finer.error)
            return f"{row.seconds * (finer.seconds / row.seconds) ** part:.4f} s"
    return f"more than {rows[-1].seconds:.4f} s"


if __name__ == "__main__":
    main()
