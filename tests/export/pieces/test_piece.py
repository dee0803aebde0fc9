"""Pieces: which cells of a fabric an outline needs, and that a cut fabric is what is left of it."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

import knitlab as kl
from knitlab.api.single_design import single_design
from knitlab.export.knitting.stitch_chart import stitch_chart
from knitlab.export.pieces.fitting import Fitting, kind_of_row
from knitlab.export.pieces.outline import Outline
from knitlab.export.pieces.piece import UNCHANGED, Fabric, PlanView
from knitlab.export.pieces.rows import Row
from knitlab.model.energy import energy
from knitlab.model.fabric import flat_sheet
from knitlab.model.network import network
from knitlab.runs.simulate import simulated
from knitlab.solvers.methods import METHODS
from tests.fabrics import shaken

BORDERS = ("whole", "cut", "plain")


@cache
def fabric(border="cut", n_stripe=4, n_subunit=8, **settings):
    own = [f"{name}={value}" for name, value in settings.items()]
    one = single_design("periodic", [f"n_stripe={n_stripe}", f"n_subunit={n_subunit}", *own], {})
    return Fabric(one.case, one.gauge, one.plain, border)


def kind(cell, case=None):
    """Rows whose grid cells have a size, and that nothing is known of under a pull."""
    case = case or fabric().case
    nothing = np.zeros(1)
    return Row("own", case.warp, case.periods, False, cell, nothing, nothing, nothing)


def laid_out(border, outline, cell):
    """The piece of an outline whose grid cells have a size."""
    _, length = outline.size
    rows = fabric(border).rows_of(kind(cell), length, UNCHANGED)
    return fabric(border).piece(outline, rows, fabric(border).endless(rows))


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("patches", [(2, 2), (3, 4), (5, 3)])
def test_a_rectangle_of_whole_patches_is_not_cut(border, patches):
    cells = [count * fabric(border).patch for count in patches]
    width, length = np.array(cells) * [2.0, 1.5]
    case = laid_out(border, Outline.of_widths([0, length], [width] * 2), (2.0, 1.5))
    assert case.mesh_shape.has_fabric.all()
    assert case.mesh_shape.has_fabric.shape == (cells[1], cells[0])
    assert "P" not in "".join(case.pattern)
    assert all(one != other for row in case.pattern for one, other in pairwise(row))


@settings(deadline=None, max_examples=30)
@given(
    widths=st.lists(st.floats(60, 200), min_size=2, max_size=5),
    border=st.sampled_from(BORDERS),
    size=st.tuples(st.floats(1.0, 2.5), st.floats(1.0, 2.5)),
)
def test_a_piece_whose_cells_keep_their_size_has_its_outline(widths, border, size):
    """Laid out flat, with the scale by which it was made, it is within its rounding of it."""
    outline = Outline.of_widths(70.0 * np.arange(len(widths)), widths)
    case = laid_out(border, outline, size)
    columns, rows = np.arange(case.mesh_shape.nodes_x), np.arange(case.mesh_shape.nodes_y)
    grid = np.stack(
        [*np.meshgrid(columns * 1.0, rows * 1.0), np.zeros((len(rows), len(columns)))], -1
    )
    view = PlanView(case, grid[..., :2] * size)
    unit = fabric(border).patch if border == "whole" else 1
    # Edges may also move along the rows that are rounded, by their slope.
    slope = np.abs(np.diff(widths)).max() / 2 / 70
    rounding = np.array(size) * (unit, max(unit, fabric(border).case.options.cells_per_period))
    bound = np.hypot(*rounding) * (1 + slope)
    assert view.outline.centred_on(outline).distance(outline) <= bound
    np.testing.assert_allclose(view.scale.width, size[0], rtol=1e-9)
    np.testing.assert_allclose(view.scale.height, size[1], rtol=1e-9)


def test_rows_of_other_stripes_have_their_own_length_in_cloth():
    """Flat, a piece is as long as its courses, whatever the lengths of its stripes' tables."""
    own, other = fabric(), fabric(n_stripe=2)
    rows = [kind((1.0, 1.0)), kind((1.0, 1.0), other.case), kind((1.0, 1.0))]
    outline = Outline.of_widths([0, 64], [32, 32])
    case = own.piece(outline, rows, own.endless(rows))
    net, flat = case.assemble()
    sheet = np.asarray(flat_sheet(net, flat).positions)
    width, length = own.view(case, sheet).outline.size
    courses, wales = case.stitches_per_cell
    assert width == pytest.approx(wales.sum() * own.gauge.stitch_width)
    assert length == pytest.approx(courses.sum() * own.gauge.stitch_height)
    assert courses.min() < courses.max()


def test_a_border_of_plain_knit_is_where_patches_are_cut():
    outline = Outline.of_widths([0, 64], [64, 32])
    cut, plain = (laid_out(border, outline, (1.0, 1.0)) for border in ("cut", "plain"))
    assert cut.spans == plain.spans
    patch = fabric().patch
    has_fabric = cut.mesh_shape.has_fabric
    rows = plain.pattern[::-1]
    for row, column in np.ndindex(len(rows), len(rows[0])):
        inside = has_fabric[row * patch : (row + 1) * patch, column * patch : (column + 1) * patch]
        is_cut = inside.any() and not inside.all()
        assert (rows[row][column] == "P") == is_cut


