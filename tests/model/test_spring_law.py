"""Spring laws: against closed forms, automatic differentiation, and the linear law as limit."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knitlab.model.energy import SPRING_ENTRIES, spring_energy, spring_stiffness
from knitlab.model.spring_curve import SpringCurve
from knitlab.model.spring_law import LINEAR, SpringLaw
from knitlab.model.zigzag import stripe_law
from tests.fabrics import PERIODIC, SHEET, assemble_fabric, checkerboard, stripe

CURVE = SpringCurve((0.0, 0.05, 0.1, 0.2, 0.4), (0.0, 1.0, 2.5, 9.0, 40.0))
BOTH_WAYS = SpringCurve((-0.5, -0.1, 0.0, 0.1, 0.3), (-2.0, -1.0, 0.0, 1.0, 7.0))
LAWS = {
    "linear": LINEAR,
    "stiffening": SpringLaw(jnp.array(1 / 0.2**2)),
    "tabulated": SpringLaw(jnp.array(0.0), jnp.array([1.0]), (CURVE,)),
    "both ways": SpringLaw(jnp.array(0.0), jnp.array([1.0]), (BOTH_WAYS,)),
    "mixed": SpringLaw(jnp.array(3.0), jnp.array([0.0, 0.0]), (CURVE, BOTH_WAYS)),
}
EVERY_LAW = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
REST, STIFFNESS = jnp.array(0.7), 3.0
FORCE, SLOPE = (
    jax.jit(lambda law, *at, name=name: getattr(law, name)(*at)) for name in ("pull", "slope")
)


def at(strains):
    return REST * (1 + jnp.asarray(strains, float))


def test_at_the_stiffening_strain_the_force_is_twice_the_linear_one():
    law = LAWS["stiffening"]
    for strain in (-0.2, 0.2):
        stretch, length = float(REST) * strain, at(strain)
        assert float(law.pull(length, REST)) == pytest.approx(2 * stretch, rel=1e-12)
        assert float(law.slope(length, REST)) == pytest.approx(4, rel=1e-12)
        assert float(law.stored(length, REST)) == pytest.approx(0.75 * stretch**2, rel=1e-12)


@EVERY_LAW
def test_force_and_slope_are_derivatives_of_the_energy(law):
    lengths = at(np.linspace(-0.8, 1.0, 37) + 1e-3)
    stored, pull = (lambda at, of=of: of(at, REST) for of in (law.stored, law.pull))
    np.testing.assert_allclose(jax.vmap(jax.grad(stored))(lengths), law.pull(lengths, REST))
    np.testing.assert_allclose(jax.vmap(jax.grad(pull))(lengths), law.slope(lengths, REST))
    step = 1e-6
    differences = (stored(lengths + step) - stored(lengths - step)) / (2 * step)
    np.testing.assert_allclose(differences, law.pull(lengths, REST), rtol=1e-6, atol=1e-9)
    assert float(stored(at(0.0))) == pytest.approx(0, abs=1e-15)
    assert float(pull(at(0.0))) == pytest.approx(0, abs=1e-15)
    assert float(law.slope(at(0.0), REST)) == pytest.approx(1, rel=1e-12)


@EVERY_LAW
def test_the_closed_stiffness_is_that_of_automatic_differentiation(law):
    random = np.random.default_rng(0)
    vectors = random.normal(size=(1, 3, 40)) * 0.5
    numbers = jnp.full(40, REST), jnp.full(40, STIFFNESS)
    each = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (40, *leaf.shape)), law)
    hessian = jax.jit(jax.vmap(jax.hessian(spring_energy), (-1, 0, 0, 0)))
    exact = hessian(jnp.asarray(vectors), *numbers, each)[:, 0, :, 0]
    found = jax.jit(spring_stiffness)(vectors[0], *numbers, each)
    np.testing.assert_allclose(found, exact[:, *SPRING_ENTRIES].T, rtol=1e-9, atol=1e-10)


@EVERY_LAW
def test_force_and_slope_have_no_jump(law):
    knots = np.array([*CURVE.strain, *BOTH_WAYS.strain, *(-np.array(CURVE.strain))])
    sides = [at(knots + shift) for shift in (-1e-9, 1e-9)]
    for of, limit in ((FORCE, 1e-7), (SLOPE, 1e-5)):
        before, after = (np.asarray(of(law, side, REST)) for side in sides)
        np.testing.assert_allclose(before, after, rtol=limit, atol=limit)


@pytest.mark.slow
def test_a_table_from_rest_is_continued_as_an_odd_function_and_linearly():
    law = LAWS["tabulated"]
    strain = jnp.linspace(0.01, 2, 50)
    pulled, pushed = (law.pull(REST * (1 + sign * strain), REST) for sign in (1, -1))
    np.testing.assert_allclose(pulled, -pushed, rtol=1e-12)
    last = CURVE.force[-1] - CURVE.force[-2]
    chord = last / (CURVE.strain[-1] - CURVE.strain[-2]) / (CURVE.force[1] / CURVE.strain[1])
    assert float(law.slope(at(5.0), REST)) == pytest.approx(chord, rel=1e-12)
    for strain_at, force in zip(CURVE.strain, CURVE.force, strict=True):
        expected = float(REST) * force / (CURVE.force[1] / CURVE.strain[1])
        assert float(law.pull(at(strain_at), REST)) == pytest.approx(expected, abs=1e-14)


def increasing(least):
    steps = st.lists(st.floats(0.01, 2.0), min_size=least, max_size=6)
    return steps.map(lambda found: tuple(np.concatenate([[0.0], np.cumsum(found)]).tolist()))


@pytest.mark.slow
@given(strain=increasing(1), slope=st.floats(1e-3, 1e3))
def test_a_straight_table_is_the_linear_law(strain, slope):
    curve = SpringCurve(strain, tuple(slope * at for at in strain))
    spline, where = curve.spline, np.linspace(-3, 20, 60)
    np.testing.assert_allclose(spline(where), where, rtol=1e-9, atol=1e-9)
    law = SpringLaw(jnp.array(0.0), jnp.array([1.0]), (curve,))
    length = jnp.linspace(0.1, 3, 7)
    np.testing.assert_allclose(law.pull(length, REST), length - REST, atol=1e-9)
    np.testing.assert_allclose(law.stored(length, REST), 0.5 * (length - REST) ** 2, atol=1e-9)


@given(strain=increasing(6), force=increasing(6))
def test_the_spline_of_any_growing_table_grows(strain, force):
    size = min(len(strain), len(force))
    spline = SpringCurve(strain[:size], force[:size]).spline
    where = np.linspace(-1.5 * strain[size - 1], 1.5 * strain[size - 1], 400)
    assert (np.diff(spline(where)) > 0).all()
    np.testing.assert_allclose(spline(-where), -spline(where), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    ("strain", "force", "named"),
    [
        ((0.0, 0.1), (0.0,), ["2 strains", "1 forces"]),
        ((0.0,), (0.0,), ["two"]),
        ((0.0, np.nan), (0.0, 1.0), ["finite"]),
        ((0.0, 0.2, 0.1), (0.0, 1.0, 1.0), ["strain", "0.2 to 0.1", "force", "1 to 1"]),
        ((0.1, 0.2), (0.0, 1.0), ["0, 0"]),
        ((0.0, 0.2), (0.5, 1.0), ["0, 0"]),
        ((-1.0, 0.0, 1.0), (-1.0, 0.0, 1.0), ["-1"]),
        ((-0.5, 0.0), (-1.0, 0.0), ["tension"]),
    ],
)
def test_an_invalid_spring_curve_is_refused(strain, force, named):
    with pytest.raises(ValueError, match=r"give|remove") as refused:
        SpringCurve(strain, force)
    assert all(part in str(refused.value) for part in named)


@pytest.mark.slow
def test_each_spring_has_the_law_of_its_stripe_and_diagonals_that_of_the_softer():
    rib = replace(stripe("rib", 4), spring_curve=CURVE)
    garter = replace(stripe("garter", 8), stiffening_strain=0.1)
    assert rib.k_s < garter.k_s
    for weft, warp, of_diagonal in ((rib, garter, rib), (replace(rib, k_s=9.0), garter, garter)):
        net, fabric = assemble_fabric(checkerboard(1), weft, warp, SHEET, PERIODIC)
        length = 1.2 * fabric.rest_length
        found = fabric.spring_law.pull(length, fabric.rest_length)
        diagonal = ~(net.weft | net.warp)
        for springs, its in ((net.weft, weft), (net.warp, warp), (diagonal, of_diagonal)):
            law = stripe_law(its.stiffening_strain, its.spring_curve)
            strain_only = partial(law.pull, rest_length=fabric.rest_length[springs])
            np.testing.assert_allclose(found[springs], strain_only(length[springs]), rtol=1e-12)


def test_a_stripe_has_one_law():
    with pytest.raises(ValueError, match="rib 4"):
        replace(stripe("rib", 4), stiffening_strain=0.1, spring_curve=CURVE)
