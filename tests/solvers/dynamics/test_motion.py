"""Motion in time: against closed forms, a dense matrix, its balance of energy and Tsit5."""

from dataclasses import replace
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from knitlab.model.energy import energy
from knitlab.model.fabric import Configuration, Fabric, flat_sheet
from knitlab.model.network import MeshShape, network
from knitlab.model.settings import ModelOptions
from knitlab.solvers.dynamics import motion
from knitlab.solvers.dynamics.damped_test import configuration_of, driven, moved_mass, on_grid
from knitlab.solvers.dynamics.grid import GridFabric, Shape
from knitlab.solvers.dynamics.motion import Body, Motion, Moving, advance
from knitlab.solvers.dynamics.settings import Dynamics
from knitlab.solvers.loads import WARP
from knitlab.solvers.loads.biaxial import Biaxial
from knitlab.solvers.loads.loading import loading_of
from knitlab.solvers.loads.shear import Shear
from knitlab.solvers.loads.weft import Weft
from tests.fabrics import CLAMPED, PERIODIC, moving, shaken

SETTINGS = Dynamics(damping_ratio=0.015, release=0.0)
PRECISE = replace(SETTINGS, integrator="tsit5", relative_tolerance=1e-10, absolute_tolerance=1e-13)
RATE = 0.05  # of the applied strain [1/ms]
STIFFNESS, MASS, LENGTH, PULL = 2.0, 1e-3, 1.0, 1e-3
HIGHEST = 1500.0
"""Highest frequency of relaxed (4, 16), about [1/ms]."""
BOUNDARIES = pytest.mark.parametrize("options", [CLAMPED, PERIODIC], ids=["clamped", "periodic"])


def one_spring(damping, inverse_mass, z_max=6.0, k_wall=100.0):
    """A single cell whose first weft spring alone has a stiffness: from node 0, 0 to node 0, 1."""
    none = jnp.zeros(0)
    fabric = Fabric(
        rest_length=jnp.full(6, LENGTH),
        stretch_stiffness=jnp.zeros(6).at[0].set(STIFFNESS),
        rest_fold=none,
        fold_stiffness=none,
        z_max=jnp.array(z_max),
        k_wall=jnp.array(k_wall),
        cell_x=jnp.full(1, LENGTH),
        cell_y=jnp.full(1, LENGTH),
        fold_angle="whole_normals",
    )
    grid = GridFabric.of(MeshShape(1, 1, periodic=False), fabric)
    inverse = Shape((jnp.asarray(inverse_mass),) * 3, jnp.zeros(2))
    return Body(grid, inverse, jnp.asarray(damping), jnp.full(2, 2.0))


def at_rest(fabrics, clamped=False, amplitude=0.0):
    """A batch at rest, as flat sheets or shaken ones."""
    sheets = [flat_sheet(network(fabrics.shape), fabric) for fabric in fabrics.fabrics]
    shapes = [on_grid(shaken(sheet, amplitude) if amplitude else sheet) for sheet in sheets]
    return Moving.from_rest(fabrics.bodies(clamped), shapes)


def pulled(batch, shape, rate, load=WARP):
    """A batch strained by a load, at a rate of the applied strain [1/ms]."""
    loadings = [
        loading_of(shape, configuration_of(batch.motion.shape, case), load)
        for case in range(len(batch.time))
    ]
    return driven(batch, loadings, np.full(len(loadings), rate))


def balance(batch):
    """What the balance of energy keeps constant [N mm]."""
    seen, work = batch.seen, batch.motion
    return np.asarray(seen.kinetic + seen.energy.total + work.dissipated - work.supplied)


def positions(batch, case=0):
    return np.stack([np.asarray(part[case]) for part in batch.motion.shape.positions], axis=-1)


@pytest.mark.parametrize("damping", [0.0, 0.01])
@pytest.mark.parametrize("integrator", ["leapfrog", "tsit5"])
def test_two_nodes_on_a_spring_vibrate_at_their_damped_frequency(damping, integrator):
    body = one_spring(damping, np.full((2, 2), 1 / MASS))
    x = jnp.array([[0.0, LENGTH + PULL], [0.0, LENGTH]])
    y = jnp.array([[0.0, 0.0], [LENGTH, LENGTH]])
    start = Shape((x, y, jnp.zeros((2, 2))), jnp.zeros(2))
    decay = damping / (2 * MASS)
    frequency = np.sqrt(2 * STIFFNESS / MASS - decay**2)
    times = np.linspace(0, 1, 31)[1:]
    assert frequency * times[-1] > 60

    def largest_error(settings):
        batch, errors = Moving.from_rest([body], [start]), []
        for time in times:
            batch = advance(batch, np.array([time]), settings)
            swing = np.cos(frequency * time) + decay / frequency * np.sin(frequency * time)
            (x,) = np.asarray(batch.motion.shape.positions[0])
            stretch = x[0, 1] - x[0, 0] - LENGTH
            errors.append(abs(stretch - PULL * np.exp(-decay * time) * swing))
        assert batch.time == times[-1]
        return max(errors)

    if integrator == "tsit5":
        assert largest_error(PRECISE) < 1e-5 * PULL
        return
    # The leapfrog is late by (frequency × step)² / 24, where this is twice the step_safety.
    errors = [largest_error(replace(SETTINGS, step_safety=safety)) for safety in (0.02, 0.01)]
    assert errors[0] < 1.2 * PULL * frequency * (2 * 0.02) ** 2 / 24
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.1)


