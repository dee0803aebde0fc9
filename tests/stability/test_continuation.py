"""Continuation against closed forms: a shallow truss that snaps, a strut that buckles."""

import numpy as np
import pytest
import scipy.sparse as sp

from knitlab.stability.continuation import (
    Kind,
    equilibrium,
    follow,
    lowest_eigenvalues,
    switched,
)


@pytest.fixture(autouse=True)
def fine(monkeypatch):
    """Steps and tolerance for energies of the order of 1."""
    for name, value in (("FIRST", 0.01), ("LONGEST", 0.03), ("TOLERANCE", 1e-12)):
        monkeypatch.setattr(f"knitlab.stability.continuation.{name}", value)


class Analytic:
    """An energy of one unknown, by its derivatives."""

    size = 1.0
    neutral = lift = np.zeros((1, 0))

    def energy(self, u, t):
        return self.stored(u[0], t)

    def force(self, u, t):
        return np.array([self.slope(u[0], t)])

    def stiffness(self, u, t):
        return sp.csc_array([[self.curvature(u[0], t)]])

    def force_by_parameter(self, u, t):
        return np.array([(self.slope(u[0], t + 1e-6) - self.slope(u[0], t - 1e-6)) / 2e-6])


class Truss(Analytic):
    """Two bars of span 1 each and height w, pressed down by a force t (von Mises)."""

    rest = np.hypot(1.0, 0.3)

    def stored(self, w, t):
        return (np.hypot(1, w) - self.rest) ** 2 + t * w

    def slope(self, w, t):
        return 2 * w * (1 - self.rest / np.hypot(1, w)) + t

    def curvature(self, w, t):
        return 2 * (1 - self.rest / np.hypot(1, w) ** 3)


class Strut(Analytic):
    """Two rigid bars of length 1, with a hinge of stiffness 1 between, pressed by a force t."""

    def stored(self, angle, t):
        return 2 * angle**2 - 2 * t * (1 - np.cos(angle))

    def slope(self, angle, t):
        return 4 * angle - 2 * t * np.sin(angle)

    def curvature(self, angle, t):
        return 4 - 2 * t * np.cos(angle)


def test_a_truss_snaps_at_its_limit_points_and_is_followed_through_them():
    points = follow(Truss(), equilibrium(Truss(), np.array([0.3]), 0.0), (-0.1, 0.1))
    limits = [point for point in points if point.kind is Kind.limit]
    # The force is largest where the length cubed is the rest length.
    height = np.sqrt(Truss.rest ** (2 / 3) - 1)
    assert [point.unknowns[0] for point in limits] == pytest.approx([height, -height], abs=1e-5)
    largest = -Truss().slope(height, 0.0)
    assert [point.parameter for point in limits] == pytest.approx([largest, -largest], abs=1e-9)
    unstable = [point for point in points if point.unstable and point.kind is Kind.regular]
    assert all(abs(point.unknowns[0]) < height for point in unstable)
    assert points[-1].unknowns[0] < -0.3, "it ends inverted, beyond both limit points"
    for point in points:
        assert abs(Truss().slope(point.unknowns[0], point.parameter)) < 1e-11


def test_a_strut_buckles_at_its_critical_force_onto_the_buckled_branches():
    straight = follow(Strut(), equilibrium(Strut(), np.zeros(1), 1.0), (0.9, 2.5))
    (critical,) = [point for point in straight if point.kind is not Kind.regular]
    assert critical.kind is Kind.branch
    assert critical.parameter == pytest.approx(2.0, abs=1e-5)
    assert {point.unstable for point in straight if point.parameter > 2.01} == {1}
    branches = switched(Strut(), critical, 0.1)
    assert sorted(branch.unknowns[0] for branch in branches) == pytest.approx([-0.1, 0.1])
    for branch in branches:
        buckled = follow(Strut(), branch, (1.9, 2.5))
        assert buckled[-1].parameter > 2.5
        for point in buckled:
            angle = point.unknowns[0]
            assert point.parameter == pytest.approx(2 * angle / np.sin(angle), abs=1e-10)
            assert not point.unstable


class Rotated(Analytic):
    """Pitchfork at y = 0.3 on the branch x = 0, y = t, in rotated axes, with two idle unknowns."""

    axes = np.linalg.qr(np.random.default_rng(1).normal(size=(4, 4)))[0]
    neutral = lift = np.zeros((4, 0))

    def energy(self, u, t):
        x, y, *idle = self.axes.T @ u
        return (0.3 - y) * x**2 / 2 + x**4 / 4 + 2 * (y - t) ** 2 + np.sum(np.square(idle))

    def force(self, u, t):
        x, y, *idle = self.axes.T @ u
        slopes = [(0.3 - y) * x + x**3, -(x**2) / 2 + 4 * (y - t), *(2 * each for each in idle)]
        return self.axes @ slopes

    def stiffness(self, u, t):
        x, y, *_ = self.axes.T @ u
        own = np.diag([0.3 - y + 3 * x**2, 4.0, 2.0, 2.0])
        own[0, 1] = own[1, 0] = -x
        return sp.csc_array(self.axes @ own @ self.axes.T)

    def force_by_parameter(self, u, t):
        return self.axes @ [0.0, -4.0, 0.0, 0.0]


def test_the_other_branch_of_a_pitchfork_is_reached_in_any_axes():
    start = equilibrium(Rotated(), np.zeros(4), 0.0)
    points = follow(Rotated(), start, (-0.1, 0.5))
    (critical,) = [point for point in points if point.kind is not Kind.regular]
    assert (critical.kind, critical.parameter) == (Kind.branch, pytest.approx(0.3, abs=1e-5))
    across = [(Rotated.axes.T @ point.unknowns)[0] for point in switched(Rotated(), critical, 0.01)]
    assert sorted(across) == pytest.approx([-0.01, 0.01], abs=1e-4)


def test_the_lowest_eigenvalues_are_found_far_below_those_near_zero():
    class Diagonal(Rotated):
        neutral = lift = np.zeros((400, 0))
        values = np.concatenate([[-0.5, -5e-3], np.linspace(1e-4, 1e-3, 20), np.full(378, 12.0)])

        def stiffness(self, u, t):
            return sp.csc_array(sp.diags_array(self.values))

    values, _ = lowest_eigenvalues(Diagonal(), Diagonal().stiffness(np.zeros(400), 0.0))
    np.testing.assert_allclose(values, np.sort(Diagonal.values)[: len(values)], rtol=1e-8)
