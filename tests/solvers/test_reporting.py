"""Progress that a run reports."""

import itertools

from hypothesis import given
from hypothesis import strategies as st

from knitlab.runs.plan import make_plan
from knitlab.solvers.equilibrium import tests_of_cases
from knitlab.solvers.equilibrium.method import RELAXATION_STEPS, Equilibrium
from knitlab.solvers.equilibrium.tests_of_cases import Reporter

CASES = make_plan("periodic", ("n_stripe=4", "n_subunit=16,32", "robustness=2")).cases


def test_progress_moves_while_the_fabric_relaxes(monkeypatch):
    clock = itertools.count()
    monkeypatch.setattr(tests_of_cases.time, "monotonic", lambda: float(next(clock)))
    reports = []
    reporter = Reporter(reports.append)

    for _ in range(30):
        reporter.factorised()
    reporter.done(1)
    reporter.factorised()
    reporter.done(2)
    assert reports == sorted(reports)
    assert 0 < reports[0] < 0.1
    assert 0.5 < reports[29] < 1
    assert reports[30] == 1
    assert reports[-1] == 2


@given(st.lists(st.floats(0, 1), min_size=2, max_size=9))
def test_work_grows_from_zero_to_that_of_all_tests(parts):
    case = next(iter(CASES.values()))
    work = Equilibrium().work
    works = [work(case, case.states * part) for part in sorted(parts)]
    assert works == sorted(works)
    assert work(case, 0) == 0
    one = work(case, 1) / RELAXATION_STEPS
    states = len(case.applied_strain)
    later = work(case, states + 2) - work(case, states + 1)
    assert abs((work(case, 2) - work(case, 1)) / later - 1) < 1e-9
    assert abs(work(case, case.states) / (3 * (states - 1 + RELAXATION_STEPS) * one) - 1) < 1e-12
