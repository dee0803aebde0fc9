import numpy as np
import pytest

from knitlab.runs.plan import make_plan
from knitlab.runs.recorded_plan import PLAN, read_plan

SETTINGS = {"n_stripe": 4, "n_subunit": [16], "boundary": "clamped"}


@pytest.mark.parametrize(
    ("settings", "overrides"),
    [
        ({"k_t_factor": [0.8, 1.0]}, ("k_t_factor=0.8,1.0",)),
        ({"k_t_factor": np.array([0.8, 1.0])}, ("k_t_factor=0.8,1.0",)),
        ({"z_max": np.float64(0.6)}, ("z_max=0.6",)),
        ({"max_iterations": np.int64(100)}, ("max_iterations=100",)),
        ({"unit_cells": (3, 2)}, ("unit_cells=3,2",)),
        ({"unit_cells": [(1, 1), (3, 2)]}, ("unit_cells=[[1, 1], [3, 2]]",)),
        ({"unloading": True, "further_strains": 0.23}, ("unloading=true", "further_strains=0.23")),
        ({"model.hinges": ["all", "fold_lines"]}, ("hinges=all,fold_lines",)),
        ({"pattern": ["RG", "GR"]}, ("pattern=RG,GR",)),
        (
            {"tolerance": 1e-10, "path_step": 0.1 + 0.2},
            ("tolerance=1e-10", "path_step=0.30000000000000004"),
        ),
    ],
)
def test_python_values_make_the_plan_that_text_makes(settings, overrides):
    text = ("n_stripe=4", "n_subunit=16", "boundary=clamped")
    by_value = make_plan("periodic", SETTINGS | settings)
    assert list(by_value.cases) == list(make_plan("periodic", (*text, *overrides)).cases)
    assert list(make_plan("periodic", by_value.overrides).cases) == list(by_value.cases)


def test_a_plan_keeps_the_values_of_its_overrides_by_the_names_of_their_settings(tmp_path):
    given = {"n_stripe": 4, "protocol.strain_max": 0.06, "k_t_factor": np.array([0.8, 1.0])}
    plan = make_plan("periodic", given)
    plan.write(tmp_path / PLAN)
    values = {"n_stripe": 4, "strain_max": 0.06, "k_t_factor": [0.8, 1.0]}
    assert read_plan(tmp_path)["overrides"] == plan.overrides == values
    assert make_plan("periodic", [f"{name}={value}" for name, value in values.items()]) == plan
