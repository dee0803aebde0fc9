"""A pure stripe whose folds would close: its flanks come to lie on each other, and keep apart."""

from dataclasses import replace

import numpy as np
import pytest

from knitlab.model.contact_layers import contact_layers
from knitlab.model.fabric import Configuration
from knitlab.model.settings import CONTACT_RANGE, ModelOptions
from knitlab.model.surfaces import self_intersections
from knitlab.solvers.equilibrium.contact_barrier import Barrier
from knitlab.solvers.equilibrium.tensile_test import relax
from tests.fabrics import DEFAULT, cell_of, equations, pure, stripe

THICKNESS, PERIODS, ROOM = 0.1, 2, 1 + CONTACT_RANGE
SHUT = 0.05
"""Rest angle at which flanks would lie on each other [rad]."""


class Folded:
    """A relaxed periodic stripe of a rest angle, with contact of a pressure scale or without."""

    def __init__(self, pressure=None, theta_0=SHUT, cells_per_period=4):
        options = ModelOptions(boundary="periodic", cells_per_period=cells_per_period)
        net, fabric = pure(replace(stripe("rib", 4), theta_0=theta_0), options, PERIODS)
        self.shape, self.cells, (self.cell, _) = net.shape, cells_per_period, cell_of(fabric)
        self.contact = None
        if pressure is not None:
            sides = self.cell, float(fabric.cell_y[0])
            self.contact = Barrier(
                net.shape, contact_layers(THICKNESS, pressure, sides, cells_per_period)
            )
        self.state = relax(equations(net, fabric, self.contact), DEFAULT)

    @property
    def period(self):
        return float(self.state.configuration.lengths[0]) / PERIODS

    @property
    def intersections(self):
        positions, lengths = self.state.configuration.positions, self.state.configuration.lengths
        state = Configuration(np.asarray(positions)[None], np.asarray(lengths)[None])
        return int(self_intersections(self.shape, state)[0])

    @property
    def gap(self):
        """Shortest distance in a course of parts further apart than two of the paper's cells."""
        course = np.asarray(self.state.configuration.positions)[0][:, [0, 2]]
        length = [float(self.state.configuration.lengths[0]), 0.0]
        points = np.concatenate([course + np.multiply(turn, length) for turn in (-1, 0, 1)])
        number, apart = np.arange(len(points)), 2 * self.cells // 4
        starts, along = points[:-1], np.diff(points, axis=0)
        gaps = []
        for place in range(len(course), 2 * len(course)):
            part = ((points[place] - starts) * along).sum(axis=1) / (along**2).sum(axis=1)
            foot = starts + np.clip(part, 0, 1)[:, None] * along
            far = np.maximum(abs(number[:-1] - place), abs(number[1:] - place)) > apart
            gaps.append(np.linalg.norm(points[place] - foot, axis=1)[far].min())
        return min(gaps)


def test_without_contact_the_folds_close_to_their_rest_angle():
    free = Folded()
    assert free.state.converged
    assert free.period == pytest.approx(4 * free.cell * np.sin(SHUT / 2), rel=1e-6)
    assert free.period / 2 < THICKNESS


@pytest.mark.parametrize(
    "cells_per_period",
    [
        4,
        pytest.param(8, marks=pytest.mark.slow),
        pytest.param(16, marks=[pytest.mark.slow, pytest.mark.nightly]),
    ],
)
def test_flanks_of_a_stripe_folded_shut_keep_a_thickness(cells_per_period):
    held = Folded(1.0, cells_per_period=cells_per_period)
    assert held.state.converged
    assert held.intersections == 0
    assert held.contact.holds(held.state.unknowns)
    assert THICKNESS < held.gap < ROOM * THICKNESS


@pytest.mark.slow
def test_pressure_only_decides_where_between_thickness_and_range_flanks_lie():
    gaps = [Folded(pressure).gap for pressure in (0.01, 0.1, 1.0)]
    assert gaps == sorted(gaps)
    assert THICKNESS < gaps[0] < gaps[-1] < ROOM * THICKNESS


def test_open_folds_are_those_without_contact():
    free, held = Folded(theta_0=0.77), Folded(1.0, theta_0=0.77)
    assert float(held.state.energy.contact) == 0
    np.testing.assert_allclose(held.state.unknowns, free.state.unknowns, atol=1e-6)
