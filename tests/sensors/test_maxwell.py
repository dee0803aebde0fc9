"""Matrices of several conductors against closed forms: wires, images, strips on a film."""

import numpy as np
import pytest
from scipy.special import ellipk

from knitlab.observables.capacitance.boundary_elements import VACUUM_PERMITTIVITY
from knitlab.observables.capacitance.maxwell import Surroundings
from knitlab.sensors.readings import electrode_matrices
from tests.sensors.conductors import crowded, evenly, extrapolated, plate, strips, wire

LENGTH = 2.0


def matrix(*conductors, bare=(), **around):
    panels = np.concatenate([*conductors, *bare])
    sizes = [len(each) for each in (*conductors, *bare)]
    number = np.repeat(np.minimum(np.arange(len(sizes)), len(conductors)), sizes)
    states = {
        name: np.array([value]) if name in ("period", "ground") else value
        for name, value in around.items()
    }
    return electrode_matrices(panels[None], number, len(conductors), Surroundings(**states))[0]


def wires(centres, sides, radius=0.3):
    return [wire(0, radius, sides, LENGTH, sides // 3) + np.array([x, 0, z]) for x, z in centres]


@pytest.mark.slow
def test_three_wires_have_the_matrix_of_their_line_charges():
    # Thin wires far apart: potentials of line charges, of which the sum is zero.
    centres, radius = np.array([[0.0, 0.0], [9.0, 1.0], [-3.0, 14.0]]), 0.3
    apart = np.linalg.norm(centres[:, None] - centres[None], axis=-1) + radius * np.eye(3)
    inverse = np.linalg.inv(-np.log(apart / 100) / (2 * np.pi * VACUUM_PERMITTIVITY))
    rows = inverse.sum(axis=1)
    wanted = LENGTH * (inverse - np.outer(rows, rows) / rows.sum())
    found = extrapolated(*(matrix(*wires(centres, n), axis=1, period=LENGTH) for n in (9, 18)))
    np.testing.assert_allclose(found, wanted, atol=2e-3 * wanted.max())
    np.testing.assert_allclose(found.sum(axis=1), 0, atol=1e-12)


@pytest.mark.slow
def test_two_wires_over_a_plane_have_the_matrix_of_their_images():
    radius, height, apart = 0.3, 5.0, 6.0
    own = np.log(2 * height / radius)
    mutual = np.log(np.hypot(2 * height, apart) / apart)
    wanted = 2 * np.pi * VACUUM_PERMITTIVITY * np.linalg.inv([[own, mutual], [mutual, own]])
    found = extrapolated(
        *(
            matrix(*wires([(0, 0), (apart, 0)], n, radius), axis=1, period=LENGTH, ground=-height)
            for n in (9, 18)
        )
    )
    np.testing.assert_allclose(found, LENGTH * wanted, atol=4e-3 * wanted.max())
    assert (found.sum(axis=1) > 0).all()


def of_film(polarised, count):
    """Two strips of one plane, side by side, on a film that is polarised."""
    gap, width = 2.0, 3.0
    ends = [[(side * gap / 2, 0), (side * (gap / 2 + width), 0)] for side in (-1, 1)]
    film = plate([-1, 0, 0], [gap, 0, 0], [0, LENGTH, 0], crowded(count), evenly(count // 3))
    conductors = strips(ends, count, LENGTH)
    around = {"axis": 1, "period": LENGTH, "polarised": polarised}
    return -matrix(*conductors, bare=[film] * (polarised > 0), **around)[0, 1] / LENGTH


@pytest.mark.slow
@pytest.mark.nightly
def test_strips_on_a_film_have_their_closed_forms():
    k = 2.0 / 8.0
    in_air = VACUUM_PERMITTIVITY * ellipk(1 - k**2) / ellipk(k**2)
    assert extrapolated(*(of_film(0.0, n) for n in (12, 24))) == pytest.approx(in_air, rel=2e-3)
    # A film that polarises by far more than air conducts as a resistor of its gap.
    strong = 1e4
    assert of_film(strong, 12) == pytest.approx(VACUUM_PERMITTIVITY * strong / 2.0, rel=1e-3)
    some = [of_film(polarised, 12) for polarised in (0.0, 0.1, 0.2, 0.4)]
    added = np.diff(some) / np.diff([0.0, 0.1, 0.2, 0.4])
    # By Thomson's principle C grows, ever less, and by more than the resistor.
    assert (added > VACUUM_PERMITTIVITY / 2.0).all()
    assert (np.diff(added) < 0).all()
