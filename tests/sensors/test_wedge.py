import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ellipk, ellipkm1

from knitlab.model.electrodes import Electrodes, Strip
from knitlab.model.fabric import Configuration
from knitlab.model.network import MeshShape
from knitlab.observables.capacitance.boundary_elements import VACUUM_PERMITTIVITY
from knitlab.observables.capacitance.panels import panel_chart, panels_on
from knitlab.observables.capacitance.wedge import side_by_side, wedge_capacitance, with_ends
from tests.fabrics import shaken
from tests.sensors.conductors import between, by_series, extrapolated

SHAPE = MeshShape(4, 8, periodic=True)
CELL = 0.8
LENGTH = SHAPE.cells_y * CELL
"""Period of the strips [mm]."""
FLAT = (0.0,) * 7
SEED = st.integers(0, 10_000)


def beside(low=1.0, width=2.0, gap=2.0):
    """Two strips up the warp, between columns of the grid."""
    first, second = low, low + width + gap
    return Electrodes(
        (
            (Strip(first, first + width, 0.0, SHAPE.cells_y),),
            (Strip(second, second + width, 0.0, SHAPE.cells_y),),
        ),
        "wale",
    )


PAIR = beside()


def outline(turns):
    """Line of nodes (x, z), a cell apart, that turns between one cell and the next."""
    heading = np.cumsum([0.0, *turns])
    steps = CELL * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    return np.concatenate([[[0.0, 0.0]], np.cumsum(steps, axis=0)])


def rolled(turns):
    """Periodic fabric that is straight along y, and folded between its columns."""
    line = outline(turns)
    nodes = np.zeros((SHAPE.nodes_y, SHAPE.nodes_x, 3))
    nodes[..., 0], nodes[..., 2] = line[:-1].T
    nodes[..., 1] = CELL * np.arange(SHAPE.nodes_y)[:, None]
    return Configuration(nodes, np.array([line[-1, 0], LENGTH]))


def hinged(angle):
    """Rotations of the cells of a fabric with one fold, midway between the strips."""
    turns = np.zeros(7)
    turns[3] = np.pi - angle
    return turns


def corrugated(angle):
    """Rotations of the cells of a fabric with a ridge in each strip and a valley between them."""
    turns = np.zeros(7)
    turns[1::2] = (angle - np.pi) * np.array([1, -1, 1])
    return turns


def grown(configuration, by):
    return jax.tree.map(np.add, configuration, by)


def scaled(configuration, factor):
    return jax.tree.map(lambda part: factor * part, configuration)


def wedge(configuration, electrodes=PAIR):
    return float(wedge_capacitance(electrodes, SHAPE, configuration))


def by_panels(configuration, electrodes=PAIR):
    found = []
    for level in (1, 2):
        chart = panel_chart(electrodes, SHAPE, level)
        panels = panels_on(chart, SHAPE, configuration)
        pair = (panels[chart.electrode == number] for number in (0, 1))
        found.append(between(*pair, period=configuration.lengths[1]))
    return extrapolated(*found)


