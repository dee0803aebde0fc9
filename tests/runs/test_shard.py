"""Shards of a plan: every case in one of them, whatever their number, and about the same work."""

import itertools
import subprocess
import sys

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from knitlab.io.errors import InputError
from knitlab.runs.batches import BATCHES_OF_SHARD, Shard, seconds, split
from knitlab.runs.plan import make_plan

PLAN = make_plan("periodic", ("strain_max=0.06", "k_t_factor=0.8,0.9,1,1.1,1.2,1.3"))
TIMES = {case_id: seconds([case]) for case_id, case in PLAN.cases.items()}


def cases_of_shards(count):
    """Identifiers of the cases of each shard."""
    shards = split(PLAN.batches, PLAN.cases, count)
    return [[case_id for batch in batches for case_id in batch.cases] for batches in shards]


@settings(max_examples=15, deadline=None)
@given(st.integers(1, 2 * len(PLAN.cases)))
def test_every_case_is_in_one_shard(count):
    found = [case_id for ids in cases_of_shards(count) for case_id in ids]
    assert sorted(found) == sorted(PLAN.cases)


@settings(max_examples=15, deadline=None)
@given(st.integers(1, 2 * len(PLAN.cases)))
def test_shards_take_about_the_same_estimated_time(count):
    loads = [sum(TIMES[case_id] for case_id in ids) for ids in cases_of_shards(count)]
    share = sum(TIMES.values()) / count
    # A batch is cut by the number of its cases, which are alike, so that a part may be one longer.
    longest = share / BATCHES_OF_SHARD + max(TIMES.values())
    assert max(loads) - min(loads) <= longest * (1 + 1e-9)


def test_the_cases_of_a_batch_share_a_mesh_and_are_kept_together():
    (whole, *_), two = split(PLAN.batches, PLAN.cases, 1), split(PLAN.batches, PLAN.cases, 2)
    for batch in itertools.chain(whole, *two):
        assert len({PLAN.cases[case_id].mesh_shape for case_id in batch.cases}) == 1
    assert sum(map(len, two)) < 0.6 * len(PLAN.cases)


def test_a_share_is_a_plan_of_its_own():
    share = PLAN.share(Shard(2, 7))
    assert list(share.cases) == [case_id for case_id in PLAN.cases if case_id in share.cases]
    assert sorted(share.cases) == sorted(cases_of_shards(7)[1])
    assert PLAN.share(Shard(1, 1)).cases == PLAN.cases


@pytest.mark.slow
def test_the_split_does_not_depend_on_the_process():
    program = "from tests.runs.test_shard import PLAN, Shard\nprint(*PLAN.share(Shard(2, 7)).cases)"
    said = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert said.stdout.split() == list(PLAN.share(Shard(2, 7)).cases), said.stderr


@pytest.mark.parametrize("text", ["0/4", "5/4", "1/0", "1/100001", "3", "a/b", "-1/4", "1.5/4"])
def test_a_shard_that_is_no_part_of_a_plan_is_refused(text):
    with pytest.raises(InputError, match=f"shard {text}: "):
        Shard.of(text)
