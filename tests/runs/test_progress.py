"""Progress of a run, as a log shows it."""

import io
import time

import pytest

from knitlab.runs import progress
from knitlab.runs.plan import make_plan
from knitlab.runs.progress import ProgressBar

DEADLINE = 20.0


@pytest.fixture
def cases():
    return make_plan("periodic", ("n_stripe=4", "n_subunit=16", "robustness=0")).cases


def lines(log):
    return log.getvalue().splitlines()


def test_a_log_continues_while_no_work_is_reported(cases, monkeypatch):
    monkeypatch.setattr(progress, "SECONDS_BETWEEN_LINES", 0.02)
    log, began = io.StringIO(), time.monotonic()
    with ProgressBar(cases, shown=True, file=log):
        while len(lines(log)) < 4 and time.monotonic() - began < DEADLINE:
            time.sleep(0.01)
        written = lines(log)
    assert len(written) >= 4
    assert all(line.startswith("0/1 cases, 0.0 %") for line in written)
    assert "\r" not in log.getvalue()
    # It ends with the bar.
    count = len(lines(log))
    time.sleep(0.1)
    assert len(lines(log)) == count


def test_a_log_counts_parts_of_a_state_and_ends_at_the_total(cases, monkeypatch):
    monkeypatch.setattr(progress, "SECONDS_BETWEEN_LINES", 0.0)
    log, (case_id,) = io.StringIO(), cases
    with ProgressBar(cases, shown=True, file=log) as bar:
        for states in (0.25, 0.5, 3.0):
            bar.reached(case_id, states)
        bar.ended(case_id)
        # An earlier state that is reported again does not decrease it.
        bar.reached(case_id, 1.0)
    shares = [float(line.split(",")[1].strip(" %")) for line in lines(log)]
    assert shares == sorted(shares)
    assert shares[-1] == 100
    assert len(set(shares)) >= 4


def test_a_hidden_bar_writes_nothing(cases, monkeypatch):
    monkeypatch.setattr(progress, "SECONDS_BETWEEN_LINES", 0.001)
    log = io.StringIO()
    with ProgressBar(cases, shown=False, file=log) as bar:
        time.sleep(0.05)
        bar.ended(next(iter(cases)))
    assert log.getvalue() == ""
