"""Contact in the dynamics: against the IPC Toolkit, minimisation, conservation and equilibria."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq, minimize

import knitlab as kl
from knitlab.model.contact_layers import contact_layers
from knitlab.model.fabric import Configuration, flat_sheet
from knitlab.model.settings import ModelOptions
from knitlab.model.surfaces import self_intersections
from knitlab.solvers.dynamics import damped_test
from knitlab.solvers.dynamics.closest_points import CLOSEST
from knitlab.solvers.dynamics.closest_points import distance as distance_of
from knitlab.solvers.dynamics.contact_cells import Place
from knitlab.solvers.dynamics.contact_forces import force_after
from knitlab.solvers.dynamics.contact_lists import ContactLists, batch_contact
from knitlab.solvers.dynamics.contact_pairs import PairFinder
from knitlab.solvers.dynamics.contact_potential import PairList
from knitlab.solvers.dynamics.damped_test import relax_by_dynamics
from knitlab.solvers.dynamics.grid import Shape
from knitlab.solvers.dynamics.settings import Dynamics
from knitlab.solvers.equilibrium.contact_barrier import Barrier
from tests.fabrics import moving, shaken
from tests.solvers.equilibrium.test_contact_barrier import (
    CELL,
    PRESSURE,
    THICKNESS,
    folded_periodic,
    two_plies,
)

LAYERS = contact_layers(THICKNESS, PRESSURE, (CELL, CELL))
POINTS = st.integers(0, 2**32 - 1).map(lambda seed: np.random.default_rng(seed).normal(size=(4, 3)))
FOLDED = ModelOptions(cell_size="relaxed", boundary="clamped", garter_start="valley")


def found(shape, unknowns):
    """Energy and gradient of contact in the dynamics."""
    finder, place = PairFinder(shape, LAYERS), place_of(unknowns, shape)
    at = Configuration.of(unknowns, shape)
    contact = batch_contact([finder], [finder.listed(place).parts])
    alone = replace(contact, lists=jax.tree.map(lambda leaf: leaf[0], contact.lists))
    nodes = tuple(jnp.asarray(at.positions[..., axis]) for axis in range(3))
    energy, by_nodes, by_lengths = alone.energy_and_gradient(nodes, jnp.asarray(at.lengths))
    return float(energy), np.concatenate([np.stack(by_nodes, axis=-1).ravel(), by_lengths])


def place_of(unknowns, shape):
    at = unknowns if isinstance(unknowns, Configuration) else Configuration.of(unknowns, shape)
    return Place(np.asarray(at.positions).reshape(-1, 3), np.asarray(at.lengths))


def grid_of(place, shape):
    """A place as the dynamics hold it, for a batch of one fabric."""
    at = np.moveaxis(place.positions.reshape(1, shape.nodes_y, shape.nodes_x, 3), -1, 0)
    return Shape(tuple(map(jnp.asarray, at)), jnp.asarray(place.lengths)[None])


def names(parts):
    """Pairs of parts by their corners, images relative to the first, in the order of the list."""
    turns = parts.turns - parts.turns[:, :1]
    corners = np.concatenate([parts.nodes, turns.reshape(8, -1), parts.near[None]])
    return [tuple(each) for each in corners.T.astype(int)]


def examples():
    noise = np.random.default_rng(0)
    for shape, at in (two_plies(1.1 * THICKNESS), two_plies(1.2 * THICKNESS), folded_periodic()):
        unknowns = np.asarray(at.flattened() if isinstance(at, Configuration) else at)
        shaken = unknowns.copy()
        shaken[: 3 * shape.nodes] += noise.normal(size=3 * shape.nodes, scale=0.01 * THICKNESS)
        yield from ((shape, unknowns), (shape, shaken))


@pytest.mark.slow
def test_energy_and_forces_are_those_of_the_ipc_toolkit():
    for shape, unknowns in examples():
        energy, gradient = found(shape, unknowns)
        expected, by_unknowns = Barrier(shape, LAYERS).evaluate(unknowns)
        assert expected > 0
        assert energy == pytest.approx(expected, rel=1e-10)
        np.testing.assert_allclose(gradient, by_unknowns, atol=1e-10 * abs(by_unknowns).max())


@pytest.mark.slow
@settings(max_examples=30)
@given(POINTS, st.sampled_from(list(CLOSEST)))
def test_no_points_of_two_parts_are_closer_than_the_closest(corners, kind):
    first, second = np.split(corners, [1 if kind == "triangle" else 2])

    def apart(parts):
        # Barycentric coordinates of both points, from numbers between 0 and 1.
        def point(part, numbers):
            if len(part) == 1:
                return part[0]
            if len(part) == 2:
                return part[0] + numbers[0] * (part[1] - part[0])
            one, other = numbers[0], numbers[1] * (1 - numbers[0])
            return part[0] + one * (part[1] - part[0]) + other * (part[2] - part[0])

        split = max(len(first) - 1, 0)
        return np.sum((point(first, parts[:split]) - point(second, parts[split:])) ** 2)

    grid = np.linspace(0, 1, 5)
    starts = [(a, b) for a in grid for b in grid]
    best = min(
        minimize(apart, start, bounds=[(0, 1)] * 2, options={"ftol": 1e-15, "gtol": 1e-12}).fun
        for start in starts[::3]
    )
    nearest = float(distance_of(jnp.asarray(corners)[..., None], kind)[0])
    assert nearest == pytest.approx(np.sqrt(best), abs=1e-5)


@given(st.floats(-2, 1.2), st.floats(-3, 1))
def test_the_force_of_a_pair_is_that_at_the_distance_to_which_it_leads(reached, softness):
    layer, softness = LAYERS.far, 10**softness
    reached *= layer.begins
    one = jnp.ones(1)
    pairs = PairList(
        jnp.zeros((4, 1), int),
        jnp.zeros((2, 4, 1), int),
        one * layer.least**2,
        one * layer.range_squared,
        one * layer.strength,
        one,
    )
    force = float(force_after(pairs, one * reached, one * softness)[0])

    def law(at):
        excess = (at**2 - layer.least**2) / layer.range_squared
        slope = (1 - excess) * ((1 - excess) / excess - 2 * np.log(excess))
        return 2 * at * layer.strength * layer.range_squared * slope

    if reached >= layer.begins:
        assert force == 0
        return
    low, high = layer.least * (1 + 1e-13), layer.begins
    exact = brentq(lambda at: at - reached - softness * law(at), low, high, xtol=1e-15)
    assert layer.least < reached + softness * force <= layer.begins * (1 + 1e-12)
    assert force == pytest.approx((exact - reached) / softness, rel=0.7)
    if exact > layer.least + 0.1 * layer.reach:
        assert force == pytest.approx(law(exact), rel=1e-2)


@pytest.mark.slow
@pytest.mark.parametrize("design", [(4, 1), (8, 1)])
def test_samples_come_to_rest_where_equilibria_are(design):
    """From a fold that develops slowly, by dynamics and then by the minimiser."""
    n_stripe, _ = design
    sample = kl.Design(n_stripe, 4 * n_stripe, unit_cells=(1, 1), boundary="clamped")
    dynamics = kl.Dynamics(ending="rest", damping_ratio=0.2, release=0.5, longest_time=2000.0)
    model = kl.Model(contact="barrier")
    sheet = kl.Sheet(z_max=2.0, k_wall=100.0, thickness=0.14, contact_pressure=0.1)
    given = {"model": model, "sheet": sheet, "dynamics": dynamics}
    tests = [
        kl.simulate(sample, [0.0, 0.05], protocol=kl.Protocol(method=method), **given)
        for method in ("dynamics", "equilibrium")
    ]
    for test in tests:
        # A sample at rest is turned for the clamps, which changes forces by 1e-5 N.
        assert (test["residual_force"] < 5e-5).all()
        assert not test["self_intersections"].any()
    one, other = (
        sum(t[f"energy_{part}"] for part in ("stretch", "fold", "wall", "contact")) for t in tests
    )
    np.testing.assert_allclose(one, other, rtol=1e-4)


@pytest.mark.slow
def test_nothing_passes_through_itself_and_no_energy_is_gained():
    """A sample released at once, the most violent motion, and one whose folds develop."""
    for release in (0.0, 0.5):
        fabrics = moving(
            [(4, 1)], FOLDED, Dynamics(ending="steps", relax_steps=1500, release=release)
        )
        finders = [PairFinder(fabrics.shape, contact_layers(0.14, 0.1, (0.94, 1.08)))]
        (relaxed,) = relax_by_dynamics(replace(fabrics, finders=finders))
        history = relaxed.history
        at = Configuration.stacked([relaxed.configuration])
        assert self_intersections(fabrics.shape, at) == [0]
        assert relaxed.outcome.name == "converged"
        assert (np.diff(history.dissipated) > -1e-6).all()
        if not release:
            total = history.kinetic + history.potential + history.dissipated
            np.testing.assert_allclose(total, total[0], rtol=0.02)


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.parametrize(("disturbance", "moves"), [(1e-9, 1e-8), (1e-3, 1e-4)])  # [mm], and of ν
def test_a_disturbed_start_moves_the_test_little(disturbance, moves, monkeypatch):
    """Collisions could set motions apart; with folds that develop they stay near each other."""
    sample = kl.Design(4, 16, unit_cells=(3, 2), boundary="clamped")
    protocol = kl.Protocol(method="dynamics")
    dynamics = kl.Dynamics(ending="steps")

    def ratio():
        test = kl.simulate(sample, [0.0, 0.06, 0.12], protocol=protocol, dynamics=dynamics)
        return test["poisson_ratio"].values[1:]

    usual = ratio()

    def disturbed(*of):
        return shaken(flat_sheet(*of), disturbance)

    monkeypatch.setattr(damped_test, "flat_sheet", disturbed)
    change = abs(ratio() - usual)
    assert 0 < change.max() < moves


def test_pairs_that_come_within_reach_are_listed_until_the_margin_is_used():
    """Whatever touches after a motion is in the list from before it."""
    noise = np.random.default_rng(1)
    checked = 0
    for shape, at in (two_plies(1.3 * THICKNESS), two_plies(1.4 * THICKNESS), folded_periodic()):
        finder, before = PairFinder(shape, LAYERS), place_of(at, shape)
        listed = finder.listed(before)
        for amplitude in np.geomspace(1e-3, 0.1, 12) * THICKNESS:
            moved = noise.normal(size=before.positions.shape, scale=amplitude)
            after = Place(before.positions + moved, before.lengths)
            if finder.used(listed, after) > 1:
                continue
            for kind, now in finder.listed(after).parts.items():
                touching = {name for name, gap in zip(names(now), now.gap, strict=True) if gap <= 0}
                assert touching <= set(names(listed.parts[kind]))
                checked += 0 < len(touching) < len(listed.parts[kind].gap)
    assert checked > 3


def test_pairs_that_touch_in_some_steps_act_or_are_missed():
    """Also if the motion is not the one expected, by which those that act are chosen."""
    noise = np.random.default_rng(2)
    kept = missed = 0
    for shape, at in (two_plies(1.3 * THICKNESS), two_plies(1.4 * THICKNESS), folded_periodic()):
        finder, before = PairFinder(shape, LAYERS), place_of(at, shape)
        lists = ContactLists.at([finder], grid_of(before, shape))
        for amplitude in np.geomspace(1e-3, 0.3, 12) * THICKNESS:
            expected, actual = noise.normal(size=(2, *before.positions.shape), scale=amplitude)
            still = np.zeros(2)
            rate = grid_of(Place(expected, still), shape)
            covering, _ = lists.covering(grid_of(before, shape), rate, np.ones(1), np.ones(1, int))
            after = Place(before.positions + actual, before.lengths)
            _, unseen = covering.missed(grid_of(after, shape))
            missed += int(unseen[0])
            if unseen[0]:
                continue
            for kind, now in finder.listed(after).parts.items():
                acting = covering.contact.lists[kind].nodes[0]
                acting = set(map(tuple, np.asarray(acting).T))
                touching = set(map(tuple, now.nodes[:, now.gap <= 0].T))
                assert touching <= acting
                kept += len(touching) > 0
    assert kept > 3
    assert missed > 3


@pytest.mark.slow
@pytest.mark.nightly
def test_tightly_folded_fabric_comes_to_rest_in_equilibrium():
    """Contact does not hold its sharpest folds out of equilibrium, in steps of full length."""
    sample = kl.Design(4, 32, unit_cells=(1, 1), boundary="clamped")
    dynamics = kl.Dynamics(ending="rest", relax_time=10.0, snapshots=40, rest_force=5e-7)
    relaxed = kl.simulate(sample, [0.0], protocol=kl.Protocol(method="dynamics"), dynamics=dynamics)
    assert relaxed["residual_force"].item() < 5e-6
    # Once the folds have developed, energy is only dissipated.
    late = relaxed["time"] > 5.0
    assert late.sum() > 2
    parts = ("kinetic_energy", "potential_energy", "dissipated_work")
    total = sum(relaxed[part].values[late] for part in parts)
    np.testing.assert_allclose(total, total[-1], rtol=5e-3)


@pytest.mark.slow
@pytest.mark.nightly
def test_pressed_folds_keep_their_distance():
    """Forces pass on from pair to pair: nothing is nearer than the barrier lets it be."""
    sample = kl.Design(4, 32, unit_cells=(2, 1), boundary="clamped")
    dynamics = kl.Dynamics(ending="steps", relax_steps=4000)
    relaxed = kl.simulate(sample, [0.0], protocol=kl.Protocol(method="dynamics"), dynamics=dynamics)
    # The force of a pair below its least distance would be 1e8 times those of the flat sheet.
    assert relaxed["relaxation_force_left"].item() < 0.1
    assert 0 < relaxed["energy_contact"].item() < 1e-3 * relaxed["energy_fold"].item()
    assert relaxed["self_intersections"].item() == 0
