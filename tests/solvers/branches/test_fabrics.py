"""Branches and relaxed shapes of fabrics, against the tensile test and between two methods."""

from dataclasses import replace

import numpy as np
import pytest

import knitlab as kl
from knitlab.api.single_design import single_design
from knitlab.api.stability import _is_known
from knitlab.io.errors import InputError
from knitlab.solvers.branches import shapes as atlas
from knitlab.solvers.branches.continuation import Kind, equilibrium, follow, switched
from knitlab.solvers.branches.equations import FabricEquations
from knitlab.solvers.equilibrium.system import System
from knitlab.solvers.equilibrium.tensile_test import stretch
from knitlab.solvers.loads.loading import loading_of
from tests.fabrics import FINE, PERIODIC, checkered, equations, relaxed, stretched

FOLDED = {
    **{"n_stripe": 4, "n_subunit": 16, "robustness": 0, "contact": "none"},
    **{"cloth_stitch_width": 0, "cloth_stitch_height": 0},  # walls at 6 mm of the network
}
"""A design that leaves its relaxed branch at a branch point at 1.5 %."""


def fabric_equations(n_stripe=4, periods=1):
    net, fabric = checkered(n_stripe, periods, PERIODIC)
    system, shape = equations(net, fabric), relaxed(net, fabric, FINE).configuration
    return net, fabric, FabricEquations(system, loading_of(net.shape, shape))


def test_a_branch_passes_the_states_of_the_tensile_test():
    net, fabric, of_fabric = fabric_equations()
    test = stretched(net, fabric, [0.0, 0.02, 0.04], FINE)
    start = equilibrium(of_fabric, of_fabric.start, 0.0)
    points = follow(of_fabric, start, (-0.01, 0.05))
    assert points[-1].parameter > 0.05
    for state, strain in zip(test.states, (0.0, 0.02, 0.04), strict=True):
        near = min(points, key=lambda point: abs(point.parameter - strain))
        there = equilibrium(of_fabric, near.unknowns, strain)
        assert there.energy == pytest.approx(float(state.energy.total), rel=1e-9)
        gradient = of_fabric.gradient(there.unknowns, strain)
        force = of_fabric.loading.reaction_force(gradient)
        assert force == pytest.approx(test.loading.reaction_force(state.gradient), abs=1e-7)


def test_derivatives_are_those_of_differences():
    _, _, of_fabric = fabric_equations()
    u, t = of_fabric.start, 0.01
    toward = np.random.default_rng(0).normal(size=len(u))
    step = 1e-6
    ahead, behind = (of_fabric.force(u + sign * step * toward, t) for sign in (1, -1))
    np.testing.assert_allclose(
        of_fabric.stiffness(u, t) @ toward, (ahead - behind) / (2 * step), atol=1e-6
    )
    energies = [of_fabric.energy(u + sign * step * toward, t) for sign in (1, -1)]
    slope = (energies[0] - energies[1]) / (2 * step)
    assert of_fabric.force(u, t) @ toward == pytest.approx(slope, abs=1e-6)


@pytest.mark.slow
@pytest.mark.nightly
def test_a_design_leaves_its_relaxed_branch_at_a_branch_point(tmp_path):
    points = kl.branches("periodic", **FOLDED, strain_max=0.15, output=tmp_path / "branches.png")
    assert (tmp_path / "branches.png").is_file()
    first = points.isel(point=(points["branch"] == 1).values)
    (at,) = first["applied_strain"].values[first["kind"].values == "branch"]
    assert at == pytest.approx(0.0151, abs=1e-4)
    # No equilibrium of that branch is beyond; the branch that goes on is stable.
    assert first["applied_strain"].values.max() == pytest.approx(at, abs=1e-4)
    beyond = points.isel(point=(points["applied_strain"] > 0.05).values)
    assert (beyond["unstable"] == 0).all()
    assert beyond["applied_strain"].values.max() > 0.14
    (eigenvalue,) = first["lowest_eigenvalue"].values[first["kind"].values == "branch"]
    assert abs(eigenvalue) < 1e-6