def test_a_node_that_presses_on_a_wall_rests_at_force_over_stiffness_beyond_it():
    below, gap, wall = 0.5, 0.2, 1e4
    inverse = np.zeros((2, 2))
    inverse[0, 1] = 1 / MASS
    body = one_spring(0.01, inverse, z_max=gap, k_wall=wall)
    start = Shape(
        (
            jnp.array([[0.0, 0.0], [0.0, LENGTH]]),
            jnp.array([[0.0, 0.0], [LENGTH, LENGTH]]),
            jnp.array([[-below, 0.0], [0.0, 0.0]]),
        ),
        jnp.zeros(2),
    )
    settings = replace(SETTINGS, rest_force=1e-9)
    batch = advance(Moving.from_rest([body], [start]), np.array([1e3]), settings, to_rest=True)
    height = float(batch.motion.shape.positions[2][0, 0, 1])
    force = STIFFNESS * (LENGTH - below - height)
    assert batch.resting.all()
    assert force > 0.5
    assert height - gap == pytest.approx(force / wall, rel=1e-6)
    # The step is that of the spring, though the wall is stiffer by far.
    steps_of_the_wall = float(batch.time[0]) * np.sqrt(wall / MASS) / 2
    assert batch.steps[0] < steps_of_the_wall / 10


@pytest.mark.slow
@BOUNDARIES
@pytest.mark.parametrize("clamped", [False, True], ids=["free", "held"])
def test_the_highest_frequency_is_that_of_the_dense_matrix(options, clamped):
    fabrics = moving([(4, 1)], options, SETTINGS)
    shape, (fabric,), (inertia,) = fabrics.shape, fabrics.fabrics, fabrics.inertias
    net = network(shape)
    at = shaken(flat_sheet(net, fabric), 0.05)
    hessian = jax.jit(jax.hessian(lambda q: energy(net, fabric, Configuration.of(q, shape)).total))
    mass = np.asarray(moved_mass(shape, inertia).flattened())
    free = np.ones(shape.unknowns, bool)
    if shape.periodic:
        free[-1] = not clamped
    else:
        free[-2:] = False
        held = np.zeros((shape.nodes_y, shape.nodes_x, 3), bool)
        held[[0, -1]] = clamped
        free[:-2] &= ~held.ravel()
    stiffness = np.asarray(hessian(jnp.asarray(at.flattened())))[np.ix_(free, free)]
    weights = np.sqrt(mass[free])
    highest = np.sqrt(np.linalg.eigvalsh(stiffness / np.outer(weights, weights))[-1])

    (body,) = fabrics.bodies(clamped)
    start = Motion.at_rest(on_grid(at))
    batch = Moving.from_rest([body], [on_grid(at)])
    mode = jax.tree.map(lambda leaf: leaf[0], batch.mode)
    square, _ = jax.jit(motion.highest_frequency)(
        body, start, mode, jnp.asarray(motion.FIRST_ITERATIONS)
    )
    assert 0.9 * highest < float(np.sqrt(square)) < highest * (1 + 1e-6)
    np.testing.assert_allclose(motion.largest_step(batch), 2 / highest, rtol=1e-5)


