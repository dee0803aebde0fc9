"""Estimates of time against measured times, and how they grow."""

import numpy as np
import pytest

from knitlab.runs.batches import seconds
from knitlab.runs.plan import make_plan
from knitlab.solvers.equilibrium.method import Equilibrium

MEASURED = {(2, 32): 3.9, (4, 32): 0.74, (4, 48): 2.1, (6, 72): 3.7, (8, 48): 0.32, (8, 96): 3.6}
"""Processor time of relaxation and five strain steps of periodic fabric without contact, on a core
of an Intel Xeon with AVX-512 [s]."""


def only(n_stripe, n_subunit, *settings):
    test = ("strain_max=0.2", "strain_step=0.04", "robustness=0", "contact=none")
    design = (f"n_stripe={n_stripe}", f"n_subunit={n_subunit}")
    (case,) = make_plan("periodic", (*design, *test, *settings)).cases.values()
    return case


@pytest.mark.parametrize("design", MEASURED)
def test_an_estimate_is_within_a_factor_of_two(design):
    assert 0.5 < seconds([only(*design)]) / MEASURED[design] < 2


def test_contact_takes_longer():
    assert seconds([only(4, 16, "contact=barrier")]) > 2 * seconds([only(4, 16)])


def test_work_grows_with_every_state_up_to_that_of_the_whole_case():
    case = only(4, 16, "robustness=2")
    done = [Equilibrium().work(case, states) for states in np.linspace(0, case.states, 40)]
    assert done[0] == 0
    assert (np.diff(done) > 0).all()
