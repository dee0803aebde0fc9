"""Steps between the walls end where a brute-force search finds the least energy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knitlab.equilibrium.walls import Walls

WALLS = Walls(z_max=6.0, stiffness=100.0)
FRACTIONS = np.linspace(0.0, 1.0, 10_001)


def modelled(z, dz, slope, curvature, part=1.0):
    """Energy along a step: a quadratic with the penalty of the walls on its own."""
    touched = np.abs(z) > WALLS.z_max
    stiffness = part * WALLS.stiffness
    depth = np.where(touched, z - np.sign(z) * WALLS.z_max, 0.0)
    along = FRACTIONS[:, None] * dz
    excess = np.maximum(np.abs(z + along) - WALLS.z_max, 0.0)
    walls = stiffness / 2 * (excess**2).sum(axis=1)
    own_slope = slope - stiffness * depth @ dz
    own_curvature = curvature - stiffness * (dz[touched] ** 2).sum()
    return own_slope * FRACTIONS + own_curvature / 2 * FRACTIONS**2 + walls


@given(
    seed=st.integers(0, 2**32 - 1),
    nodes=st.integers(1, 30),
    length=st.floats(1e-3, 30.0),
    part=st.sampled_from([1.0, 1e-3]),
)
def test_the_fraction_has_the_least_energy(seed, nodes, length, part):
    random = np.random.default_rng(seed)
    z, dz = random.uniform(-6.01, 6.01, nodes), length * random.normal(size=nodes)
    touched = np.abs(z) > WALLS.z_max
    fabric = random.uniform(0.01, 10.0)
    curvature = fabric + part * WALLS.stiffness * float((dz[touched] ** 2).sum())
    # A Newton step: without further contact the whole step has the least energy.
    fraction = WALLS.lowest(z, dz, -curvature, curvature, part)
    energies = modelled(z, dz, -curvature, curvature, part)
    assert fraction == pytest.approx(FRACTIONS[np.argmin(energies)], abs=4e-4, rel=4e-3)


def test_a_step_that_reaches_no_wall_is_taken_whole():
    z, dz = np.array([-5.9, 0.0, 5.9]), np.array([0.05, 3.0, -0.05])
    assert WALLS.lowest(z, dz, slope=-1.0, curvature=1.0) == 1.0


def test_a_step_from_wall_to_wall_is_shortened():
    z, dz = np.array([-6.0]), np.array([20.0])
    assert 0.55 < WALLS.lowest(z, dz, slope=-1.0, curvature=1.0) < 0.65
