"""Shapes that a fabric may relax to: from many sheets, without copies, and energies between them.

Shapes that a symmetry of the fabric maps to each other have the same energy and the same fold
angles in another order. The highest energy on a path between two shapes estimates the barrier
between them (string method: E, Ren, Vanden-Eijnden, Phys. Rev. B 66, 052301, 2002).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float
from scipy.interpolate import CubicSpline
from scipy.ndimage import fourier_gaussian
from scipy.sparse.linalg import splu

from knitlab.io.progress import counter, each
from knitlab.model.energy import Point, fold_angles
from knitlab.model.fabric import Configuration, Fabric, Unknowns, flat_sheet
from knitlab.model.network import Network
from knitlab.solvers.branches.equations import symmetric_stiffness
from knitlab.solvers.element_chunks import ChunkedFabric
from knitlab.solvers.equilibrium.equilibrium import run_each
from knitlab.solvers.equilibrium.settings import Solver
from knitlab.solvers.equilibrium.state import State
from knitlab.solvers.equilibrium.stiffness import free_stiffness
from knitlab.solvers.equilibrium.system import System
from knitlab.solvers.equilibrium.tensile_test import relax, relax_near
from knitlab.solvers.loads.loading import all_free

SAME_ENERGY = 1e-6  # difference of two energies of one shape, over the energy
SAME_ANGLE = 1e-3  # root mean square difference of the sorted fold angles of one shape [rad]
IMAGES = 15  # of a path between two shapes
SWEEPS = 300
STIFFER = 0.02  # stiffness that is added for a step of a path, over the median
DAMPING = 0.05  # share of that step that is taken


@dataclass(frozen=True)
class RelaxedShape:
    """A shape in equilibrium, and the starts that led to it or to a mirror image of it."""

    state: State
    angles: Float[np.ndarray, " hinge"]  # absolute fold angles, ascending [rad]
    starts: int

    @property
    def energy(self) -> float:
        """Elastic energy [N mm]."""
        return float(self.state.energy.total)


def relaxed_shapes(
    net: Network, fabric: Fabric, settings: Solver, starts: int
) -> tuple[list[RelaxedShape], int]:
    """The shapes that sheets relax to, the lowest energy first, and starts that did not converge.

    The first start is the flat sheet; others have reproducible noise, smooth over 1 to 8 cells.
    """
    sheets = [None if k == 0 else _rough_sheet(net, fabric, k) for k in range(starts)]
    count = counter(starts, "start")
    searches = [
        partial(_relaxed_from, settings=settings, start=sheet, ended=count) for sheet in sheets
    ]
    states = run_each(net.shape, [fabric] * starts, searches)
    stiffness = np.asarray(fabric.fold_stiffness)
    scale = float(0.5 * stiffness @ np.asarray(fabric.rest_fold) ** 2)
    stiff = stiffness > 0
    shapes = list[RelaxedShape]()
    for state in states:
        if not state.converged:
            continue
        angles = np.sort(np.abs(fold_angles(net, fabric, state.configuration)[stiff]))
        found = RelaxedShape(state, angles, 1)
        for k, known in enumerate(shapes):
            difference = np.sqrt(np.mean((angles - known.angles) ** 2))
            margin = SAME_ENERGY * (abs(known.energy) + 1e-3 * scale)
            if abs(found.energy - known.energy) <= margin and difference <= SAME_ANGLE:
                shapes[k] = replace(known, starts=known.starts + 1)
                break
        else:
            shapes.append(found)
    failed = sum(not state.converged for state in states)
    return sorted(shapes, key=lambda shape: shape.energy), failed


def _relaxed_from(
    system: System, settings: Solver, start: Configuration | None, ended: Callable[[], None]
) -> State:
    state = relax(system, settings, start)
    # Without stages of the walls: a shape between them may be a rest point only of those.
    settled = relax_near(system, settings, state.configuration) if state.converged else state
    ended()
    return settled if settled.converged else state


def _rough_sheet(net: Network, fabric: Fabric, seed: int) -> Configuration:
    flat = flat_sheet(net, fabric)
    random = np.random.default_rng(seed)
    side = float(np.asarray(fabric.cell_sides).min())
    positions = np.asarray(flat.positions)
    noise = random.normal(size=positions.shape)
    width = random.uniform(1, 8) / np.sqrt(2)
    smooth = fourier_gaussian(np.fft.fft2(noise, axes=(0, 1)), (width, width, 0))
    noise = np.fft.ifft2(smooth, axes=(0, 1)).real
    noise *= random.uniform(0.05, 0.5) * side / noise.std()
    return Configuration(positions + noise, np.asarray(flat.lengths))


def barriers(system: System, shapes: Sequence[RelaxedShape]) -> Float[np.ndarray, "shape shape"]:
    """Estimated energy to go from one shape (row) to another (column), 0 on the diagonal [N mm]."""
    energies = np.zeros((len(shapes), len(shapes)))
    for j, i in each([*combinations(range(len(shapes)), 2)], "path"):
        one, other = shapes[i], shapes[j]
        top = highest_between(system, one.state.unknowns, other.state.unknowns)
        energies[i, j] = top - one.energy
        energies[j, i] = top - other.energy
    return energies


def highest_between(system: System, one: Unknowns, other: Unknowns) -> float:
    """The highest energy on a path of least energy that a string relaxes to [N mm]."""
    shape = system.shape
    moved = other.copy()
    top = float(system.evaluate(Point(other)).energy.total)
    nodes, own = (each[: 3 * shape.nodes].reshape(-1, 3) for each in (moved, one))
    drift = (own - nodes).mean(axis=0)
    nodes += drift
    if float(system.evaluate(Point(moved)).energy.total) > top * (1 + 1e-9):
        nodes[:, 2] -= drift[2]  # between walls that it touches
    string = np.linspace(0, 1, IMAGES)[:, None] * (moved - one) + one
    descent = _descent(system, one)
    energies = np.zeros(IMAGES)
    for _ in range(SWEEPS):
        for k, image in enumerate(string):
            evaluation = system.evaluate(Point(image))
            energies[k] = float(evaluation.energy.total)
            if 0 < k < IMAGES - 1:
                image -= descent(np.asarray(evaluation.gradient))
        along = np.append(0, np.cumsum(np.linalg.norm(np.diff(string, axis=0), axis=1)))
        string = CubicSpline(along, string)(np.linspace(0, along[-1], IMAGES))
    return float(energies.max())


def _descent(system: System, at: Unknowns) -> Callable[[Unknowns], Unknowns]:
    """Steps against a gradient by the stiffness of a shape, which is soft where the fabric is."""
    free = free_stiffness(system.shape, all_free(system.shape))
    stiffness = symmetric_stiffness(ChunkedFabric(system.shape, system.fabric), free, at)
    shift = STIFFER * float(np.median(stiffness.diagonal()))
    factors = splu(sp.csc_array(stiffness + shift * sp.eye_array(len(free.dofs))))

    def step(gradient: Unknowns) -> Unknowns:
        moved = np.zeros_like(gradient)
        moved[free.dofs] = DAMPING * factors.solve(gradient[free.dofs])
        return moved

    return step
