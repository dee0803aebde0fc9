"""Portions: put together they make up the fabric, whatever its mesh shape."""

import jax
import numpy as np
import pytest

from knitlab.mechanics.evaluation import Stage, element_hessians, evaluate
from knitlab.mechanics.portions import HEIGHTS, PortionedFabric, portions
from knitlab.model.fabric import flat_sheet
from knitlab.model.reading import Reading
from tests.fabrics import checkered, shaken

PART = Stage(fold=0.7, wall=0.3)
SHEETS = [("clamped", 1), ("clamped", 4), ("periodic", 1), ("periodic", 4)]
"""Of less than one portion, and of some that are not all full."""


@pytest.mark.parametrize(("boundary", "periods"), SHEETS)
def test_energy_forces_and_hessians_are_those_of_the_whole(boundary, periods):
    net, fabric = checkered(4, periods, Reading(boundary=boundary, hinges="all"))
    full, spare = divmod(net.shape.nodes, HEIGHTS)
    assert (full > 0) == (periods > 1)
    assert spare or boundary == "periodic"
    at = np.array(shaken(flat_sheet(net, fabric), 0.1))
    at[2:-2:6] += float(fabric.z_max)
    portioned = PortionedFabric.of(net.shape, fabric)
    pairs = [
        (portioned.evaluate(PART, at), evaluate(net, fabric, PART, at)),
        (portioned.element_hessians(PART, at), element_hessians(net, fabric, PART, at)),
    ]
    for found, whole in pairs:
        for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(whole), strict=True):
            assert np.shape(one) == np.shape(other)
            assert np.allclose(one, other, rtol=1e-12, atol=1e-12)
    assert all(float(part) > 0 for part in jax.tree.leaves(pairs[0][0].energy))


def test_the_incidence_of_any_motion_of_the_whole_is_none():
    """Vectors are differences: moved as a whole, a sheet has the same, but for its heights."""
    its = portions(checkered(4, 1, Reading(boundary="clamped"))[0].shape)
    for axis in (0, 1):
        moved = np.zeros(its.shape.unknowns)
        moved[axis:-2:3] = 1.0
        assert not (its.incidence @ moved).any()
    moved = np.zeros(its.shape.unknowns)
    moved[2:-2:3] = 1.0
    assert (its.incidence @ moved).sum() == its.shape.nodes
