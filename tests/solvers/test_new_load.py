"""A load that is declared in one class, as CONTRIBUTING shows, needs nothing else."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest

from knitlab.runs.plan import make_plan
from knitlab.runs.simulate import simulated
from knitlab.solvers.loads.biaxial import Biaxial
from knitlab.solvers.loads.load import LoadSetting


@dataclass(frozen=True)
class ConstantWidth(Biaxial):
    """A pull along the wales; clamps keep the width."""

    kind: str = "constant_width"
    settings: ClassVar[tuple[LoadSetting, ...]] = ()


@pytest.mark.slow
def test_a_pull_at_constant_width_is_biaxial_with_ratio_0():
    settings = ("n_stripe=4", "n_subunit=8", "strain_max=0.06", "strain_step=0.06")
    (case,) = make_plan("periodic", settings).cases.values()
    own, known = (
        simulated(replace(case, load=load), lambda name, states: None)
        for load in (ConstantWidth(), Biaxial(ratio=0.0))
    )
    assert np.isfinite(own["reaction_force_across"]).all()
    np.testing.assert_array_equal(own["reaction_force"], known["reaction_force"])
    np.testing.assert_allclose(own["mean_strain_xx"], 0, atol=1e-9)
