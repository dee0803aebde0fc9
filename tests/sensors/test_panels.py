import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knitlab.model.electrodes import Electrodes, Strip
from knitlab.model.fabric import Configuration, flat_sheet
from knitlab.model.network import MeshShape
from knitlab.observables.capacitance.panels import graded, panel_chart, panels_on
from tests.fabrics import CLAMPED, PERIODIC, cell_of, pure, shaken, stripe

LEVELS = (1, 2, 3)


def rib(options, periods=2):
    net, fabric = pure(stripe("rib", 4), options, periods)
    return net.shape, cell_of(fabric), jax.tree.map(np.asarray, flat_sheet(net, fabric))


def up_the_warp(shape, low=0.5, width=1.0, apart=4.0):
    """Two strips along y, each as long as the fabric."""
    return Electrodes(
        tuple((Strip(at, at + width, 0.0, shape.cells_y),) for at in (low, low + apart)), "wale"
    )


def along_the_weft(shape, low=0.5, width=1.0, apart=4.0):
    return Electrodes(
        tuple((Strip(0.0, shape.cells_x, at, at + width),) for at in (low, low + apart)), "course"
    )


def drawn(electrodes):
    """The same electrodes, divided into strips of one grid cell."""
    cells = [
        [
            Strip(x, x + 1.0, y, y + 1.0)
            for strip in strips
            for x in np.arange(strip.left, strip.right)
            for y in np.arange(strip.bottom, strip.top)
        ]
        for strips in electrodes.strips
    ]
    return Electrodes((tuple(cells[0][::-1]), tuple(cells[1])), electrodes.along)


def chart_area(chart):
    x, y = np.moveaxis(chart.corners, -1, 0)
    ahead = np.roll(x, -1, axis=1), np.roll(y, -1, axis=1)
    return (x * ahead[1] - ahead[0] * y).sum(axis=1) / 2


@pytest.mark.slow
@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("options", [CLAMPED, PERIODIC], ids=["clamped", "periodic"])
@pytest.mark.parametrize("laid", [up_the_warp, along_the_weft])
@given(low=st.floats(0, 0.9), width=st.floats(0.2, 1.9))
def test_panels_cover_their_electrode(laid, options, level, low, width):
    shape, *_ = rib(options)
    electrodes = laid(shape, low, width)
    chart = panel_chart(electrodes, shape, level)
    areas = chart_area(chart)
    assert (areas > 0).all()
    for number, strips in enumerate(electrodes.strips):
        covered = areas[chart.electrode == number].sum()
        assert covered == pytest.approx(sum(strip.area for strip in strips))


