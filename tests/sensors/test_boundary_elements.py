import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.special import ellipk, ellipkm1, zeta

from knitlab.observables.capacitance.boundary_elements import (
    VACUUM_PERMITTIVITY,
    Images,
    maxwell_matrices,
    near_pairs,
    two_terminal,
)
from tests.sensors.conductors import (
    PAIRS_A_PANEL,
    bent,
    between,
    by_series,
    crowded,
    cube,
    disc,
    extrapolated,
    filled,
    maxwell,
    moved,
    plate,
    sphere,
    strips,
    wire,
)

SEED = st.integers(0, 10_000)
OF_A_SPHERE = 4 * np.pi * VACUUM_PERMITTIVITY
LENGTH = 4.0
"""Period of periodic conductors [mm]."""
ALIKE = 1e-9


def three_conductors():
    """A plate, a cube and a sphere near each other."""
    conductors = (
        plate([-1.5, -1, 1.2], [3, 0, 0.4], [0, 2, 0], crowded(6), crowded(4)),
        cube(crowded(4), 1.3),
        sphere(2, 0.6) + np.array([1.6, 0.3, -0.2]),
    )
    askew = Rotation.from_euler("xyz", [0.3, 0.5, 0.7])
    return tuple(bent(moved(panels, askew, 0)) for panels in conductors)


def periodic_pair(length=LENGTH):
    return [bent(panels) for panels in strips(hinged(1.0), 12, length)]


def two_spheres(count, distance, radius=1.0):
    return sphere(count), sphere(count, radius) + np.array([distance, 0, 0])


def square_plates(count, distance):
    lower = plate([0, 0, 0], [1, 0, 0], [0, 1, 0], crowded(count), crowded(count))
    return lower, lower + np.array([0, 0, distance])


def hinged(angle, near=1.0, far=5.0):
    """Ends of two strips that lie in planes at an angle to each other."""
    x, z = np.cos(angle / 2), np.sin(angle / 2)
    return [[(r * x, side * r * z) for r in (near, far)] for side in (1, -1)]


def coplanar(gap, width):
    """Ends of two strips side by side."""
    return [[(side * gap / 2, 0), (side * (gap / 2 + width), 0)] for side in (-1, 1)]


def of_strips(ends, count, length=LENGTH):
    return between(*strips(ends, count, length), period=length)


