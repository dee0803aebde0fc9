"""Loads other than a pull along the wales: symmetries, work, closed forms, and each other."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize

from knitlab.model.energy import COMPLETE, Point, energy
from knitlab.model.fabric import Configuration
from knitlab.model.layout import fabric_layout
from knitlab.model.network import network
from knitlab.model.settings import PlainKnit
from knitlab.model.stripe_numbers import StripePair
from knitlab.observables.unit_cells import strains_in_direction
from knitlab.solvers.equilibrium.stiffness import free_stiffness
from knitlab.solvers.equilibrium.tensile_test import stretch
from knitlab.solvers.loads import WARP
from knitlab.solvers.loads.biaxial import Biaxial
from knitlab.solvers.loads.biaxial_weft import BiaxialWeft
from knitlab.solvers.loads.loading import free_under, held_under, loading_of
from knitlab.solvers.loads.off_axis import OffAxis
from knitlab.solvers.loads.shear import Shear
from knitlab.solvers.loads.weft import Weft
from tests.fabrics import (
    CLAMPED,
    FINE,
    PERIODIC,
    SHEET,
    assemble_fabric,
    checkered,
    equations,
    patch_map,
    relaxed,
    shaken,
    stripe,
    whole_element_hessians,
)

STRAINS = [0.0, 0.02, 0.04]
WEFT, SHEAR = Weft(), Shear()
BOTH, TURNED = Biaxial(ratio=0.5), BiaxialWeft(ratio=0.5)
OBLIQUE = OffAxis(angle=35.0)


def pulled(net, fabric, load, strains=STRAINS):
    test = stretch(equations(net, fabric), strains, FINE, load=load)
    assert all(state.converged for state in test.states)
    return test


def forces(test):
    return np.array([test.loading.reaction_force(state.gradient) for state in test.states])


def lengths(test):
    return np.array([state.configuration.lengths for state in test.states])


@pytest.mark.slow
@pytest.mark.parametrize(("angle", "along"), [(90.0, WARP), (0.0, WEFT)])
def test_pulls_off_axis_along_an_axis_are_those_along_it(angle, along):
    net, fabric = checkered(4, 1, PERIODIC)
    oblique, straight = (pulled(net, fabric, load) for load in (OffAxis(angle=angle), along))
    np.testing.assert_allclose(lengths(oblique)[:, :2], lengths(straight), rtol=1e-8)
    # The fabric is symmetric: it does not shear, although it may.
    np.testing.assert_allclose(lengths(oblique)[:, 2], 0, atol=1e-7)
    np.testing.assert_allclose(forces(oblique), forces(straight), atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("options", [PERIODIC, CLAMPED])
@pytest.mark.parametrize(
    ("load", "turned"), [(WARP, WEFT), (WEFT, WARP), (BOTH, TURNED), (TURNED, BOTH)]
)
def test_a_design_turned_by_a_quarter_swaps_the_axes(options, load, turned):
    """Courses become wales: rows and columns of patches, and the stripes, are exchanged."""
    rib, garter = (StripePair.of([stripe(*each)], [stripe(*each)]) for each in STRIPES)
    one = fabric_layout(patch_map(["GR", "RG"], 1), SHEET, options)
    other = fabric_layout(patch_map(["RG", "GR"], 1), SHEET, options)
    fabric = one.fabric(StripePair(rib.weft, garter.weft))
    quarter = other.fabric(StripePair(garter.weft, rib.weft))
    test, swapped = pulled(one.net, fabric, load), pulled(other.net, quarter, turned)
    np.testing.assert_allclose(forces(swapped), forces(test), atol=1e-7)
    if load.pulls_across:
        across = [
            [
                each.loading.force_along(1 - each.loading.load.axis, at.gradient)
                for at in each.states
            ]
            for each in (test, swapped)
        ]
        np.testing.assert_allclose(*across, atol=1e-7)
    energies = [[float(state.energy.total) for state in each.states] for each in (test, swapped)]
    np.testing.assert_allclose(*energies, rtol=1e-7)


STRIPES = (("rib", 4), ("garter", 8))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "load"),
    [
        (PERIODIC, SHEAR),
        (PERIODIC, OBLIQUE),
        (PERIODIC, BOTH),
        (PERIODIC, TURNED),
        (CLAMPED, WEFT),
        (CLAMPED, SHEAR),
        (CLAMPED, BOTH),
        (CLAMPED, TURNED),
    ],
)
def test_the_energy_grows_by_the_work_of_the_force(options, load):
    """By Gauss–Legendre quadrature of the force between two strains."""
    net, fabric = checkered(4, 1, options)
    points, weights = np.polynomial.legendre.leggauss(3)
    ends = 0.01, 0.03
    inner = ends[0] + (points + 1) / 2 * (ends[1] - ends[0])
    test = pulled(net, fabric, load, [0.0, ends[0], *inner, ends[1]])
    stored = [float(state.energy.total) for state in test.states]
    work = test.loading.length * (forces(test)[2:-1] @ weights) * (ends[1] - ends[0]) / 2
    assert stored[-1] - stored[1] == pytest.approx(work, rel=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("options", [PERIODIC, CLAMPED])
def test_a_biaxial_load_holds_what_a_pull_leaves_free(options):
    """At the ratio to which a pull contracts or widens fabric, it takes no force across."""
    net, fabric = checkered(4, 1, options)
    if options is CLAMPED:
        test = pulled(net, fabric, Biaxial(ratio=0.0))
        across = [test.loading.force_along(0, state.gradient) for state in test.states]
        # A widening fabric pushes against clamps that keep its width.
        assert across[-1] < across[0] - 1e-4
        return
    warp = pulled(net, fabric, WARP, STRAINS[:2])
    width, length = lengths(warp)[-1] / lengths(warp)[0] - 1
    test = pulled(net, fabric, Biaxial(ratio=width / length), STRAINS[:2])
    np.testing.assert_allclose(test.loading.force_along(0, test.states[-1].gradient), 0, atol=1e-8)
    along = test.loading.force_along(1, test.states[-1].gradient)
    assert along == pytest.approx(forces(warp)[-1], rel=1e-8)


@pytest.mark.parametrize("load", [OBLIQUE, SHEAR, OffAxis(angle=120.0)])
def test_plain_knit_strains_as_the_homogeneous_sheet_of_its_springs(load):
    """It stays flat, so that its energy is a function of the deformation gradient of one cell."""
    plain = PlainKnit(0.4, 0.7, 0.02, 0.03)
    rib, garter = (stripe(*each) for each in STRIPES)
    net, fabric = assemble_fabric(patch_map(["P"], 1), rib, garter, SHEET, PERIODIC, plain)
    strain = 0.08
    test = pulled(net, fabric, load, [0.0, strain])
    a, b = float(fabric.cell_x[0]), float(fabric.cell_y[0])
    sides = {"weft": [(a, 0.0)], "warp": [(0.0, b)], "diagonal": [(a, b), (a, -b)]}
    k = np.asarray(fabric.stretch_stiffness)
    stiffness = {"weft": k[net.weft][0], "warp": k[net.warp][0], "diagonal": k[-1]}
    alpha = np.deg2rad(load.angle_of_pull)
    turn = np.array([[np.sin(alpha), -np.cos(alpha)], [np.cos(alpha), np.sin(alpha)]])

    def stored(across, along, shear):
        gradient = np.array([[across, shear], [0.0, along]]) @ turn
        return sum(
            0.5 * stiffness[kind] * (np.linalg.norm(gradient @ side) - np.hypot(*side)) ** 2
            for kind, those in sides.items()
            for side in those
        )

    def at(strain):
        """The least energy of a cell at a strain, over what the load leaves free."""
        if load.kind == "shear":
            return minimize(lambda q: stored(q[0], q[1], strain), (1, 1), tol=1e-13).fun
        return minimize(lambda q: stored(q[0], 1 + strain, q[1]), (1, 0), tol=1e-13).fun

    cells = net.shape.cells_x * net.shape.cells_y
    assert float(test.states[-1].energy.total) == pytest.approx(cells * at(strain), rel=1e-6)
    step = 1e-3
    slope = cells * (at(strain + step) - at(strain - step)) / (2 * step)
    assert forces(test)[-1] * test.loading.length == pytest.approx(slope, rel=1e-5)


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.parametrize("load", [SHEAR, OBLIQUE])
def test_the_stiffness_of_a_lattice_that_shears_is_that_of_automatic_differentiation(load):
    net, fabric = checkered(4, 1, PERIODIC)
    loading = loading_of(net.shape, relaxed(net, fabric).configuration, load)
    net = network(loading.shape)
    free = free_stiffness(loading.shape, np.arange(loading.shape.unknowns))
    at = shaken(Configuration.of(loading.reference, loading.shape), 0.05).flattened()
    lower = free.lower(free.entries(whole_element_hessians(net, fabric, COMPLETE, at))).toarray()
    exact = jax.hessian(lambda q: energy(net, fabric, Configuration.of(q, net.shape)).total)(at)
    np.testing.assert_allclose(lower, np.tril(exact), atol=1e-9)
    of_chunks = equations(net, fabric).evaluate(Point(np.asarray(at)))
    slopes = jax.grad(lambda q: energy(net, fabric, Configuration.of(q, net.shape)).total)(at)
    np.testing.assert_allclose(of_chunks.gradient, slopes, atol=1e-9)


@pytest.mark.parametrize("load", [WARP, WEFT, SHEAR, BOTH, TURNED])
@pytest.mark.parametrize("options", [PERIODIC, CLAMPED])
def test_every_unknown_is_either_free_or_held(options, load):
    shape = checkered(4, 1, options)[0].shape
    if options is PERIODIC and load.shears:
        shape = replace(shape, frame=((1.0, 0.0), (0.0, 1.0)))
    free, held = free_under(shape, load), held_under(shape, load)
    assert sorted([*free, *held]) == list(range(shape.unknowns))


ANGLES = st.floats(0, 180)


@given(ANGLES, ANGLES, st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2))
def test_strains_in_a_direction_do_not_depend_on_a_rotation(angle, turned, x, y, shear):
    gradient = np.array([[1 + x, shear], [0.1 * shear, 1 + y]])[None, None]
    cos, sin = np.cos(turned), np.sin(turned)
    rotation = np.array([[cos, -sin], [sin, cos]])
    across, along = strains_in_direction(gradient, angle)
    for one, other in zip(
        strains_in_direction(rotation @ gradient, angle), (across, along), strict=True
    ):
        np.testing.assert_allclose(one, other, atol=1e-12)
    # The area changes by det F.
    np.testing.assert_allclose((1 + across) * (1 + along), np.linalg.det(gradient[0, 0]))


@pytest.mark.slow
def test_fabric_that_is_not_its_mirror_image_relaxes_with_a_sheared_lattice():
    """At rest neither the shear nor any other freedom of the lattice has a force left."""
    net, fabric = checkered(8, 4, PERIODIC)
    test = pulled(net, fabric, OffAxis(angle=45.0), [0.0, 1e-4])
    assert np.abs(test.states[0].gradient).max() < 1e-7
    assert not test.states[1].snapped
    slope = forces(test)[1] / 1e-4
    assert 0 < slope < 10, "the force begins at zero"
