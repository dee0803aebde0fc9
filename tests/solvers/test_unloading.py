"""Unloading: an elastic fabric gives back what it took, unless it snaps."""

import numpy as np
import pytest

import knitlab as kl


@pytest.mark.parametrize("load", ["warp", "weft"])
def test_fabric_that_does_not_snap_gives_all_energy_back(load):
    protocol = kl.Protocol(strain_max=0.06, unloading=True, load=load)
    test = kl.simulate(kl.Design(4, 8, boundary="periodic"), protocol=protocol)
    assert not test["snapped"].any()
    forces = (test[name] for name in ("reaction_force", "reaction_force_unloading"))
    np.testing.assert_allclose(*forces, atol=1e-7)
    assert float(test["energy_recovery"]) == pytest.approx(1, abs=1e-6)