def limit_of_strips(ends, length=LENGTH):
    return extrapolated(*(of_strips(ends, count, length) for count in (12, 24)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shape", "counts", "exact"),
    [
        (lambda count: sphere(count, 2.0), (4, 8), 2 * OF_A_SPHERE),
        (lambda count: disc(count, 2.0), (8, 16), 16 * VACUUM_PERMITTIVITY),
        # Hwang and Mascagni, J. Appl. Phys. 95, 3798 (2004).
        (lambda count: cube(crowded(count), 2.0), (4, 8), 0.66067815 * 2 * OF_A_SPHERE),
    ],
    ids=["sphere", "disc", "cube"],
)
def test_a_conductor_alone_has_its_known_capacitance(shape, counts, exact):
    found = [maxwell(shape(count))[0, 0] for count in counts]
    assert extrapolated(*found) == pytest.approx(exact, rel=5e-4)


@pytest.mark.slow
@pytest.mark.parametrize("distance", [2.5, 3.0, 6.0])
def test_two_spheres_have_the_series_of_their_mirror_charges(distance):
    angle, number = np.arccosh(distance / 2), np.arange(1, 100)
    own = (OF_A_SPHERE * np.sinh(angle) / np.sinh((2 * number - 1) * angle)).sum()
    mutual = -(OF_A_SPHERE * np.sinh(angle) / np.sinh(2 * number * angle)).sum()
    found = extrapolated(*(maxwell(*two_spheres(count, distance)) for count in (3, 6)))
    assert np.allclose(found, [[own, mutual], [mutual, own]], rtol=3e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("gap", "width"), [(1.0, 2.0), (0.2, 2.0), (3.0, 1.0)])
def test_coplanar_strips_have_their_closed_form(gap, width):
    k = gap / (gap + 2 * width)
    exact = VACUUM_PERMITTIVITY * LENGTH * ellipkm1(k**2) / ellipk(k**2)
    assert limit_of_strips(coplanar(gap, width)) == pytest.approx(exact, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("distance", [2.5, 4.0])
def test_parallel_wires_have_their_closed_form(distance):
    found = [
        between(*(wire(at, 1.0, count, LENGTH, count // 3) for at in (0, distance)), period=LENGTH)
        for count in (12, 24)
    ]
    exact = np.pi * VACUUM_PERMITTIVITY * LENGTH / np.arccosh(distance / 2)
    assert extrapolated(*found) == pytest.approx(exact, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    "ends",
    [
        hinged(2.0),
        hinged(1.0),
        hinged(0.25),
        [[(0, 0), (2, 0)], [(1.5, 0.5), (3.5, 1)]],
        [[(0, 0), (2, 0)], [(-1, 1), (1, 1.5)]],
    ],
    ids=["wide hinge", "hinge", "tight hinge", "overlapping", "tilted"],
)
def test_periodic_strips_agree_with_a_series(ends):
    assert limit_of_strips(ends) == pytest.approx(LENGTH * by_series(*ends), rel=2e-3)


@pytest.mark.slow
def test_periodic_conductors_may_run_along_either_axis():
    pair = periodic_pair()
    turned = [panels[..., [1, 0, 2]] for panels in pair]
    found = two_terminal(maxwell(*turned, period=LENGTH, axis=0))
    assert found == pytest.approx(between(*pair, period=LENGTH), rel=ALIKE)


@pytest.mark.slow
def test_a_periodic_pair_equals_a_long_one():
    ends = coplanar(0.5, 1.0)

    def long_pair(length):
        pair = [
            plate(
                [start[0], 0, 0], [end[0] - start[0], 0, 0], [0, length, 0], crowded(8), crowded(32)
            )
            for start, end in ends
        ]
        return between(*pair)

    periodic = by_series(*ends)
    assert long_pair(32.0) / 32 == pytest.approx(periodic, rel=0.03)
    # The contribution of the ends is the same for both.
    assert (long_pair(32.0) - long_pair(16.0)) / 16 == pytest.approx(periodic, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("distance", [0.1, 0.5, 2.0])
def test_square_plates_agree_with_fastcap(distance):
    fastcap2 = pytest.importorskip("fastcap2")

    def by_fastcap(count):
        problem = fastcap2.Problem()
        problem.expansion_order, problem.iter_tol = 4, 1e-6
        for name, panels in zip("AB", square_plates(count, distance), strict=True):
            surface = fastcap2.Surface(name)
            for panel in panels.tolist():
                surface.add_quad(*map(tuple, panel))
            problem.add(surface)
        # FastCap uses metres and farads.
        return 1e9 * two_terminal(np.array(problem.solve()))

    computed = extrapolated(*(between(*square_plates(count, distance)) for count in (8, 16)))
    reference = extrapolated(*(by_fastcap(count) for count in (16, 32)))
    assert computed == pytest.approx(reference, rel=3e-3)


@pytest.mark.slow
def test_a_matrix_is_that_of_conductors():
    matrix = maxwell(*three_conductors())
    assert np.allclose(matrix, matrix.T, rtol=1e-13)
    assert (matrix[~np.eye(3, dtype=bool)] < 0).all()
    assert (matrix.sum(axis=1) > 0).all()
    assert (np.linalg.eigvalsh(matrix) > 0).all()


def test_a_conductor_within_another_is_shielded():
    matrix = maxwell(sphere(2), sphere(4, 2.0), sphere(2) + np.array([4.0, 0, 0]))
    assert abs(matrix[0, 2]) < 3e-3 * matrix[2, 2]
    assert matrix[0, 1] == pytest.approx(-matrix[0, 0], rel=3e-3)
    assert -matrix[1, 2] > 0.2 * matrix[2, 2]


@given(SEED)
@settings(max_examples=5)
def test_a_rigid_motion_changes_nothing(seed):
    conductors = three_conductors()
    turn, shift = Rotation.random(rng=seed), 10 * np.random.default_rng(seed).normal(size=3)
    found = maxwell(*(moved(each, turn, shift) for each in conductors))
    assert np.allclose(found, maxwell(*conductors), rtol=ALIKE)


@pytest.mark.parametrize("cut", [1.0, 2.0, 3.0])
def test_where_a_period_begins_does_not_matter(cut):
    pair = periodic_pair()
    elsewhere = [panels.copy() for panels in pair]
    for panels in elsewhere:
        panels[panels[..., 1].mean(axis=-1) < cut, :, 1] += LENGTH
    found = between(*elsewhere, period=LENGTH)
    assert found == pytest.approx(between(*pair, period=LENGTH), rel=ALIKE)


def order(coarse, middle, fine):
    return np.log2((middle - coarse) / (fine - middle))


@pytest.mark.slow
def test_graded_panels_converge_by_the_second_order():
    found = [maxwell(disc(count))[0, 0] for count in (4, 8, 16)]
    assert 1.8 < order(*found) < 2.2
    error = 1 - np.array(found) / (8 * VACUUM_PERMITTIVITY)
    assert (np.log2(error[:-1] / error[1:]) > 1.8).all()


@pytest.mark.slow
@pytest.mark.parametrize("chosen", ["turned", "all"])
def test_the_result_hardly_depends_on_which_pairs_are_near(chosen):
    panels = disc(8)[None]
    count = panels.shape[1]
    near = near_pairs(panels)
    pairs = near[:, ::-1] if chosen == "turned" else np.argwhere(np.triu(np.ones((count, count))))
    found = maxwell_matrices(panels, np.ones((count, 1)), filled(pairs, PAIRS_A_PANEL * count))
    assert float(found[0, 0, 0]) == pytest.approx(maxwell(disc(8))[0, 0], rel=2e-3)


def test_every_near_pair_occurs_once_with_the_larger_panel_second():
    panels = np.concatenate(three_conductors())[None]
    pairs = near_pairs(panels)
    size = np.linalg.norm(panels[0] - np.roll(panels[0], 2, axis=1), axis=-1).max(axis=1)
    centre = panels[0].mean(axis=1)
    apart = np.linalg.norm(centre[:, None] - centre, axis=-1)
    near = np.triu(apart <= 2 * np.maximum(size[:, None], size))
    alone = np.unique(pairs, axis=0)
    assert (size[pairs[:, 0]] <= size[pairs[:, 1]]).all()
    assert np.array_equal(np.unique(np.sort(alone, axis=1), axis=0), np.argwhere(near))
    assert (pairs[len(alone) :] == pairs[len(alone) - 1]).all()


@pytest.mark.slow
def test_periodic_states_of_a_batch_equal_single_states():
    periods = np.array([4.0, 3.0, 5.0, 2.0, 4.5])
    alone = [strips(hinged(period / 4), 12, period) for period in periods]
    together = [np.stack(states) for states in zip(*alone, strict=True)]
    expected = [between(*pair, period=p) for pair, p in zip(alone, periods, strict=True)]
    assert np.allclose(between(*together, period=periods), expected, rtol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("length", [2.0, 8.0])
def test_the_number_of_images_does_not_matter(length):
    pair = periodic_pair(length)

    def with_images(count, beyond):
        return two_terminal(maxwell(*pair, period=length, images=Images(count, beyond, axis=1)))

    # So many images that further ones are negligible.
    exact = with_images(jnp.asarray(2000), jnp.zeros(2))
    for count in (8, 12, 40):
        beyond = jnp.array([zeta(3, count + 1), zeta(5, count + 1)])
        assert with_images(jnp.asarray(count), beyond) == pytest.approx(exact, rel=1e-4)
    assert between(*pair, period=length) == pytest.approx(exact, rel=1e-3)


def test_a_shift_of_all_potentials_leaves_the_capacitance_between_two():
    matrix = maxwell(*two_spheres(3, 2.5, 0.5))
    for shift in (-0.5, 3.0, 1e3):
        shifted = np.linalg.inv(np.linalg.inv(matrix) + shift)
        assert two_terminal(shifted) == pytest.approx(two_terminal(matrix), rel=1e-9)


@pytest.mark.parametrize("shift", [0.0, 0.1], ids=["the same", "overlapping"])
def test_panels_inside_each_other_have_no_capacitance(shift):
    face, _ = square_plates(8, 1.0)
    assert np.isnan(maxwell(face, face + np.array([shift, shift, 0]))).all()
