"""Fabrics that several tests share, made of the shipped stripe tables."""

from copy import copy
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from knitlab.model.cell_grid import CellGrid
from knitlab.model.energy import (
    LANES,
    ElementHessians,
    Energy,
    Evaluation,
    Stage,
    element_vectors,
    energy,
    hinge_stiffness,
    spring_stiffness,
    wall_stiffness,
)
from knitlab.model.fabric import Configuration, Fabric
from knitlab.model.inertia import inertia
from knitlab.model.layout import fabric_layout
from knitlab.model.network import MeshShape, Network
from knitlab.model.pattern import PatchGrid, graded_pattern
from knitlab.model.pure_stripe import tension_across
from knitlab.model.settings import FoldAngle, ModelOptions, PlainKnit, Sheet
from knitlab.model.stripe import Knit, Stripe
from knitlab.model.stripe_numbers import StripePair
from knitlab.model.zigzag import tension
from knitlab.runs.parameters import defaults
from knitlab.solvers.dynamics.damped_test import MovingFabrics
from knitlab.solvers.dynamics.grid import Shape
from knitlab.solvers.dynamics.settings import Dynamics
from knitlab.solvers.equilibrium.contact_barrier import Barrier
from knitlab.solvers.equilibrium.settings import Solver
from knitlab.solvers.equilibrium.state import State, TensileTest
from knitlab.solvers.equilibrium.system import System
from knitlab.solvers.equilibrium.tensile_test import relax, stretch
from knitlab.solvers.loads import WARP
from knitlab.solvers.loads.load import Load

PARAMETERS = defaults()
SHEET = Sheet(z_max=6.0, k_wall=100.0)
PERIODIC = ModelOptions(cell_size="relaxed", boundary="periodic")
CLAMPED = ModelOptions(cell_size="relaxed", boundary="clamped")
"""Longer cells than those of the default options: they fold more easily and snap, which is a harder
test of solvers."""
DEFAULT = Solver()
FINE = Solver(tolerance=1e-12)
compiled_tension = jax.jit(tension)
compiled_tension_across = jax.jit(tension_across)
"""Tension of a zigzag, and of a sheet, compiled; otherwise every call would compile its root finder
again."""


def assemble_fabric(
    pattern: PatchGrid,
    weft: Stripe,
    warp: Stripe,
    sheet: Sheet,
    options: ModelOptions,
    plain: PlainKnit | None = None,
) -> tuple[Network, Fabric]:
    """Network and parameters of a patterned fabric of one rib and one garter stripe."""
    layout = fabric_layout(pattern, sheet, options, plain)
    return layout.net, layout.fabric(StripePair.of([weft], [warp]))


def stripe(knit: Knit, n: int) -> Stripe:
    return PARAMETERS.stripes.stripe(knit, n)


ALL_STRIPES = [stripe("rib", n) for n in (2, 4, 6, 8)] + [
    stripe("garter", n) for n in (4, 6, 8, 12, 16)
]
DISTINCT_STRIPES = pytest.mark.parametrize(
    "of",
    [
        stripe("rib", 4),
        stripe("garter", 16),
        pytest.param(stripe("rib", 2), marks=pytest.mark.slow),
        pytest.param(stripe("garter", 8), marks=pytest.mark.slow),
    ],
    ids=lambda of: f"{of.knit} {of.n}",
)
"""Two typical stripes, and those of the largest and the smallest rest angle."""


def patch_map(rows: list[str], periods: int) -> PatchGrid:
    """Equal patches, top course first."""
    return graded_pattern(tuple(rows), periods)


def patterned(
    n_stripe: int, pattern: PatchGrid, options: ModelOptions, sheet: Sheet = SHEET
) -> tuple[Network, Fabric]:
    return assemble_fabric(
        pattern, stripe("rib", n_stripe), stripe("garter", 2 * n_stripe), sheet, options
    )


def checkerboard(periods: int, unit_cells: tuple[int, int] = (1, 1)) -> PatchGrid:
    """The paper's fabric: numbers of unit cells along (y, x), each of 2 × 2 alternating patches."""
    return patch_map(["GR", "RG"], periods).tiled(unit_cells)


def checkered(
    n_stripe: int, periods: int, options: ModelOptions, unit_cells: tuple[int, int] = (1, 1)
) -> tuple[Network, Fabric]:
    return patterned(n_stripe, checkerboard(periods, unit_cells), options)


def pure(
    of: Stripe, options: ModelOptions, periods: int = 1, ridges: str | None = None
) -> tuple[Network, Fabric]:
    """A pure stripe; ``ridges`` "R" or "G" lays them along y or x, whatever its knit."""
    letter = ridges or ("R" if of.knit == "rib" else "G")
    pattern = replace(patch_map([letter], periods), cells_per_period=options.cells_per_period)
    return assemble_fabric(pattern, of, of, SHEET, options)


def cell_of(fabric: Fabric) -> np.ndarray:
    """Sides (x, y) of the grid cells of a fabric whose cells are all equal."""
    return np.array([fabric.cell_x[0], fabric.cell_y[0]])


