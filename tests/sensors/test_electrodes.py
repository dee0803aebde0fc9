"""Matrices and cross-talk of electrodes on a fabric: its one capacitor, signs, sums, symmetry."""

import json
from dataclasses import replace

import numpy as np
import pytest

import knitlab as kl
from knitlab.observables.capacitance.boundary_elements import VACUUM_PERMITTIVITY
from knitlab.solvers.case import case_of
from tests.refusals import refused
from tests.sensors.test_selectivity import ONE, SENSOR, small_test

PAIR = ["w1", "w2"]


@pytest.mark.slow
def test_two_electrodes_have_the_capacitance_of_the_sensor():
    found = kl.capacitance_matrix(SENSOR, PAIR, applied_strain=[0, 0.1], **ONE)
    assert -found["capacitance"].sel(electrode="w1", to="w2").values == pytest.approx(
        kl.open_cube(SENSOR).sel(ONE)["capacitance"].sel(applied_strain=[0, 0.1]).values, rel=1e-4
    )


def check_matrix(matrix, open_to_ground):
    """Of Maxwell's: symmetric, off its diagonal negative, sums of rows at least zero."""
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-9 * matrix.max())
    assert (np.diag(matrix) > 0).all()
    assert (matrix - np.diag(np.diag(matrix)) <= 0).all()
    if open_to_ground:
        assert (matrix.sum(axis=1) > 0).all()
    else:
        np.testing.assert_allclose(matrix.sum(axis=1), 0, atol=1e-9 * matrix.max())


@pytest.mark.slow
@pytest.mark.nightly
def test_a_plane_or_cloth_that_polarises_adds_charge():
    in_air = kl.capacitance_matrix(small_test())["capacitance"].values[0]
    check_matrix(in_air, open_to_ground=False)
    over_plane = kl.capacitance_matrix(small_test(ground="plane"))["capacitance"].values[0]
    check_matrix(over_plane, open_to_ground=True)
    damp = [
        kl.capacitance_matrix(small_test(), cloth_permittivity=value, cloth_thickness=0.1)
        for value in (1.001, 2.0)
    ]
    thin, thick = (each["capacitance"].values[0] for each in damp)
    check_matrix(thick, open_to_ground=False)
    np.testing.assert_allclose(thin, in_air, rtol=2e-3)
    assert (np.diag(thick) > np.diag(in_air)).all()


@pytest.mark.slow
@pytest.mark.nightly
def test_connected_electrodes_have_the_sum_of_their_charges():
    whole = kl.capacitance_matrix(SENSOR, **ONE)["capacitance"].squeeze().values
    joined = kl.capacitance_matrix(SENSOR, ["w1", "w2+w3", "w4"], **ONE)["capacitance"].squeeze()
    together = np.array([[1, 0, 0, 0], [0, 1, 1, 0], [0, 0, 0, 1]])
    np.testing.assert_allclose(joined, together @ whole @ together.T, rtol=1e-6)


@pytest.mark.slow
def test_cross_talk_of_alike_sensors_is_mutual():
    found = kl.cross_talk(SENSOR, [("w1", "w2"), ("w3", "w4")], **ONE)
    assert found["reading"].values == pytest.approx([found["reading"].values[0]] * 2, rel=1e-3)
    for name in ("gauge_factor", "strain", "coupling"):
        np.testing.assert_allclose(found[name], found[name].T, rtol=1e-3)
    guarded = kl.cross_talk(SENSOR, [("w1", "w2"), ("w3", "w4")], others="grounded", **ONE)
    assert (guarded["reading"] < found["reading"]).all()


@pytest.mark.slow
@pytest.mark.nightly
def test_a_part_as_wide_as_the_cell_is_pulled_as_in_a_test():
    # Ends of the whole cell are pulled, and its sides are free.
    ends = ("0:1/0:8", "7:8/0:8")
    found = kl.cross_talk(small_test("weft"), [("w1", "w2"), ends], others="grounded")
    both = kl.capacitance_matrix(
        small_test("weft"), ["w1", "w2", *ends], applied_strain=[0, 0.002]
    )["capacitance"]
    low, high = np.log(-both.sel(electrode="w1", to="w2").values)
    assert found["gauge_factor"][0, 1] == pytest.approx((high - low) / 0.002, rel=0.01)


@pytest.mark.slow
@pytest.mark.nightly
def test_cloth_that_polarises_has_bare_electrodes():
    insulated = small_test(dielectric_thickness=0.1, strains=(0.0,))
    with refused("cloth_permittivity", "dielectric_thickness"):
        kl.capacitance_matrix(insulated, cloth_permittivity=2.0)


def of_grid(insulation):
    """A sample whose two columns of electrodes cross two rows, and its sensors."""
    layout = kl.ElectrodeLayout(within="fabric", face="both", width=1.0)
    capacitor = replace(kl.defaults().capacitor, layout=layout, dielectric_thickness=insulation)
    test = kl.simulate(kl.Design(4, 8, unit_cells=(1, 1)), [0], capacitor=capacitor)
    return test, [(f"w{column}", f"c{row}") for column in (1, 2) for row in (1, 2)]


@pytest.mark.slow
@pytest.mark.nightly
def test_rows_cross_columns_of_a_sample_with_an_insulation():
    thick, thin = (kl.cross_talk(*of_grid(d), others="grounded") for d in (0.1, 0.05))
    case = case_of(json.loads(of_grid(0.1)[0].attrs["parameters"]))
    fabric, (courses, wales) = case.assemble()[1], case.stitches_per_cell
    area = fabric.cell_x[2] / wales[2] * fabric.cell_y[2] / courses[2]
    # A thinner insulation adds that of a plate capacitor, and some at its edges.
    added = (thin["reading"] - thick["reading"]) / (VACUUM_PERMITTIVITY * area * (1 / 0.05 - 10))
    assert (added > 1).all()
    assert (added < 1.3).all()
    # The sample has a turn by half a turn as its symmetry.
    np.testing.assert_allclose(thin["cross_talk"], thin["cross_talk"][::-1, ::-1], atol=0.01)
    with refused("touch", "dielectric_thickness"):
        kl.cross_talk(*of_grid(0.0))


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["w1"], ["electrodes", "w1", "two"]),
        (["w1", "w9"], ["w9", "2 ridges"]),
        (["w1", "q"], ["'q'", "w1", "0:2/4:8"]),
        (["w1", "4:2/0:8"], ["4:2/0:8", "0:2/4:8"]),
        (["w1", "c1"], ["boundary = clamped"]),
        (["w1", "0:8/0:8"], ["w1", "0:8/0:8", "touch"]),
        (["w1", "7:8/0:4"], ["7:8/0:4", "boundary"]),
    ],
)
def test_impossible_electrodes_are_refused(names, words):
    with refused(*words):
        kl.capacitance_matrix(small_test(), names)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"pull": "up"}, ["pull", "'up'", "weft", "warp"]),
        ({"others": "open"}, ["others", "'open'", "floating", "grounded"]),
        ({"cloth_permittivity": 0.5}, ["cloth_permittivity", "0.5"]),
        ({"cloth_permittivity": 2.0, "cloth_thickness": 0.0}, ["cloth_thickness", "0"]),
        ({"applied_strain": 0.002}, ["applied_strain"]),
    ],
)
def test_invalid_cross_talk_is_refused(given, words):
    with refused(*words):
        kl.cross_talk(small_test(), [("w1", "w2")], **given)
