"""Results are short to look at: they name what they are and its size."""

from pathlib import Path

import numpy as np
import pytest

import knitlab as kl
from knitlab.design.request import checked_request
from knitlab.model.pure_stripe import PureStripe, tension_across
from knitlab.model.spring_law import SpringCurve
from tests.lab.recorded import Laboratory

CUBE = Path(kl.__path__[0]).parent / "results" / "reference" / "periodic"
LONGEST = 200
STRAIN = np.linspace(0.05, 2.5, 37)


def calibrated(folder):
    stripe = kl.Stripe("rib", 4, period=1.41, k_s=0.817, theta_0=0.772, k_t=0.0107)
    force = np.asarray(tension_across(PureStripe.of(stripe), STRAIN))
    return [kl.calibrate(STRAIN, force, period=1.41)], ["Calibration", "k_s 0.817", "37 points"]


def exported(folder):
    result = kl.export(CUBE, folder / "a.vtu", n_stripe=4, n_subunit=16)
    return [result, *result.meshes], ["a.vtu", "1 meshes", f"{17 * 17} nodes", f"{16 * 16} faces"]


def found_designs(folder):
    curve = {"name": "poisson_ratio", "applied_strain": 0.03 + STRAIN / 10, "value": -STRAIN / 10}
    result = kl.find(CUBE, targets=[curve, "reaction_force < 2 @ 0.2"], most=3)
    return [result, *result.reached, *(each.target for each in result.reached)], [
        "3 designs",
        "2 targets",
        "reaction_force < 2 @ 0.2",
    ]


def imported(folder):
    laboratory = Laboratory(folder)
    result = kl.import_records("markers", laboratory.write(), results=folder)
    return [result], ["Imported", f"{len(result.cube.data_vars)} variables"]


def knitted(folder):
    sample = kl.knit(CUBE, n_stripe=4, n_subunit=16)
    sample.save(folder / "a.k")
    lines = len((folder / "a.k").read_text().splitlines())
    return [sample, sample.chart, sample.machine, sample.prediction, sample.check()], [
        "KnitSample n_stripe 4  n_subunit 16: 64 courses, 32 wales",
        f"{lines} lines",
        "360 needles",
        "16 strains",
    ]


def planned(folder):
    plan = kl.plan("periodic")
    (folder / "periodic").mkdir()
    plan.write(folder / "periodic" / "plan.json")
    status = kl.status("periodic", results=folder)
    return [plan, *plan.cases.values(), *plan.batches, status], [
        "Plan periodic: 10 cases",
        "n_stripe 8  n_subunit 64",
        "10 cases, 10 pending",
    ]


def requested(folder):
    targets = {"targets": ["poisson_ratio = -0.1 @ 0.03:0.06"], "vary": {"n_stripe": [4, 6]}}
    return [checked_request("mine", targets)], ["DesignRequest mine: 1 targets"]


def tabulated(folder):
    curve = SpringCurve(tuple(STRAIN - STRAIN[0]), tuple(STRAIN - STRAIN[0]))
    return [curve], ["SpringCurve", "37 points"]


@pytest.mark.parametrize(
    "call",
    [calibrated, exported, found_designs, imported, knitted, planned, requested, tabulated],
)
def test_what_a_call_returns_is_short_and_says_its_size(call, tmp_path):
    values, words = call(tmp_path)
    shown = [repr(value) for value in values]
    assert not [text for text in shown if len(text) > LONGEST + len(str(tmp_path))]
    assert not [word for word in words if not any(word in text for text in shown)]


@pytest.mark.slow
def test_a_designed_knit_is_short_with_all_its_searches(tmp_path):
    result = kl.design(
        targets="poisson_ratio = -0.1 ± 0.02 @ 0.03:0.06",
        vary={"n_stripe": [4], "n_subunit": [8], "garter_k_t_factor": [0.2, 2.0]},
        robustness=0,
        budget=4,
        results=tmp_path,
    )
    search = result.searches[0]
    shown = [repr(each) for each in (result, result.request, search, *search.trials)]
    assert max(map(len, shown)) <= LONGEST
    assert f"1 candidates, {result.simulations} simulations" in shown[0]
    assert f"{len(search.trials)} trials" in shown[2]