def cut_case(spans, unit_cells=(2, 2), **changes):
    return replace(
        fabric().case,
        unit_cells=unit_cells,
        options=replace(fabric().case.options, boundary="clamped"),
        solver=replace(fabric().case.equilibrium_solver, start="flat"),
        sensitivities=False,
        robustness=0,
        spans=spans,
        applied_strain=(0.0, 0.05),
        **changes,
    )


def test_without_what_is_cut_off_a_fabric_has_the_energy_of_the_rest():
    """Against the whole fabric without stiffness where there is no cell, whatever its shape."""
    whole, spans = cut_case(None), tuple((row // 3, 16 - row // 4) for row in range(16))
    cut = replace(whole, spans=spans)
    net, full = whole.assemble()
    has_fabric = cut.mesh_shape.has_fabric
    at_edge = has_fabric[tuple(net.spring_cells.transpose(2, 0, 1))]
    after = net.hinge_cells
    before = after - np.where(net.wale[:, None], [0, 1], [1, 0])
    between = has_fabric[tuple(after.T)] & has_fabric[tuple(before.T)]
    less = replace(
        full,
        stretch_stiffness=full.stretch_stiffness * at_edge.any(axis=1),
        fold_stiffness=full.fold_stiffness * between,
    )
    shape = shaken(flat_sheet(net, full), 0.1, 3)
    of_cut = energy(network(cut.mesh_shape), cut.assemble()[1], shape)
    expected = energy(net, less, shape)
    # One knit has one stiffness, so that at a cut the same is left; two knits meet nowhere here.
    assert float(of_cut.fold) == pytest.approx(float(expected.fold), rel=1e-12)


@pytest.mark.slow
def test_a_rectangle_cut_out_of_a_fabric_behaves_as_that_rectangle():
    """Exactly: the same network, so the same equilibria, forces and strains."""
    half = cut_case(tuple((0, 8) for _ in range(16)))
    small = cut_case(None, unit_cells=(2, 1))
    one, other = (
        METHODS["equilibrium"].stretch([case], lambda *_: None)[0] for case in (half, small)
    )
    for cut, whole in zip(one.states, other.states, strict=True):
        assert cut.converged
        assert whole.converged
        assert float(cut.energy.total) == pytest.approx(float(whole.energy.total), rel=1e-6)
    forces = [test.loading.reaction_force(test.states[-1].gradient) for test in (one, other)]
    assert forces[0] == pytest.approx(forces[1], rel=1e-5)


def test_nodes_without_fabric_have_no_position():
    case = cut_case(tuple((row // 4, 16 - row // 4) for row in range(16)))
    results = simulated(case, lambda *_: None)
    missing = np.isnan(results["position"].values).any(axis=-1)
    assert (missing == ~case.mesh_shape.nodes_of_fabric).all()
    assert int(results["self_intersections"].max()) == 0


@pytest.mark.parametrize("step", [1, 2, 8])
def test_the_edges_of_a_chart_follow_those_of_the_grid(step):
    """Small steps are spread over the courses, large ones are steps of the chart."""
    spans = tuple((step * (row >= 8), 16 - step * (row >= 8)) for row in range(16))
    case = cut_case(spans)
    chart = stitch_chart(case)
    wales_of_cell = chart.wales // 16
    courses_of_row = chart.courses // 16
    middles = np.arange(16) * courses_of_row + courses_of_row // 2
    np.testing.assert_allclose(chart.spans[middles], np.array(spans) * wales_of_cell, atol=1)
    moves = np.abs(np.diff(chart.spans, axis=0)).max()
    assert moves <= 1 if step * wales_of_cell <= courses_of_row else moves == step * wales_of_cell


@pytest.mark.slow
@pytest.mark.nightly
def test_rounds_bring_a_piece_to_its_outline_and_are_kept(tmp_path):
    own = fabric("cut")
    kinds = [kind_of_row(own, "own", own.case, [0.0], tmp_path)]
    outline = Outline.of_widths([0, 100], [80, 60])
    fitting = Fitting(own, kinds, outline, None, 0.0, tmp_path)
    found = fitting.run(4)
    assert found.met
    assert found.best.distance <= found.rounds[0].distance
    files = {path.name: path.stat().st_mtime_ns for path in tmp_path.glob("cases/*.nc")}
    again = fitting.run(4)
    assert again.best.distance == found.best.distance
    assert {path.name: path.stat().st_mtime_ns for path in tmp_path.glob("cases/*.nc")} == files


def test_the_mesh_of_a_piece_is_what_is_left_of_the_fabric(tmp_path):
    """A disc of as many faces as the piece has cells, whatever the shape."""
    case = cut_case(tuple((row // 4, 16 - row // 4) for row in range(16)))
    results = simulated(replace(case, applied_strain=(0.0,)), lambda *_: None)
    path = tmp_path / "piece.ply"
    kl.export(results, path)
    mesh = trimesh.load(path, process=False)
    assert mesh.euler_number == 1
    assert len(mesh.faces) == 2 * case.mesh_shape.has_fabric.sum()
    assert np.isfinite(mesh.vertices).all()