@pytest.mark.parametrize("level", LEVELS)
def test_a_strip_is_cut_by_level_and_finer_where_it_ends(level):
    shape, *_ = rib(CLAMPED)
    periodic, *_ = rib(PERIODIC)
    lengthwise = (shape.cells_y + 2) * level
    within = Electrodes(((Strip(0.0, 1.0, 0.0, 8.0),), (Strip(4.0, 6.0, 0.0, 8.0),)), "wale")
    one, other = np.bincount(panel_chart(within, shape, level).electrode)
    # An electrode of one column ends at both its sides; with two columns each ends at one side.
    assert one == 4 * level * lengthwise
    assert other == (2 + 2) * level * lengthwise
    one, other = np.bincount(panel_chart(within, periodic, level).electrode)
    assert one == other == 4 * level * shape.cells_y * level


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("low_free", [False, True])
@pytest.mark.parametrize("high_free", [False, True])
def test_lines_run_from_0_to_1_and_are_denser_at_ends_of_the_electrode(level, low_free, high_free):
    lines = graded(level, low_free, high_free)
    steps = np.diff(lines)
    assert lines[0] == 0
    assert lines[-1] == pytest.approx(1, abs=1e-15)
    assert (steps > 0).all()
    assert len(steps) == level * (1 + low_free) * (1 + high_free)
    assert np.allclose(lines, 1 - graded(level, high_free, low_free)[::-1], atol=1e-15)
    if low_free or high_free:
        # Equally narrow at both sides, and widest in the middle.
        assert np.allclose(steps, steps[::-1])
        assert (np.diff(steps[: (len(steps) + 1) // 2]) > 0).all()
    else:
        assert np.allclose(steps, 1 / level)


def lines_up_the_warp(shape, electrodes):
    """Where panels begin along y, in the first and in the last row of cells."""
    chart = panel_chart(electrodes, shape, 2)
    rows = chart.cell[:, 0]
    return [
        np.unique(chart.corners[rows == row][..., 1].round(12)) for row in (rows.min(), rows.max())
    ]


def test_a_periodic_electrode_does_not_end_at_the_boundary():
    shape, *_ = rib(PERIODIC)
    for electrodes in (up_the_warp(shape), drawn(up_the_warp(shape, 0.0))):
        for lines in lines_up_the_warp(shape, electrodes):
            assert lines.tolist() == [0, 0.5, 1]


def test_periodic_fabric_continues_along_its_electrodes_only():
    shape, *_ = rib(PERIODIC)
    around = Electrodes(((Strip(0.0, 1.0, 0.0, 8.0),), (Strip(7.0, 8.0, 0.0, 8.0),)), "wale")
    chart = panel_chart(around, shape, 1)
    for number in (0, 1):
        x = np.unique(chart.corners[chart.electrode == number][..., 0].round(12))
        assert np.allclose(x, graded(1, True, True))


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("options", [CLAMPED, PERIODIC], ids=["clamped", "periodic"])
@pytest.mark.parametrize("width", [1.0, 2.0])
@pytest.mark.parametrize("laid", [up_the_warp, along_the_weft])
def test_a_drawn_electrode_has_the_panels_of_a_strip(laid, width, options, level):
    shape, *_ = rib(options)
    electrodes = laid(shape, 0.0, width)

    def panels(of):
        chart = panel_chart(of, shape, level)
        rows = np.concatenate([chart.electrode[:, None], chart.cell], axis=1)
        rows = np.concatenate([rows, chart.corners.reshape(-1, 8).round(12)], axis=1)
        return rows[np.lexsort(rows.T)]

    assert np.array_equal(panels(electrodes), panels(drawn(electrodes)))


def test_an_electrode_may_turn_a_corner():
    shape, *_ = rib(CLAMPED)
    bent = (Strip(0.0, 1.0, 0.0, 1.0), Strip(0.0, 1.0, 1.0, 2.0), Strip(1.0, 2.0, 1.0, 2.0))
    chart = panel_chart(Electrodes((bent, (Strip(3.0, 4.0, 0.0, 1.0),)), "wale"), shape, 1)
    corner = (chart.electrode == 0) & (chart.cell == [1, 0]).all(axis=1)
    lines = [np.unique(chart.corners[corner][..., axis].round(12)) for axis in (0, 1)]
    assert np.allclose(lines[0], graded(1, True, False))
    assert np.allclose(lines[1], graded(1, False, True))


@pytest.mark.parametrize("laid", [up_the_warp, along_the_weft])
def test_panels_at_the_corners_of_cells_lie_on_nodes(laid):
    shape, _, flat = rib(CLAMPED)
    configuration = shaken(flat, 0.3)
    chart = panel_chart(laid(shape), shape, 2)
    places = chart.cell[:, None, ::-1] + chart.corners
    on_node = np.isclose(places, places.round()).all(axis=-1)
    x, y = places[on_node].round().astype(int).T
    nodes = configuration.positions
    assert on_node.sum() > 4 * (shape.cells_y + 1)
    assert np.allclose(panels_on(chart, shape, configuration)[on_node], nodes[y, x])


@pytest.mark.parametrize("laid", [up_the_warp, along_the_weft])
def test_panels_beyond_the_periodic_boundary_lie_on_images_of_nodes(laid):
    shape, _, flat = rib(PERIODIC)
    configuration = shaken(flat, 0.3)
    electrodes = laid(shape, 3.5)
    open_shape = MeshShape(2 * shape.cells_y, 2 * shape.cells_x, periodic=False)
    rows, columns = np.mgrid[: open_shape.nodes_y, : open_shape.nodes_x]
    tiled = configuration.positions[rows % shape.nodes_y, columns % shape.nodes_x]
    tiled[..., 0] += columns // shape.nodes_x * configuration.lengths[0]
    tiled[..., 1] += rows // shape.nodes_y * configuration.lengths[1]
    chart = panel_chart(electrodes, shape, 2)
    assert chart.cell.max() == 8
    expected = panels_on(chart, open_shape, Configuration(tiled, np.zeros(2)))
    assert np.allclose(panels_on(chart, shape, configuration), expected, atol=1e-12)
