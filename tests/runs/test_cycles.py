"""Friction and cycles of a workflow: dimensions, what is refused, what a cube derives."""

import numpy as np
import xarray as xr

from knitlab.cubes.derived import with_derived
from knitlab.runs.batches import seconds
from knitlab.runs.plan import make_plan

ONE = ("n_stripe=4", "n_subunit=8", "robustness=0", "strain_max=0.06")


def test_cycles_are_a_dimension_and_take_their_time():
    plan = make_plan("periodic", (*ONE, "cycle=1,3", "fold_friction=0.1"))
    assert plan.dims == ("n_stripe", "n_subunit", "cycle")
    first, third = plan.cases.values()
    assert (first.cycle, third.cycle) == (1, 3)
    assert first.friction.fold_friction == third.friction.fold_friction == 0.1
    assert seconds([third]) > seconds([first])


def test_a_set_is_where_the_force_of_unloading_vanishes():
    strain = np.array([0.0, 0.1, 0.2, 0.3])
    back = xr.DataArray(
        [[-1.0, -0.5, 0.5, 2.0], [0.0, 1, 2, 3], [1.0, 2, 3, 4]], dims=("n", "applied_strain")
    )
    cube = xr.Dataset(
        {"reaction_force": abs(back) + 1, "reaction_force_unloading": back},
        {"applied_strain": strain},
    )
    np.testing.assert_allclose(with_derived(cube)["residual_strain"], [0.15, 0.0, np.nan])