WEFT, BIAXIAL, SHEAR = Weft(), Biaxial(ratio=0.5), Shear()
PULLS = [
    *((options, load) for options in (CLAMPED, PERIODIC) for load in (WARP, WEFT, BIAXIAL)),
    (CLAMPED, SHEAR),
]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "load", "rate"),
    [(CLAMPED, WARP, 0.0), (PERIODIC, WARP, 0.0), *((*each, RATE) for each in PULLS)],
)
def test_energy_is_balanced_to_the_square_of_the_step(options, load, rate):
    def largest_error(safety):
        settings = replace(SETTINGS, step_safety=safety)
        fabrics = moving([(8, 1)], options, settings, load=load)
        batch = pulled(at_rest(fabrics, clamped=rate > 0), fabrics.shape, rate, load)
        first = balance(batch)[0]
        errors = []
        for time in np.linspace(0, 2, 21)[1:]:
            batch = advance(batch, np.array([time]), settings)
            errors.append(abs(balance(batch)[0] - first))
            assert batch.seen.energy.wall[0] == 0
        assert (batch.motion.supplied[0] > 0.01 * first) == (rate > 0)
        assert batch.motion.dissipated[0] > 0.01 * first
        return max(errors) / first

    errors = [largest_error(safety) for safety in (0.4, 0.2, 0.1)]
    assert errors[0] < 0.02
    for one, other in pairwise(errors):
        assert 3 < one / other < 5.5, errors


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "rate"), [(CLAMPED, RATE), (PERIODIC, 0.0)], ids=["clamped-pulled", "periodic"]
)
def test_leapfrog_and_tsit5_go_the_same_way(options, rate):
    ends = []
    for settings in (PRECISE, *(replace(SETTINGS, step_safety=part) for part in (0.1, 0.05))):
        fabrics = moving([(8, 1)], options, settings)
        batch = pulled(at_rest(fabrics, clamped=rate > 0), fabrics.shape, rate)
        batch = advance(batch, np.array([1.0]), settings)
        ends.append(np.append(positions(batch).ravel(), batch.motion.shape.lengths[0]))
    errors = [np.abs(end - ends[0]).max() for end in ends[1:]]
    moved = np.abs(positions(batch) - positions(at_rest(moving([(8, 1)], options, settings)))).max()
    assert moved > 0.1
    assert errors[1] < 1e-3
    assert 3 < errors[0] / errors[1] < 5.5, errors


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "integrator"),
    [
        pytest.param(CLAMPED, "leapfrog", id="leapfrog"),
        pytest.param(PERIODIC, "tsit5", id="tsit5", marks=pytest.mark.nightly),
    ],
)
def test_a_motion_does_not_depend_on_its_batch(options, integrator):
    settings = replace(SETTINGS, integrator=integrator)
    ratios, times = [0.015, 0.1, 0.05], np.array([0.4, 1.3, 0.9])

    def ends(places):
        chosen = [ratios[place] for place in places]
        fabrics = moving([(8, 1)] * len(places), options, settings, damping_ratios=chosen)
        batch = at_rest(fabrics)
        for part in (0.5, 1.0):
            batch = advance(batch, part * times[places], settings)
        return batch

    together = ends([0, 1, 2])
    for place in range(3):
        alone = ends([place])
        assert alone.steps[0] == together.steps[place]
        np.testing.assert_allclose(positions(alone), positions(together, place), atol=1e-9)


@pytest.fixture
def misjudged(monkeypatch):
    """Makes the dynamics take the highest frequency for a number of times lower than it is."""

    def misjudge(times, halvings):
        true = motion._highest_frequencies

        def found(*given):
            square, mode = true(*given)
            return square / times**2, mode

        monkeypatch.setattr(motion, "_highest_frequencies", found)
        monkeypatch.setattr(motion, "HALVINGS", halvings)

    return misjudge


def test_a_step_that_is_too_long_is_halved(misjudged):
    fabrics = moving([(8, 1)], PERIODIC, SETTINGS)
    expected = advance(at_rest(fabrics), np.array([1.0]), SETTINGS)
    misjudged(16, motion.HALVINGS)
    found = advance(at_rest(fabrics), np.array([1.0]), SETTINGS)
    assert not found.diverged.any()
    assert found.time == expected.time == 1.0
    assert np.abs(balance(found) - balance(at_rest(fabrics))) < 0.05 * found.largest


def test_a_step_that_may_not_be_halved_ends_a_motion_where_it_was_last_seen(misjudged):
    fabrics = moving([(8, 1)], PERIODIC, SETTINGS)
    misjudged(100, 0)
    start = at_rest(fabrics)
    found = advance(start, np.array([1.0]), SETTINGS)
    assert found.diverged.all()
    assert found.time == 0
    np.testing.assert_array_equal(positions(found), positions(start))


@pytest.mark.slow
@pytest.mark.nightly
def test_cells_that_are_crushed_for_a_moment_end_no_motion_and_slow_none_down():
    """With little damping cells are crushed to lines, about which hinges are very stiff."""
    flat = ModelOptions(boundary="periodic")
    fabrics = moving([(4, 2)] * 3, flat, SETTINGS, damping_ratios=[0.003, 0.005, 0.007])
    batch = at_rest(fabrics)
    for time in np.geomspace(0.01, 3, 25):
        batch = advance(batch, np.full(3, time), SETTINGS)
    assert not batch.diverged.any()
    usual = 3 / (SETTINGS.step_safety * 2 / HIGHEST)
    assert (batch.steps < 3 * usual).all()
