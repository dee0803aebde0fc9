"""The objective: distances against brute force, derivatives against finite differences."""

import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

from knitlab.cubes.target import read_target
from knitlab.design.objective import Objective, aimed, all_met, check_targets
from knitlab.design.request import DesignRequest, checked_request, with_tolerance
from knitlab.design.search_space import search_space
from knitlab.design.trial import Trial, run_trial
from knitlab.observables.status import Status
from tests.refusals import refused

STRAINS = np.array([0.0, 0.1, 0.2, 0.3])
CURVE = {"name": "poisson_ratio", "applied_strain": [0.05, 0.3], "value": [-0.5, -0.1]}


def objective(*texts, subject_to=(), slopes=None):
    targets, constraints = (
        tuple(with_tolerance(read_target(one)) for one in of) for of in (texts, subject_to)
    )
    request = DesignRequest(name="asked", targets=targets, subject_to=constraints)
    own = (("thickness", thickness),)
    return Objective(request, own, np.zeros((10, 1)) if slopes is None else slopes)


def synthetic(ratio, force):
    """A trial whose curves are linear in strain, Poisson's ratio without a value at zero."""
    curves = {"poisson_ratio": ratio(STRAINS), "reaction_force": force(STRAINS)}
    curves["poisson_ratio"][0] = np.nan
    results = xr.Dataset(
        {name: ("applied_strain", each) for name, each in curves.items()},
        {"applied_strain": STRAINS},
    ).assign(status=Status.ok)
    return Trial(None, None, results)


def test_distances_are_those_of_a_fine_grid():
    trial = synthetic(lambda e: -0.5 + e, lambda e: 4 * e)
    asked = objective(
        "poisson_ratio = -0.3 ± 0.05 @ 0.12:0.28",
        "reaction_force < 0.6 ± 0.2 @ 0.1:0.3",
        "mean(reaction_force) = 1 ± 0.5 @ 0.1:0.3",
        CURVE | {"tolerance": 0.1, "applied_strain": [0.1, 0.3]},
    )
    fine = np.linspace(0.12, 0.28, 100_001)
    wide = np.linspace(0.1, 0.3, 100_001)
    expected = [
        np.sqrt(np.mean((-0.5 + fine + 0.3) ** 2)),
        np.sqrt(np.mean(np.maximum(4 * wide - 0.6, 0) ** 2)),
        0.2,
        np.sqrt(np.mean((-0.5 + wide - (-0.5 + 2 * (wide - 0.1))) ** 2)),
    ]
    assert asked.off_by(trial) == pytest.approx(expected, rel=2e-3)
    assert asked.distance(asked.off_by(trial)) == pytest.approx(
        np.sqrt(np.mean((np.array(expected) / [0.05, 0.2, 0.5, 0.1]) ** 2)), rel=2e-3
    )


def test_squared_residuals_sum_to_the_squared_distance():
    trial = synthetic(lambda e: -0.5 + e, lambda e: 4 * e)
    asked = objective("poisson_ratio = -0.3 @ 0.1:0.3", "spread(reaction_force) > 2 @ 0.1:0.3")
    aims = objective(*(each for each in map(aimed, asked.request.targets)))
    residuals, _ = asked.residuals(trial)
    assert residuals @ residuals == pytest.approx(aims.distance(aims.off_by(trial)) ** 2)
    assert aims.request.targets[1].low > asked.request.targets[1].low


def met_by(asked, trial):
    return all_met(asked.request.wanted, asked.off_by(trial))


def test_met_means_within_a_tolerance_of_a_value_and_within_a_range():
    trial = synthetic(lambda e: -0.3 + 0 * e, lambda e: 4 * e)
    for text, met in {
        "poisson_ratio = -0.32 ± 0.03 @ 0.1:0.3": True,
        "poisson_ratio = -0.32 ± 0.01 @ 0.1:0.3": False,
        "reaction_force < 0.8 ± 0.5 @ 0.2": True,
        "reaction_force < 0.79 ± 0.5 @ 0.2": False,
        "poisson_ratio < -0.2 @ 0.1:0.3": True,
    }.items():
        assert met_by(objective(text), trial) == met, text
        kept = objective("reaction_force > 0 @ 0.1", subject_to=[text])
        assert met_by(kept, trial) == met == (kept.violation(kept.off_by(trial)) <= 1 and met), text


