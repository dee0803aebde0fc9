"""Energy and gradient on the grid: against those of the network, and against differences."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from knitlab.model.energy import energy
from knitlab.model.fabric import flat_sheet
from knitlab.model.layout import fabric_layout
from knitlab.model.pattern import Grading, SingleFold, graded_pattern
from knitlab.model.settings import ModelOptions, PlainKnit
from knitlab.model.spring_curve import SpringCurve
from knitlab.model.stripe_numbers import StripePair
from knitlab.solvers.dynamics.damped_test import on_grid
from knitlab.solvers.dynamics.grid import GridFabric
from knitlab.solvers.dynamics.vectors import materialised
from tests.fabrics import SHEET, assemble_fabric, checkerboard, off_grid, shaken, stripe

CURVE = SpringCurve((0.0, 0.02, 0.05, 0.1, 0.2), (0.0, 1.0, 4.0, 13.0, 40.0))
LAWS = {"linear": {}, "stiffening": {"stiffening_strain": 0.1}, "measured": {"spring_curve": CURVE}}
BOUNDARIES = ("clamped", "periodic")
ROUNDING = 1e-10
LOW = 0.05
"""Half the gap between walls that nodes lie beyond [mm]."""


def checkered(options, weft=None, warp=None, unit_cells=(1, 1)):
    """A checkerboard whose stripes have laws of their own."""
    rib, garter = (
        replace(of, **(law or {}))
        for of, law in ((stripe("rib", 4), weft), (stripe("garter", 8), warp))
    )
    pattern = replace(checkerboard(1, unit_cells), cells_per_period=options.cells_per_period)
    return assemble_fabric(pattern, rib, garter, SHEET, options)


def graded(options):
    """Two ribs and two garters, plain knit beside them, and a single fold."""
    ribs, garters = [stripe("rib", n) for n in (4, 6)], [stripe("garter", n) for n in (8, 12)]
    grading = Grading((1, 2), (1, 1, 2), (garters[1], garters[0]), (*ribs, ribs[0]))
    fold = SingleFold(along="wale", at=2.5, theta_0=2.2, end=1)
    pattern = graded_pattern(("GRP", "RGP"), 1, (1, 1), grading, (fold,), options.cells_per_period)
    plain = PlainKnit(
        plain_stretch_weft=0.9, plain_stretch_warp=2.5, plain_bend_weft=0.02, plain_bend_warp=0.05
    )
    layout = fabric_layout(pattern, SHEET, options, plain)
    return layout.net, layout.fabric(StripePair.of(grading.weft, grading.warp))


def assert_equals_the_network(net, fabric, seeds):
    fabric = replace(fabric, z_max=jnp.asarray(LOW))
    flat = flat_sheet(net, fabric)
    grid = GridFabric.of(net.shape, fabric)
    of_network = jax.jit(lambda at: energy(net, fabric, at))
    slope_of_network = jax.jit(jax.grad(lambda at: energy(net, fabric, at).total))
    of_grid, slope_of_grid = jax.jit(GridFabric.energy), jax.jit(GridFabric.gradient)
    for seed in seeds:
        at = jax.tree.map(jnp.asarray, shaken(flat, 0.2, seed))
        found, expected = of_grid(grid, on_grid(at)), of_network(at)
        for part in ("stretch", "fold", "wall"):
            assert float(getattr(found, part)) == pytest.approx(
                float(getattr(expected, part)), rel=ROUNDING
            )
        assert float(expected.wall) > 0
        slope = np.asarray(off_grid(slope_of_grid(grid, on_grid(at))).flattened())
        slope_expected = np.asarray(slope_of_network(at).flattened())
        largest = np.abs(slope_expected).max()
        np.testing.assert_allclose(slope, slope_expected, rtol=0, atol=ROUNDING * largest)


@pytest.mark.parametrize("boundary", BOUNDARIES)
@pytest.mark.parametrize("fold_angle", ["whole_normals", "across_edge"])
@pytest.mark.parametrize("hinges", ["all", "fold_lines"])
def test_energy_and_gradient_are_those_of_the_network(boundary, fold_angle, hinges):
    options = ModelOptions(boundary=boundary, fold_angle=fold_angle, hinges=hinges)
    assert_equals_the_network(*checkered(options, unit_cells=(2, 1)), range(3))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("boundary", "weft", "warp"),
    [
        pytest.param("periodic", "linear", "stiffening", marks=pytest.mark.nightly),
        ("clamped", "stiffening", "measured"),
        pytest.param("periodic", "measured", "linear", marks=pytest.mark.nightly),
    ],
)
def test_they_are_for_every_spring_law(boundary, weft, warp):
    options = ModelOptions(boundary=boundary)
    assert_equals_the_network(*checkered(options, LAWS[weft], LAWS[warp]), range(2))


@pytest.mark.slow
@pytest.mark.parametrize("boundary", BOUNDARIES)
@pytest.mark.parametrize("cells_per_period", [4, pytest.param(8, marks=pytest.mark.nightly)])
def test_they_are_for_graded_and_plain_patches_and_single_folds(boundary, cells_per_period):
    options = ModelOptions(boundary=boundary, cells_per_period=cells_per_period)
    assert_equals_the_network(*graded(options), range(2))


@pytest.mark.slow
@pytest.mark.nightly
@settings(max_examples=4)  # each is compiled
@given(
    rows=st.integers(1, 3),
    columns=st.integers(1, 3),
    boundary=st.sampled_from(BOUNDARIES),
    fold_angle=st.sampled_from(["whole_normals", "across_edge"]),
    cell_size=st.sampled_from(["flat", "relaxed"]),
    cells_per_period=st.sampled_from([4, 8]),
    seed=st.integers(0, 1000),
)
def test_they_are_for_every_size(
    rows, columns, boundary, fold_angle, cell_size, cells_per_period, seed
):
    options = ModelOptions(
        boundary=boundary,
        fold_angle=fold_angle,
        cell_size=cell_size,
        cells_per_period=cells_per_period,
    )
    assert_equals_the_network(*checkered(options, unit_cells=(rows, columns)), [seed])


def test_walls_can_be_left_out_of_the_gradient():
    net, fabric = checkered(ModelOptions(boundary="clamped"))
    at = on_grid(shaken(flat_sheet(net, fabric), 0.2))
    low, high = (
        GridFabric.of(net.shape, replace(fabric, z_max=jnp.asarray(gap))) for gap in (LOW, 100.0)
    )
    without = jax.jit(lambda fabric: fabric.gradient(at, walls=False))(low)
    far = jax.jit(lambda fabric: fabric.gradient(at))(high)
    for one, other in zip(jax.tree.leaves(without), jax.tree.leaves(far), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-14, atol=1e-14)


@pytest.mark.skipif(jax.default_backend() != "cpu", reason="only a processor keeps results")
def test_a_program_computes_what_is_kept_once():
    def squares(numbers):
        return numbers * numbers + 1.0

    def neighbours(of, numbers):
        values = of(numbers)
        return values[1:] * values[:-1]

    numbers = jnp.arange(10.0)
    direct, once = (
        jax.jit(lambda x, of=of: neighbours(of, x)) for of in (squares, materialised(squares))
    )
    np.testing.assert_array_equal(direct(numbers), once(numbers))
    loops = [
        program.lower(numbers).compile().as_text().count(" fusion(") for program in (direct, once)
    ]
    assert loops == [1, 2]
