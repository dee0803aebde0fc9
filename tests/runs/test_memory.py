"""As many workers as memory allows, and a refusal of what does not fit at all."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from knitlab.io.errors import InputError
from knitlab.runs.batches import workers_that_fit
from knitlab.runs.plan import make_plan
from knitlab.runs.run import run_plan
from knitlab.runs.run_options import RunOptions
from tests.runs.fake_simulator import simulate

BATCH = make_plan("periodic", ("n_stripe=4",)).batches[0]


@given(st.lists(st.floats(1.0, 9.0), min_size=1), st.integers(0, 8), st.floats(9.0, 30.0))
def test_any_batches_of_so_many_workers_fit(needs, wished, total):
    several = [replace(BATCH, estimated_bytes=need) for need in needs]
    workers = workers_that_fit(several, wished, total)
    assert min(wished, 1) <= workers <= wished
    assert sum(sorted(needs, reverse=True)[:workers]) <= total or workers <= 1
    if workers < wished:
        assert sum(sorted(needs, reverse=True)[: workers + 1]) > total


def test_a_batch_that_does_not_fit_is_refused_before_anything_is_simulated(tmp_path, monkeypatch):
    monkeypatch.setenv("SLURM_MEM_PER_NODE", "10")
    plan = make_plan("periodic", ("n_stripe=4", "strain_max=0.06"))
    with pytest.raises(InputError, match=r"0\.6 GB.* 0\.0 GB"):
        run_plan(plan, tmp_path, RunOptions(simulate=simulate))
    assert not list(tmp_path.glob("cases/*.nc"))