def test_constraints_are_negative_where_they_are_violated():
    trial = synthetic(lambda e: -0.3 + 0 * e, lambda e: 4 * e)
    held = objective(
        "reaction_force > 0 @ 0.1", subject_to=["0.5 < reaction_force < 0.7 @ 0.1:0.2"]
    )
    rows, _ = held.constraints(trial)
    assert rows.min() < 0 < rows.max()
    assert held.violation(held.off_by(trial)) > 0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("poison_ratio = 1 @ 0.1", ["poison_ratio", "'poisson_ratio'"]),
        ("poisson_ratio = 1", ["poisson_ratio", "@ STRAIN"]),
        ("knit_cell_x < 20 @ 0.1", ["knit_cell_x", "window"]),
        ("capacitance > 1 @ 0.1", ["capacitance"]),
        ("poisson_ratio < 0 @ 0:0.3", ["0:0.3", "0.03", "poisson_ratio"]),
    ],
)
def test_targets_that_a_test_cannot_have_are_refused(text, words):
    space = search_space(checked_request("sleeve", {"targets": ["poisson_ratio < 0 @ 0.1"]}))
    case, _ = space.case(space.designs[0], np.zeros(0))
    with refused(*words):
        check_targets([read_target(text)], (), case)


def thickness(shape):
    # Independent of a translation of the sheet, which costs no energy.
    return jnp.std(shape.positions[..., 2])


WANTED = [
    "poisson_ratio = 0.3 ± 0.05 @ 0.03:0.06",
    CURVE | {"tolerance": 0.1, "applied_strain": [0.03, 0.05]},
    "reaction_force = 9 ± 1 @ 0.05",
    "mean(reaction_force) = 9 ± 1 @ 0.01:0.06",
    "slope(poisson_ratio) = 9 ± 1 @ 0.03:0.06",
    "max(poisson_ratio) > 1 ± 1 @ 0.03:0.06",
    "spread(reaction_force) > 5 ± 1 @ 0.03:0.06",
    "knit_cell_x = 50 ± 1",
    "knit_length < 1 ± 1",
    "relaxed_cell_y = 50 ± 1",
    "force_per_width = 9 ± 1 @ 0.03:0.06",
    "tangent_stiffness = 99 ± 10 @ 0.03",
    "stretch_energy = 9 ± 1 @ 0.06",
    "thickness = 9 ± 1 @ 0:0.06",
]


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.parametrize("boundary", ["periodic", "clamped"])
def test_derivatives_of_every_kind_of_target_are_those_of_finite_differences(tmp_path, boundary):
    wanted = list(WANTED)
    # A search refuses targets that contradict the first; their derivatives exist all the same.
    contradicting = [one for one in wanted if one is WANTED[1] or "max" in str(one)]
    table = {
        "targets": [
            one for one in wanted if one not in contradicting and "thickness" not in str(one)
        ],
        "vary": {
            "n_stripe": [4],
            "n_subunit": [8],
            "rib_k_t_factor": [0.5, 2.0],
            "garter_theta_0_factor": [0.8, 1.2],
            "rib_k_s": [0.1, 9.0],
            "period_factor": [0.9, 1.1],
            "stitch_width": [0.4, 0.7],
        },
        "settings": {"boundary": boundary, "unit_cells": [2, 2], "tolerance": 1e-11},
    }
    if boundary == "periodic":
        for targets in (wanted, table["targets"]):
            targets.remove("knit_length < 1 ± 1")
        table["settings"]["unit_cells"] = [1, 1]
    space = search_space(checked_request("sleeve", table))
    asked = objective(
        *wanted, subject_to=["0 < reaction_force < 9 @ 0.03:0.06"], slopes=space.parameter_slopes()
    )
    point = np.array([0.4, 0.6, 0.5, 0.45, 0.5])

    def trial(at):
        return run_trial(tmp_path, *space.case((4, 8), at), (("thickness", thickness),))

    middle = trial(point)
    assert middle.converged
    slopes = asked.slopes(middle)
    for variable in range(len(point)):
        step = np.zeros(len(point))
        step[variable] = 1e-3
        ends = trial(point + step), trial(point - step)
        for rows_of in (asked.residuals, asked.constraints):
            central = (rows_of(ends[0])[0] - rows_of(ends[1])[0]) / 2e-3
            _, jacobian = rows_of(middle, slopes)
            np.testing.assert_allclose(
                jacobian[:, variable], central, rtol=2e-3, atol=2e-4 * abs(central).max() + 1e-7
            )