def equations(net: Network, fabric: Fabric, contact: Barrier | None = None) -> System:
    """What the solvers solve for a fabric."""
    return System(net.shape, fabric, contact=contact)


def unchecked(settings: Solver, **values: float) -> Solver:
    """Settings with values that users cannot give."""
    changed = copy(settings)
    for name, value in values.items():
        object.__setattr__(changed, name, value)
    return changed


def staged(fabric: Fabric, stage: Stage) -> Fabric:
    """The fabric at a stage of a continuation."""
    acting = stage.fold * fabric.rest_fold, stage.wall * fabric.k_wall
    return eqx.tree_at(lambda of: (of.rest_fold, of.k_wall), fabric, acting)


def evaluate_whole(net: Network, fabric: Fabric, stage: Stage, unknowns: np.ndarray) -> Evaluation:
    """Energy and gradient by automatic differentiation of the energy of the whole network."""

    def total(at: jax.Array) -> tuple[jax.Array, Energy]:
        parts = energy(net, staged(fabric, stage), Configuration.of(at, net.shape))
        return parts.total, parts

    gradient, parts = jax.grad(total, has_aux=True)(unknowns)
    return Evaluation(parts, gradient)


def padded_hinge_stiffness(
    vectors: jax.Array, rest: np.ndarray, stiffness: np.ndarray, of: FoldAngle
) -> jax.Array:
    """Hessians of any number of hinges; the last block is padded with copies without stiffness."""
    spare = (0, -len(rest) % LANES)
    filled = jnp.pad(vectors, ((0, 0), (0, 0), spare), mode="edge")
    return hinge_stiffness(filled, jnp.pad(rest, spare), jnp.pad(stiffness, spare), of)


def whole_element_hessians(
    net: Network, fabric: Fabric, stage: Stage, unknowns: np.ndarray
) -> ElementHessians:
    """Element Hessians of the whole network, computed without chunks."""
    acting, at = staged(fabric, stage), Configuration.of(jnp.asarray(unknowns), net.shape)
    springs, hinges = (element_vectors(each, at) for each in (net.springs, net.hinges))
    heights = at.positions[..., 2].ravel()
    return ElementHessians(
        spring_stiffness(
            springs[0], acting.rest_length, acting.stretch_stiffness, acting.spring_law
        ),
        padded_hinge_stiffness(hinges, acting.rest_fold, acting.fold_stiffness, acting.fold_angle),
        wall_stiffness(heights, acting.z_max, acting.k_wall),
    )


def relaxed(net: Network, fabric: Fabric, settings: Solver = DEFAULT) -> State:
    return relax(equations(net, fabric), settings)


def stretched(
    net: Network,
    fabric: Fabric,
    strains: list[float],
    settings: Solver = DEFAULT,
) -> TensileTest:
    return stretch(equations(net, fabric), strains, settings)


def moving(
    designs: list[tuple[int, int]],
    options: ModelOptions,
    settings: Dynamics,
    unit_cells: tuple[int, int] = (1, 1),
    damping_ratios: list[float] | None = None,
    load: Load = WARP,
) -> MovingFabrics:
    """Checkerboards (n_stripe, periods) of one mesh shape, as a batch for the dynamics.

    Args:
        designs: the checkerboards.
        options: model options.
        settings: settings of the dynamics.
        unit_cells: unit cells along (y, x).
        damping_ratios: damping ratio of each, if not that of the settings.
        load: of the test of each.
    """
    assembled = [checkered(*design, options, unit_cells) for design in designs]
    ratios = damping_ratios or [settings.damping_ratio] * len(designs)
    inertias = [
        inertia(
            [stripe("rib", n)], [stripe("garter", 2 * n)], options, settings.surface_density, ratio
        )
        for (n, _), ratio in zip(designs, ratios, strict=True)
    ]
    return MovingFabrics(
        assembled[0][0].shape,
        [fabric for _, fabric in assembled],
        inertias,
        settings,
        [load] * len(designs),
    )


def off_grid(shape: Shape) -> Configuration:
    """What the dynamics hold, as a configuration."""
    return Configuration(jnp.stack(shape.positions, axis=-1), shape.lengths)


def periodic_poisson_ratio(test: TensileTest) -> np.ndarray:
    """ν of periodic fabric, computed from L_x and L_y."""
    lengths = np.array([state.configuration.lengths for state in test.states])
    strain = lengths[1:] / lengths[0] - 1
    return -strain[:, 0] / strain[:, 1]


def shaken(configuration: Configuration, amplitude: float, seed: int = 0) -> Configuration:
    random = np.random.default_rng(seed)
    return jax.tree.map(
        lambda part: part + amplitude * random.normal(size=part.shape), configuration
    )


def even_cells(shape: MeshShape, unit_cells: tuple[int, int]) -> CellGrid:
    """Equal unit cells, with their numbers along (y, x)."""
    along_y, along_x = unit_cells
    rows = range(0, shape.cells_y + 1, shape.cells_y // along_y)
    columns = range(0, shape.cells_x + 1, shape.cells_x // along_x)
    return CellGrid(tuple(rows), tuple(columns))