@given(st.floats(1e-3, 30))
def test_a_wedge_with_its_ends_is_a_ratio_of_elliptic_integrals(ratio):
    k = np.exp(-np.pi * ratio)
    exact = ellipkm1(k**2) / ellipk(k**2) / 2
    assert float(with_ends(np.array(ratio))) == pytest.approx(exact, rel=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize(("low", "width", "gap"), [(1.0, 2.0, 2.0), (0.5, 3.0, 1.0), (1, 1.5, 3)])
def test_flat_fabric_has_the_closed_form_of_coplanar_strips(low, width, gap):
    k = gap / (gap + 2 * width)
    exact = VACUUM_PERMITTIVITY * LENGTH * ellipkm1(k**2) / ellipk(k**2)
    assert wedge(rolled(FLAT), beside(low, width, gap)) == pytest.approx(exact, rel=1e-4)


@pytest.mark.parametrize("angle", [3.0, 2.0, 1.0, 0.3, 5.0])
def test_the_capacitance_of_a_hinge_is_the_sum_of_both_wedges(angle):
    ratios = np.log(3) / np.array([angle, 2 * np.pi - angle])
    exact = VACUUM_PERMITTIVITY * LENGTH * float(with_ends(ratios).sum())
    assert wedge(rolled(hinged(angle))) == pytest.approx(exact, rel=1e-4)


@pytest.mark.parametrize(("angle", "most"), [(2.5, 0.01), (2.0, 0.02), (1.0, 0.07), (0.3, 0.09)])
def test_the_capacitance_of_a_hinge_is_slightly_below_the_exact_value(angle, most):
    line = outline(hinged(angle))
    exact = LENGTH * by_series(line[[1, 3]], line[[5, 7]])
    assert (1 - most) * exact < wedge(rolled(hinged(angle))) < exact


@pytest.mark.slow
@pytest.mark.parametrize(
    ("turns", "most"),
    [
        (FLAT, 3e-3),
        (hinged(2.0), 0.02),
        (hinged(0.5), 0.08),
        (corrugated(2.5), 0.01),
        (corrugated(2.0), 0.02),
        (corrugated(1.5), 0.05),
        (corrugated(1.0), 0.1),
    ],
    ids=["flat", "hinge 2", "hinge 0.5", "ridges 2.5", "ridges 2", "ridges 1.5", "ridges 1"],
)
def test_the_wedge_integral_agrees_with_boundary_elements(turns, most):
    configuration = rolled(turns)
    assert wedge(configuration) == pytest.approx(by_panels(configuration), rel=most)


@pytest.mark.parametrize("tilt", [1e-2, 1e-4, -1e-4])
def test_nearly_parallel_plates_have_most_of_the_exact_value(tilt):
    turns = np.zeros(7)
    turns[2] = turns[4] = np.pi / 2 - tilt / 2
    line = outline(turns)
    exact = LENGTH * by_series(line[[1, 3]], line[[5, 7]])
    found = wedge(rolled(turns))
    # Strips as wide as their distance. The field behind them is not an arc, and is neglected.
    assert found > VACUUM_PERMITTIVITY * LENGTH
    assert 0.7 * exact < found < exact


@pytest.mark.slow
def test_strips_along_weft_and_warp_are_equivalent():
    configuration = shaken(rolled(corrugated(1.5)), 0.02)
    turned_shape = MeshShape(SHAPE.cells_x, SHAPE.cells_y, periodic=True)
    nodes = configuration.positions.swapaxes(0, 1)[..., [1, 0, 2]]
    turned = Configuration(nodes, configuration.lengths[::-1])
    electrodes = Electrodes(
        tuple((Strip(s.bottom, s.top, s.left, s.right),) for (s,) in PAIR.strips), "course"
    )
    found = wedge_capacitance(electrodes, turned_shape, turned)
    assert float(found) == pytest.approx(wedge(configuration), rel=1e-12)


@pytest.mark.slow
@pytest.mark.nightly
@given(SEED)
@settings(max_examples=5)
def test_the_derivative_is_that_of_finite_differences(seed):
    configuration = shaken(rolled(corrugated(1.5)), 0.05, seed)
    direction = shaken(scaled(configuration, 0.0), 1.0, seed + 1)
    step = 1e-5
    ahead, behind = (
        wedge(grown(configuration, scaled(direction, sign * step))) for sign in (1, -1)
    )
    gradient = jax.grad(wedge_capacitance, argnums=2)(PAIR, SHAPE, configuration).flattened()
    assert np.isfinite(gradient).all()
    assert gradient @ direction.flattened() == pytest.approx(
        (ahead - behind) / (2 * step), rel=1e-6
    )


@pytest.mark.parametrize(
    "strips",
    [
        ((Strip(0, 1, 0, 4),), (Strip(2, 4, 0, 4),)),
        ((Strip(0, 1, 0, 4),), (Strip(2, 3, 0, 3),)),
        ((Strip(0, 1, 0, 2), Strip(0, 1, 2, 4)), (Strip(2, 3, 0, 4),)),
    ],
    ids=["widths", "lengths", "drawn"],
)
def test_only_two_strips_of_one_width_are_accepted(strips):
    electrodes = Electrodes(strips, "wale")
    assert not side_by_side(electrodes)
    with pytest.raises(ValueError, match="width"):
        wedge_capacitance(electrodes, SHAPE, rolled(FLAT))
    assert side_by_side(PAIR)
