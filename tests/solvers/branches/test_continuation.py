"""Continuation against closed forms: a shallow truss that snaps, a strut that buckles."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from knitlab.solvers.branches.continuation import (
    Kind,
    at_parameter,
    equilibrium,
    follow,
    lowest_eigenvalues,
    switched,
)


@pytest.fixture(autouse=True)
def fine(monkeypatch):
    """Steps and tolerance for energies of the order of 1."""
    for name, value in (("FIRST_STEP", 0.01), ("MAX_STEP", 0.03), ("TOLERANCE", 1e-12)):
        monkeypatch.setattr(f"knitlab.solvers.branches.continuation.{name}", value)


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


class Looped(Rotated):
    """Branch x = 0, y = t, unstable in the loop x² = 0.01 - (y - 0.3)²; two neutral axes."""

    axes = np.linalg.qr(np.random.default_rng(2).normal(size=(5, 5)))[0]
    neutral, lift = axes[:, 2:3], axes[:, 3:4]

    def energy(self, u, t):
        x, y, *_, idle = self.axes.T @ u
        return ((y - 0.3) ** 2 - 0.01) * x**2 / 2 + x**4 / 4 + 2 * (y - t) ** 2 + idle**2

    def force(self, u, t):
        x, y, *_, idle = self.axes.T @ u
        slope = (y - 0.3) * x**2 + 4 * (y - t)
        return self.axes @ [((y - 0.3) ** 2 - 0.01) * x + x**3, slope, 0.0, 0.0, 2 * idle]

    def force_by_parameter(self, u, t):
        return self.axes @ [0.0, -4.0, 0.0, 0.0, 0.0]

    def stiffness(self, u, t):
        x, y, *_ = self.axes.T @ u
        own = np.diag([(y - 0.3) ** 2 - 0.01 + 3 * x**2, x**2 + 4, 0.0, 0.0, 2.0])
        own[0, 1] = own[1, 0] = 2 * (y - 0.3) * x
        return sp.csc_array(self.axes @ own @ self.axes.T)


def test_a_closed_loop_is_followed_once_and_left_at_both_ends_without_a_lift():
    looped = Looped()
    straight = follow(looped, equilibrium(looped, np.zeros(5), 0.0), (-0.1, 0.6))
    ends = [point for point in straight if point.kind is Kind.branch]
    assert [point.parameter for point in ends] == pytest.approx([0.2, 0.4], abs=1e-5)
    loop = follow(looped, switched(looped, ends[0], 0.01)[0], (-0.1, 0.6))
    x, y, *_ = looped.axes.T @ np.transpose([point.unknowns for point in loop])
    np.testing.assert_allclose(x**2 + (y - 0.3) ** 2, 0.01, atol=1e-7)
    assert x.max() > 0.09
    assert x.min() < -0.09
    turned = np.unwrap(np.arctan2(x, y - 0.3))
    assert abs(turned[-1] - turned[0]) == pytest.approx(2 * np.pi, abs=0.3)
    # From the end of the loop onto the straight branch, in both directions.
    at = next(point for point in loop if point.kind is Kind.branch)
    sides = switched(looped, at, 0.01)
    assert sorted(side.parameter > at.parameter for side in sides) == [False, True]
    for side in sides:
        x, y, neutral, lift, _ = looped.axes.T @ side.unknowns
        assert [x, neutral, lift] == pytest.approx([0, 0, 0], abs=1e-4)
        assert y == pytest.approx(side.parameter, abs=1e-6)


def test_the_points_of_a_branch_at_a_parameter_are_on_this_branch():
    """Near the tip of a pitchfork, where interpolation would lead onto the other branch."""
    straight = follow(Rotated(), equilibrium(Rotated(), np.zeros(4), 0.0), (-0.1, 0.5))
    (at,) = [point for point in straight if point.kind is Kind.branch]
    bent = [at, *follow(Rotated(), switched(Rotated(), at, 0.01)[0], (-0.1, 0.5))]
    bent[0] = replace(at, tangent=bent[1].tangent)
    for wanted in (0.3001, 0.302, 0.4):
        ((x, y, *_),) = [
            Rotated.axes.T @ point.unknowns for point in at_parameter(Rotated(), bent, wanted)
        ]
        assert x**2 == pytest.approx(y - 0.3, abs=1e-9)
        assert y - x**2 / 8 == pytest.approx(wanted, abs=1e-9)


def test_the_lowest_eigenvalues_are_found_far_below_those_near_zero():
    class Diagonal(Rotated):
        neutral = lift = np.zeros((400, 0))
        values = np.concatenate([[-0.5, -5e-3], np.linspace(1e-4, 1e-3, 20), np.full(378, 12.0)])

        def stiffness(self, u, t):
            return sp.csc_array(sp.diags_array(self.values))

    values, _ = lowest_eigenvalues(Diagonal(), Diagonal().stiffness(np.zeros(400), 0.0))
    np.testing.assert_allclose(values, np.sort(Diagonal.values)[: len(values)], rtol=1e-8)
