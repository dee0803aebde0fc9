"""Estimates of time against measured times, and how they grow."""

import numpy as np
import pytest

from knitlab.runs.batches import seconds, seconds_to_measure
from knitlab.runs.plan import make_plan
from knitlab.solvers.equilibrium.method import Equilibrium

MEASURED = {(2, 32): 3.9, (4, 32): 0.74, (4, 48): 2.1, (6, 72): 3.7, (8, 48): 0.32, (8, 96): 3.6}
"""Processor time of relaxation and five strain steps of periodic fabric without contact, on a core
of an Intel Xeon with AVX-512 [s]."""


TOUCHING = {(2, 16): 2.6, (4, 16): 0.7, (4, 32): 20.0, (6, 72): 110.0, (8, 32): 1.5, (8, 64): 22.0}
"""The same with contact at 0.25 mm, beside other programs; of the page on contact."""
CAPACITANCES = {16: 19.3, 32: 50.0}
"""The same of the capacitances of (4, n_subunit) in the workflow sensor, on an AMD EPYC."""


def only(n_stripe, n_subunit, *settings):
    test = ("strain_max=0.2", "strain_step=0.04", "robustness=0", "contact=none")
    design = (f"n_stripe={n_stripe}", f"n_subunit={n_subunit}")
    (case,) = make_plan("periodic", (*design, *test, *settings)).cases.values()
    return case


@pytest.mark.parametrize("design", MEASURED)
def test_an_estimate_is_within_a_factor_of_two(design):
    assert 0.5 < seconds([only(*design)]) / MEASURED[design] < 2


@pytest.mark.parametrize("design", TOUCHING)
def test_an_estimate_with_contact_is_within_a_factor_of_four(design):
    case = only(*design, "contact=barrier", "thickness=0.25")
    assert 0.25 < seconds([case]) / TOUCHING[design] < 4


@pytest.mark.parametrize("n_subunit", CAPACITANCES)
def test_an_estimate_of_capacitances_is_within_a_factor_of_two(n_subunit):
    (case,) = make_plan("sensor", ("n_stripe=4", f"n_subunit={n_subunit}")).cases.values()
    assert 0.5 < seconds_to_measure(case) / CAPACITANCES[n_subunit] < 2


def test_work_grows_with_every_state_up_to_that_of_the_whole_case():
    case = only(4, 16, "robustness=2")
    done = [Equilibrium().work(case, states) for states in np.linspace(0, case.states, 40)]
    assert done[0] == 0
    assert (np.diff(done) > 0).all()