@pytest.mark.slow
@pytest.mark.nightly
def test_the_atlas_counts_every_start_and_bounds_barriers(tmp_path, monkeypatch):
    found = kl.shapes("periodic", **FOLDED, starts=8, output=tmp_path / "shapes.png")
    assert (tmp_path / "shapes.png").is_file()
    assert int(found["starts"].sum()) + found.attrs["not_converged"] == 8
    assert found.sizes["shape"] == 2
    energies, barrier = found["energy"].values, found["barrier"].values
    assert (np.diff(energies) > 0).all()
    assert barrier[0, 1] - barrier[1, 0] == pytest.approx(energies[1] - energies[0])
    assert barrier[1, 0] > 0
    # Another way downhill ends on the same pass, to the accuracy that a bound has.
    monkeypatch.setattr(atlas, "STIFFER", 0.2)
    monkeypatch.setattr(atlas, "DAMPING", 0.3)
    again = kl.shapes("periodic", **FOLDED, starts=8)["barrier"].values
    np.testing.assert_allclose(again, barrier, rtol=0.1)


def test_a_flat_sheet_and_a_rough_one_relax_to_one_shape_of_a_small_design():
    found = kl.shapes("periodic", n_stripe=4, n_subunit=8, starts=2, contact="none")
    assert found["starts"].values.tolist() == [2]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: kl.branches("periodic", n_stripe=4), "n_subunit"),
        (lambda: kl.shapes("periodic", n_stripe=4, n_subunit=16, starts=0), "10,000"),
        (lambda: kl.shapes("periodic", n_stripe=4, n_subunit=16, starts=10**5000), "10,000"),
        (lambda: kl.branches("preview", n_stripe=4, n_subunit=16), "equilibrium"),
        (lambda: kl.branches(output="a.txt"), "suffix"),
    ],
)
def test_bad_input_is_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()


def test_copies_of_a_shape_are_no_branches():
    """A shape that is moved along the sheet or across it is known."""
    _, _, of_fabric = fabric_equations()
    start = equilibrium(of_fabric, of_fabric.start, 0.01)
    branch = follow(of_fabric, start, (-0.01, 0.03))
    motions = np.concatenate([of_fabric.neutral, of_fabric.lift], axis=1)
    for motion in motions.T:
        copy = equilibrium(of_fabric, start.unknowns + 0.3 * motion, 0.015)
        assert np.linalg.norm(copy.unknowns - start.unknowns) > 0.2
        assert _is_known(of_fabric, copy, [branch])
    assert not _is_known(of_fabric, equilibrium(of_fabric, start.unknowns, 0.0), [branch])
    stiffer = replace(start, energy=1.001 * start.energy)
    assert not _is_known(of_fabric, stiffer, [branch])


@pytest.mark.slow
@pytest.mark.nightly
def test_the_loop_at_20_percent_and_both_sides_of_the_first_crossing_are_found():
    """No branch is a copy of another, and the loop has the state that a minimiser finds."""
    points = kl.branches("periodic", **FOLDED, strain_max=0.3).to_dataframe()
    assert points["branch"].nunique() == 6
    first = points.loc[(points["branch"] == 1) & (points["kind"] == "branch"), "applied_strain"]
    second, third = (points.loc[points["branch"] == k, "applied_strain"] for k in (2, 3))
    assert second.max() > 0.3
    assert second.min() > first.iloc[0] > third.max()
    assert third.min() < -0.02
    loop = points[points["branch"] == 4]
    assert loop["applied_strain"].between(0.199, 0.2012).all()
    at = loop.iloc[(loop["applied_strain"] - 0.2).abs().argmin()]
    assert at["unstable"] == 0
    case = single_design("periodic", FOLDED, {}).case
    net, fabric = case.assemble()
    strains = (0.0, 0.02, 0.05, 0.1, 0.15, 0.195, at["applied_strain"])
    test = stretch(System(net.shape, fabric), strains, case.equilibrium_solver)
    assert at["energy"] == pytest.approx(float(test.states[-1].energy.total), rel=1e-8)


def test_no_branch_crosses_at_a_regular_point():
    """The direction across the mode leads back to the branch itself."""
    _, _, of_fabric = fabric_equations()
    start = equilibrium(of_fabric, of_fabric.start, 0.0)
    assert start.kind is Kind.regular
    for point in switched(of_fabric, start, 1e-3):
        there = equilibrium(of_fabric, of_fabric.start, point.parameter)
        assert there.energy == pytest.approx(point.energy, rel=1e-6)
