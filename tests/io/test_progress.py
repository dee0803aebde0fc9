"""Progress, as a log shows it and as the parts of the work report it."""

import io
import time
from threading import Thread

import pytest

from knitlab.io import progress
from knitlab.io.progress import Progress, counter, each, listening, part
from knitlab.runs.plan import make_plan
from knitlab.runs.progress import CaseProgress

DEADLINE = 20.0


@pytest.fixture(autouse=True)
def shown(monkeypatch):
    """Whatever other tests have chosen."""
    monkeypatch.setattr(progress, "_shown", True)


@pytest.fixture
def at_once(monkeypatch):
    """Progress is shown at once, and every change of it."""
    monkeypatch.setattr(progress, "SECONDS_UNTIL_SHOWN", 0.0)
    monkeypatch.setattr(progress, "SECONDS_BETWEEN_LINES", 0.0)


@pytest.fixture
def cases():
    return make_plan("periodic", ("n_stripe=4", "n_subunit=16", "robustness=0")).cases


def lines(log):
    return log.getvalue().splitlines()


def shares(log):
    return [float(line.split(" %")[0].rpartition(" ")[2]) for line in lines(log)]


def test_a_log_continues_while_no_work_is_reported(cases, monkeypatch):
    monkeypatch.setattr(progress, "SECONDS_UNTIL_SHOWN", 0.01)
    monkeypatch.setattr(progress, "SECONDS_BETWEEN_LINES", 0.02)
    log, began = io.StringIO(), time.monotonic()
    with CaseProgress(cases, file=log):
        while len(lines(log)) < 4 and time.monotonic() - began < DEADLINE:
            time.sleep(0.01)
    written = lines(log)
    assert len(written) >= 4
    # Before anything is done, the time that is left is that of the plan.
    assert all(line.startswith("0/1 cases, 0.0 %") and "about 00:" in line for line in written)
    assert "\r" not in log.getvalue()
    # It ends with the work.
    time.sleep(0.1)
    assert lines(log) == written


def test_what_ends_soon_is_not_shown(cases, monkeypatch):
    log = io.StringIO()
    with CaseProgress(cases, file=log) as shown:
        shown.ended(next(iter(cases)))
    assert log.getvalue() == ""


@pytest.mark.usefixtures("at_once")
def test_progress_can_be_switched_off(cases, monkeypatch):
    monkeypatch.setattr(progress, "_shown", True)
    log = io.StringIO()
    with CaseProgress(cases, shown=False, file=log) as shown:
        shown.ended(next(iter(cases)))
    progress.show_progress(False)
    with Progress("figures", file=log):
        assert list(each("ab", "figure")) == ["a", "b"]
    assert log.getvalue() == ""


@pytest.mark.usefixtures("at_once")
def test_a_log_counts_parts_of_a_state_and_names_what_follows_the_states():
    cases = make_plan("sensor", ("n_stripe=4", "n_subunit=16")).cases
    log, (case_id,) = io.StringIO(), cases
    states = cases[case_id].states
    with CaseProgress(cases, file=log) as shown:
        for done in (0.25, 0.5, 3.0, states):
            shown.reached(case_id, done)
        shown.reached(case_id, states + 0.5, "capacitances 1/2")
        shown.ended(case_id)
        # An earlier state that is reported again does not decrease it.
        shown.reached(case_id, 1.0)
    assert shares(log) == sorted(shares(log))
    assert shares(log)[-1] == 100
    assert len({*shares(log)}) >= 4
    assert any("0/1 cases, capacitances 1/2" in line for line in lines(log))
    assert "left" in lines(log)[2]


def test_parts_within_parts_add_up_to_the_whole():
    reported = []
    with listening(lambda share, doing: reported.append((share, doing))):
        for _ in each([1, 2], "design"):
            for _ in each([1, 2, 3, 4], "state"):
                pass
    assert (0.75, "design 2/2, state 3/4") in reported
    shares = [share for share, _ in reported]
    assert shares == sorted(shares)
    assert shares[-1] == 1


@pytest.mark.usefixtures("at_once")
def test_threads_are_counted_together():
    log = io.StringIO()
    with Progress("relaxing", file=log), part(0.5, 1.0):
        count = counter(4, "start")
        threads = [Thread(target=count) for _ in range(4)]
        for thread in threads:
            thread.start()
            thread.join()
    assert {50.0, 62.5, 75.0, 87.5, 100.0} <= {*shares(log)}


def test_nothing_is_reported_where_nobody_listens():
    assert list(each("ab", "letter")) == ["a", "b"]
    counter(1, "start")()
