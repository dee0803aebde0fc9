"""Fabrics with graded or plain patches, or single folds."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from knitlab.model.energy import energy
from knitlab.model.fabric import Configuration, flat_sheet
from knitlab.model.layout import fabric_layout
from knitlab.model.pattern import BadPattern, Grading, SingleFold, graded_pattern
from knitlab.model.settings import ModelOptions, PlainKnit
from knitlab.model.spring_curve import SpringCurve
from knitlab.model.stripe import cell_length
from knitlab.model.stripe_numbers import StripePair
from tests.fabrics import FINE, PERIODIC, SHEET, assemble_fabric, checkerboard, relaxed, stripe

PLAIN = PlainKnit(
    plain_stretch_weft=0.9, plain_stretch_warp=2.5, plain_bend_weft=0.02, plain_bend_warp=0.05
)
FLAT = ModelOptions(boundary="periodic")
RIB = {n: stripe("rib", n) for n in (2, 4, 6, 8)}
GARTER = {n: stripe("garter", 2 * n) for n in (2, 4, 6, 8)}
NUMBERS = (
    "rest_length",
    "stretch_stiffness",
    "rest_fold",
    "fold_stiffness",
    "k_wall",
    "cell_x",
    "cell_y",
)


def graded(rows, row_n, column_n, row_periods, column_periods):
    return Grading(
        tuple(row_periods),
        tuple(column_periods),
        tuple(GARTER[n] for n in row_n),
        tuple(RIB[n] for n in column_n),
    )


def assembled(rows, grading=None, options=FLAT, repeats=(1, 1), folds=(), periods=1):
    pattern = graded_pattern(
        tuple(rows), periods, repeats, grading, tuple(folds), options.cells_per_period
    )
    layout = fabric_layout(pattern, SHEET, options, PLAIN)
    pair = StripePair.of([RIB[4]], [GARTER[4]])
    if grading is not None:
        pair = StripePair.of(grading.weft, grading.warp)
    return layout, layout.fabric(pair)


def stored(layout, fabric, configuration):
    return float(energy(layout.net, fabric, configuration).total)


@pytest.mark.parametrize("boundary", ["periodic", "clamped"])
@pytest.mark.parametrize("hinge_stiffness", ["per_edge", "per_length"])
def test_a_graded_pattern_of_equal_patches_is_bitwise_the_checkerboard(boundary, hinge_stiffness):
    options = ModelOptions(boundary=boundary, hinge_stiffness=hinge_stiffness)
    rows = ["GRGR", "RGRG"]
    grading = graded(rows, [4, 4], [4] * 4, [2, 2], [2] * 4)
    _, fabric = assembled(rows, grading, options)
    _, checkerboard = assembled(["GR", "RG"], None, options, (1, 2), periods=2)
    for name in NUMBERS:
        np.testing.assert_array_equal(getattr(fabric, name), getattr(checkerboard, name))


def test_rows_and_columns_take_the_numbers_of_their_own_stripes():
    grading = graded(["GR", "RG"], [8, 2], [4, 6], [1, 2], [3, 1])
    layout, fabric = assembled(["GR", "RG"], grading)
    # Rows count from the top: the lowest has garter 4, two periods high.
    np.testing.assert_allclose(fabric.cell_y, [1.03 / 4] * 8 + [2.6 / 4] * 4)
    np.testing.assert_allclose(fabric.cell_x, [1.41 / 4] * 12 + [1.93 / 4] * 4)
    weft, warp = layout.net.weft, layout.net.warp
    columns, rows = layout.net.spring_cells[:, 0, 1], layout.net.spring_cells[:, 0, 0]
    np.testing.assert_allclose(
        fabric.stretch_stiffness[weft], np.where(columns < 12, 0.817, 0.562)[weft]
    )
    np.testing.assert_allclose(fabric.stretch_stiffness[warp], np.where(rows < 8, 4.24, 1.16)[warp])
    diagonal = ~(weft | warp)
    smaller = np.minimum(np.where(columns < 12, 0.817, 0.562), np.where(rows < 8, 4.24, 1.16))
    np.testing.assert_allclose(fabric.stretch_stiffness[diagonal], smaller[diagonal])


def test_a_hinge_between_two_stripes_is_half_of_each_in_series():
    grading = graded(["RR"], [4], [4, 8], [1], [1, 1])
    layout, fabric = assembled(["RR"], grading)
    border = layout.net.wale & (layout.net.hinge_cells == [0, 4]).all(axis=1)
    one, other = 0.0178, 0.0048
    compliance = 0.5 / one + 0.5 / other
    assert float(fabric.fold_stiffness[border][0]) == pytest.approx(1 / compliance)


@pytest.mark.slow
@pytest.mark.nightly
def test_a_plain_sheet_rests_flat_and_stretches_as_its_springs_do():
    layout, fabric = assembled(["P"], options=FLAT, periods=2)
    flat = flat_sheet(layout.net, fabric)
    assert stored(layout, fabric, flat) == pytest.approx(0, abs=1e-25)
    gradient = jax.grad(lambda shape: energy(layout.net, fabric, shape).total)(flat)
    assert float(jnp.abs(gradient.flattened()).max()) < 1e-12

    a, b = float(fabric.cell_x[0]), float(fabric.cell_y[0])
    weft, warp = PLAIN.plain_stretch_weft * b / a, PLAIN.plain_stretch_warp * a / b
    diagonal, square = min(weft, warp), a**2 + b**2
    # A cell has a weft and a warp spring and two diagonals, in homogeneous strain.
    across = weft + 2 * diagonal * a**2 / square
    along = warp + 2 * diagonal * b**2 / square
    both = 2 * diagonal * a * b / square

    def even(strains):
        stretch = 1 + jnp.append(strains, 0.0)
        return energy(
            layout.net, fabric, Configuration(flat.positions * stretch, flat.lengths * stretch[:2])
        ).total

    stiffness = jax.hessian(even)(jnp.zeros(2)) / (8 * 8)
    expected = [[across * a**2, both * a * b], [both * a * b, along * b**2]]
    np.testing.assert_allclose(stiffness, expected, rtol=1e-12)


@pytest.mark.slow
def test_bending_a_plain_sheet_takes_its_bending_stiffness():
    options = ModelOptions(boundary="clamped")
    layout, fabric = assembled(["P"], options=options, periods=2)
    flat = flat_sheet(layout.net, fabric)
    radius = 200.0
    angle = flat.positions[..., 0] / radius
    # Chords, not arcs, keep the length of the springs.
    chord = float(fabric.cell_x[0]) / (2 * np.sin(float(fabric.cell_x[0]) / radius / 2))
    rolled = jnp.stack(
        [chord * jnp.sin(angle), flat.positions[..., 1], chord * (1 - jnp.cos(angle))], axis=-1
    )
    found = energy(layout.net, fabric, Configuration(rolled, flat.lengths))
    height, width = float(fabric.cell_y.sum()), float(fabric.cell_x[:-1].sum())
    expected = 0.5 * PLAIN.plain_bend_weft * height * width / radius**2
    assert float(found.fold) == pytest.approx(expected, rel=1e-3)
    assert float(found.stretch) < 1e-6 * float(found.fold)


@pytest.mark.parametrize("cells_per_period", [4, 8])
@pytest.mark.parametrize("along", ["wale", "course"])
def test_a_single_fold_rests_at_its_angle_without_energy(along, cells_per_period):
    options = ModelOptions(boundary="clamped", cells_per_period=cells_per_period)
    fold = SingleFold(along=along, at=0.5, theta_0=2.0, sense="valley")
    layout, fabric = assembled(["P"], options=options, folds=[fold])
    flat = flat_sheet(layout.net, fabric)
    axis = 0 if along == "wale" else 1
    reach = np.asarray(flat.positions[..., axis] - flat.positions[..., axis].max() / 2)
    tilt = (np.pi - 2.0) / 2
    folded = flat.positions.copy()
    folded[..., axis] = reach * np.cos(tilt)
    # A valley opens upwards.
    folded[..., 2] = np.abs(reach) * np.sin(tilt)
    shape = Configuration(folded, flat.lengths)
    assert stored(layout, fabric, shape) == pytest.approx(0, abs=1e-20)
    assert stored(layout, fabric, flat) > 1e-3


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"at": 2.5}, ("at = 2.5", "2 patches")),
        ({"at": 1.1}, ("at = 1.1", "1 or 1.25")),
        ({"at": 1, "start": 1.0, "end": 0.5}, ("start = 1", "end = 0.5")),
    ],
)
def test_a_fold_that_does_not_fit_its_pattern_is_refused_with_its_place(change, named):
    fold = SingleFold(**{"along": "wale", "theta_0": 1.0, **change})
    with pytest.raises(BadPattern) as error:
        assembled(["PP"], folds=[fold])
    assert all(part in str(error.value) for part in ("fold 1", *named))


THREE = ["RGP", "PRG"]


@pytest.mark.slow
def test_one_and_four_repeats_of_a_map_of_three_letters_are_one_fabric():
    options = replace(PERIODIC, cell_size="flat")
    grading = graded(THREE, [4, 6], [4, 4, 8], [1, 2], [1, 2, 1])
    one, fabric = assembled(THREE, grading, options)
    many, larger = assembled(THREE, grading, options, (2, 2))
    state = relaxed(one.net, fabric, FINE)
    assert state.converged
    shape = state.configuration
    tiles = [
        [
            shape.positions + jnp.array([column, row, 0]) * jnp.append(shape.lengths, 0.0)
            for column in range(2)
        ]
        for row in range(2)
    ]
    nodes = jnp.concatenate([jnp.concatenate(row, axis=1) for row in tiles], axis=0)
    tiled = Configuration(nodes, 2 * shape.lengths)
    assert stored(many, larger, tiled) == pytest.approx(4 * float(state.energy.total), rel=1e-12)
    gradient = jax.grad(lambda of: energy(many.net, larger, of).total)(tiled)
    assert float(jnp.abs(gradient.positions).max()) < 1e-10


def test_a_spring_on_the_border_of_two_knits_has_half_the_force_of_a_spring_of_each():
    """On both sides of a patch, which thus stays symmetric."""
    curve = SpringCurve((0.0, 0.1, 0.3), (0.0, 1.0, 6.0))
    rib = replace(stripe("rib", 4), stretch_along=0.5, curve_along=curve)
    garter = replace(stripe("garter", 8), stretch_along=0.07)
    net, fabric = assemble_fabric(checkerboard(2), rib, garter, SHEET, PERIODIC)
    width, height = (float(cell_length(each, PERIODIC)) for each in (rib, garter))
    one, other = (tuple(cell) for cell in net.spring_cells.transpose(1, 2, 0))
    is_rib = checkerboard(2).knit_cells("rib")
    along_rib, across_garter = 0.5 * width * curve.spline(0.2), garter.k_s * height * 0.2
    for first, second in ((one, other), (other, one)):
        border = net.warp & is_rib[first] & ~is_rib[second]
        rest = fabric.rest_length[border]
        law = fabric.spring_law.of(np.flatnonzero(border))
        force = fabric.stretch_stiffness[border] * law.pull(1.2 * rest, rest)
        np.testing.assert_allclose(force, (along_rib + across_garter) / 2, rtol=1e-9)
