import numpy as np
import pytest

from knitlab.model.settings import ModelOptions
from knitlab.model.stripe import cell_length, periods_per_patch
from tests.fabrics import cell_of, checkerboard, checkered, patterned, stripe


def test_a_relaxed_cell_folds_to_the_measured_period():
    rib = stripe("rib", 4)
    flat = cell_length(rib, ModelOptions(cell_size="relaxed"))
    assert 4 * flat * np.sin(rib.theta_0 / 2) == pytest.approx(rib.period)
    assert 4 * cell_length(rib, ModelOptions(cell_size="flat")) == pytest.approx(rib.period)


def test_lengths_scale_and_the_wall_does_not():
    _, one = checkered(4, 1, ModelOptions())
    _, ten = checkered(4, 1, ModelOptions(length_scale=10))
    assert np.allclose(ten.rest_length, 10 * one.rest_length)
    assert float(ten.z_max) == float(one.z_max)


def test_k_t_per_length_is_k_t_times_the_length_of_the_edge():
    net, edge = checkered(4, 1, ModelOptions(hinge_stiffness="per_edge"))
    _, length = checkered(4, 1, ModelOptions(hinge_stiffness="per_length"))
    ratio = np.asarray(length.fold_stiffness / edge.fold_stiffness)
    assert np.allclose(ratio[net.wale], cell_of(edge)[1])
    assert np.allclose(ratio[~net.wale], cell_of(edge)[0])


def test_fold_lines_alone_leave_no_hinge_against_the_folds_or_on_borders():
    net, every = checkered(4, 2, ModelOptions(hinges="all"))
    _, lines = checkered(4, 2, ModelOptions(hinges="fold_lines"))
    rib = checkerboard(2).knit_cells("rib")
    after = rib[tuple(net.hinge_cells.T)]
    before = rib[tuple((net.hinge_cells - np.where(net.wale[:, None], [0, 1], [1, 0])).T)]
    inside = np.where(net.wale, after & before, ~after & ~before)
    assert (np.asarray(lines.fold_stiffness > 0) == inside).all()
    assert (np.asarray(every.fold_stiffness) > 0).all()
    assert not np.asarray(every.rest_fold)[~inside].any()


@pytest.mark.parametrize(("start", "sense"), [("mountain", 1), ("valley", -1)])
def test_garter_start_is_the_sense_of_the_first_garter_fold(start, sense):
    net, fabric = patterned(4, checkerboard(2), ModelOptions(garter_start=start))
    first = (~net.wale) & (net.hinge_cells == [2, 8]).all(axis=1)
    assert np.sign(float(fabric.rest_fold[first][0])) == sense
    first_rib = net.wale & (net.hinge_cells == [0, 2]).all(axis=1)
    assert float(fabric.rest_fold[first_rib][0]) > 0


def test_only_whole_periods_fill_a_patch():
    assert periods_per_patch(4, 32) == 4
    for n_subunit in (4, 12, 0):
        with pytest.raises(ValueError, match=r"n_stripe = 8.*8, 16, 24"):
            periods_per_patch(4, n_subunit)
