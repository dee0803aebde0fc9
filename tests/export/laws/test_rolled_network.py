"""A network rolled around a rigid cylinder: its contact forces against Laplace's law and ``wear``.

One unit cell is an nth of the tube: its images are turned about the axis, and shifted along it.
Nodes press on the cylinder by a penalty; all nodes and the length of the tube are free.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize

import knitlab as kl
from knitlab.cubes.case_file import length_factor, network_configurations
from knitlab.cubes.chosen_case import selected_case
from knitlab.cubes.recorded_case import recorded_case
from knitlab.export.laws.sleeve import MMHG, Knit, Limb, worn
from knitlab.model.energy import hinge_energy, spring_energy
from tests.export.laws.test_law import LAW

pytestmark = [pytest.mark.slow, pytest.mark.nightly]
PENALTY = 100.0  # [N/mm]
OUTSIDE, INSIDE = 1, -1  # where the technical face is


class Tube:
    """The fabric that the kept cube pulls along the courses, in mm of its network."""

    def __init__(self):
        self.row = kl.open_cube(LAW).squeeze().sel(sample=1)
        self.file = selected_case(kl.open_cube(LAW), {"sample": 1})
        self.states = network_configurations(self.file)
        self.net, self.fabric = recorded_case(self.file).assemble()
        self.thickness = np.ptp(self.states.positions[0, ..., 2])
        self._slope = jax.jit(jax.value_and_grad(self._total))
        self._hessian = jax.jit(jax.hessian(self._total))

    def _vectors(self, elements, nodes, length, angle):
        x, y, z = jnp.moveaxis(nodes[elements.nodes], -1, 0)
        turn = elements.images[..., 0] * angle
        turned = [
            jnp.cos(turn) * x + jnp.sin(turn) * z,
            y + elements.images[..., 1] * length,
            jnp.cos(turn) * z - jnp.sin(turn) * x,
        ]
        return jnp.einsum("vn,cen->vce", elements.incidence, jnp.stack(turned))

    def _total(self, unknowns, angle, radius):
        nodes, fabric = unknowns[:-1].reshape(-1, 3), self.fabric
        vectors = partial(self._vectors, nodes=nodes, length=unknowns[-1], angle=angle)
        stretch = fabric.stretch_stiffness
        springs = vectors(self.net.springs), fabric.rest_length, stretch, fabric.spring_law
        hinges = vectors(self.net.hinges), fabric.rest_fold, fabric.fold_stiffness
        elastic = spring_energy(*springs).sum() + hinge_energy(*hinges, fabric.fold_angle).sum()
        inside = jnp.maximum(radius - jnp.hypot(nodes[:, 0], nodes[:, 2]), 0)
        return elastic + PENALTY / 2 * (inside**2).sum()

    def pressure(self, state, cells, radius, face):
        """Contact forces over area, from a state of the pull that is rolled up [N/mm²]."""
        angle = face * 2 * np.pi / cells
        (length, along, _), nodes = self.states.lengths[state], self.states.positions[state]
        x, y, z = nodes.reshape(-1, 3).T
        at, turn = radius + face * z - (face * z).min(), x / length * angle
        placed = np.stack([face * at * np.sin(turn), y, face * at * np.cos(turn)], axis=-1)
        given = angle, radius
        found = minimize(
            lambda unknowns: tuple(map(np.asarray, self._slope(unknowns, *given))),
            np.append(placed, along),
            jac=True,
            method="L-BFGS-B",
            options={"maxiter": 5000, "maxfun": 10000, "maxcor": 50, "ftol": 0, "gtol": 1e-5},
        ).x
        for _ in range(20):
            gradient = np.asarray(self._slope(found, *given)[1])
            if np.abs(gradient).max() < 1e-10:
                break
            values, modes = np.linalg.eigh(self._hessian(found, *given))
            # To turn the tube, or to shift it along its axis, costs nothing.
            found = found - modes @ (modes.T @ gradient / np.maximum(np.abs(values), 1e-6))
        else:
            pytest.fail(f"not relaxed: {np.abs(gradient).max():g} N")
        assert values[2] > 1e-4
        nodes = found[:-1].reshape(-1, 3)
        inside = np.maximum(radius - np.hypot(nodes[:, 0], nodes[:, 2]), 0)
        return PENALTY * inside.sum() / (2 * np.pi / cells * radius * found[-1])


@pytest.fixture(scope="module")
def tube():
    return Tube()


@pytest.mark.parametrize(("state", "cells", "apart"), [(5, 64, 0.02), (4, 8, 0.06), (5, 8, 0.12)])
def test_a_rolled_network_presses_as_laplace_and_the_law_say(tube, state, cells, apart):
    """The faces press differently, to first order in the curvature; their mean is compared.

    Around 2.4 m of cloth, and around a calf, where the contact also flattens the folds.
    """
    stretched, along, _ = tube.states.lengths[state]
    radius = cells * stretched / (2 * np.pi) - tube.thickness / 2
    pressures = [tube.pressure(state, cells, radius, face) for face in (OUTSIDE, INSIDE)]
    tension = tube.row["reaction_force"].values[state] / along
    assert np.mean(pressures) == pytest.approx(tension / radius, rel=apart)
    factor = length_factor(tube.row)
    width = factor * tube.states.lengths[0, 0]
    knit = Knit(kl.law(LAW), 1, width, 0.0, factor * tube.thickness)
    limb = Limb(np.zeros(1), np.array([2 * np.pi * factor * radius]))
    place = worn(knit, limb, cells).iloc[0]
    in_mmhg = np.array(pressures) / factor**2 / MMHG
    assert in_mmhg.mean() == pytest.approx(place["pressure_mmHg"], rel=apart)
    assert np.abs(in_mmhg - place["pressure_mmHg"]).max() < place["error_mmHg"]
