"""Fields: closed forms on sheets of known shape, and what the case file of a kept one holds."""

from dataclasses import replace

import numpy as np
import pytest

from knitlab.export.meshes.fabric import (
    APPLIED_STRAIN,
    ELECTRODE,
    FOLD_ANGLE,
    HEIGHT,
    KNIT,
    PATCH,
    PLATED,
    closed_nodes,
    fabric_meshes,
)
from knitlab.model.electrodes import ElectrodeLayout
from tests.export.meshes.synthetic import flat_test, kept_case, kept_file, sample
from tests.fabrics import PARAMETERS
from tests.refusals import refused

CAPACITOR = PARAMETERS.capacitor


def grid(mesh, field, rows):
    return mesh.face_fields[field].reshape(rows, -1)


def test_nodes_and_heights_are_those_of_the_case_file():
    mesh = fabric_meshes(kept_file(), [5])[0]
    position = kept_file()["position"].sel(applied_strain=0.15).values
    assert (mesh.nodes.reshape(17, 17, 3)[:16, :16] == position).all()
    assert (mesh.node_fields[HEIGHT] == mesh.nodes[:, 2]).all()
    assert set(mesh.node_fields[APPLIED_STRAIN].tolist()) == {0.15}


@pytest.mark.parametrize("repeats", [(1, 1), (2, 3)])
def test_repeats_are_welded_and_closed_by_images(repeats):
    mesh = fabric_meshes(kept_file(), [3], repeats)[0]
    rows, columns = 16 * repeats[0], 16 * repeats[1]
    assert len(mesh.nodes) == (rows + 1) * (columns + 1)
    assert len(mesh.faces) == rows * columns
    assert len(np.unique(mesh.nodes.round(6), axis=0)) == len(mesh.nodes), "two nodes in one place"
    assert len(mesh.rim()[0]) == 2 * (rows + columns), "a seam is open"
    state = kept_file().isel(applied_strain=3)
    nodes = mesh.nodes.reshape(rows + 1, columns + 1, 3)
    folds = mesh.node_fields[FOLD_ANGLE].reshape(rows + 1, columns + 1)
    for axis, length, count in ((1, "length_x", repeats[1]), (0, "length_y", repeats[0])):
        shift = np.zeros(3)
        shift[1 - axis] = count * float(state[length])
        first, last = nodes.take(0, axis), nodes.take(-1, axis)
        np.testing.assert_allclose(last, first + shift, rtol=0, atol=1e-12)
        assert (folds.take(-1, axis) == folds.take(0, axis)).all()


def test_knit_and_patch_are_those_of_the_pattern():
    mesh = fabric_meshes(kept_file(), [0], (2, 1))[0]
    knit, patch = grid(mesh, KNIT, 32), grid(mesh, PATCH, 32)
    # Rows ["GR", "RG"] from the top; patches of 8 × 8 grid cells, counted from below.
    assert KNIT == "knit (0 rib, 1 garter, 2 plain)"
    assert (knit[:8, :8] == 0).all()
    assert (knit[:8, 8:] == 1).all()
    assert (knit[8:16, :8] == 1).all()
    assert (knit[16:] == knit[:16]).all()
    assert (patch == np.kron(np.arange(8).reshape(4, 2), np.ones((8, 8)))).all()


def test_a_stretched_sheet_has_the_stretch_it_is_given():
    relaxed, stretched = fabric_meshes(flat_test(kept_case(), stretch=(0.9, 1.2)), [0, 1])
    for name, value in (("stretch_weft [1]", -0.1), ("stretch_warp [1]", 0.2)):
        np.testing.assert_allclose(relaxed.face_fields[name], 0, atol=1e-12)
        np.testing.assert_allclose(stretched.face_fields[name], value, rtol=1e-12)
    assert not stretched.node_fields[HEIGHT].any()
    np.testing.assert_allclose(stretched.node_fields[FOLD_ANGLE], 0, atol=1e-12)


def test_strains_of_unit_cells_are_those_of_the_case_file():
    test = flat_test(sample(kept_case()))
    mesh = fabric_meshes(test, [1])[0]
    for name in ("strain_xx", "strain_yy"):
        in_cells = grid(mesh, f"{name} [1]", 16).reshape(1, 16, 2, 16)
        assert (in_cells == test[name].values[1][:, None, :, None]).all()


def folded_lines(case, sense):
    """A test of a flat fabric, folded by an angle along every second grid line of its wales."""
    test = flat_test(case)
    height = 0.1 * np.where(np.arange(test.sizes["node_x"]) % 4 == 2, sense, 0.0)
    test["position"].loc[{"component": "z"}] = np.broadcast_to(height, test["position"].shape[:-1])
    return test


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize("periodic", [True, False])
def test_fold_angles_are_at_fold_lines_alone_and_positive_for_a_mountain(periodic, sense):
    case = kept_case() if periodic else sample(kept_case())
    folds = fabric_meshes(folded_lines(case, sense), [0])[0].node_fields[FOLD_ANGLE].reshape(17, -1)
    # A rib patch folds at lines 2, 4 and 6 of its 8 cells; at 2 and 6 the sheet has a ridge.
    ridge = sense * 2 * np.arctan(0.1 / (case.flat_cell[0] / 16))
    rib = folds[1:8, :9]
    np.testing.assert_allclose(rib[:, [2, 6]], ridge, rtol=1e-9)
    np.testing.assert_allclose(rib[:, [0, 1, 3, 4, 5, 7, 8]], 0, atol=1e-9)
    # Garter folds turn about the courses, along which this sheet is straight.
    np.testing.assert_allclose(folds[1:8, 9:16], 0, atol=1e-9)


def with_electrodes(layout):
    return replace(kept_case(), capacitor=replace(CAPACITOR, layout=layout))


@pytest.mark.parametrize(
    ("layout", "covered", "part"),
    [
        # Ridges at lines 2 and 6; a stripe is 2 grid cells, of 2 wales each.
        (ElectrodeLayout(), ([1, 2], [5, 6]), 1.0),
        (ElectrodeLayout(width=1.0), ([1, 2], [5, 6]), 0.25),
        (ElectrodeLayout(width=6.0), ([0, 1, 2, 3], None), (0.5, 1.0, 1.0, 0.5)),
    ],
)
def test_electrodes_cover_the_cells_about_their_ridges(layout, covered, part):
    if covered[1] is None:
        # Apart by more than the width: in the first and in the second rib patch.
        layout = replace(layout, within="fabric", ridges=(1, 3))
        covered = covered[0], [8, 9, 10, 11]
    mesh = fabric_meshes(flat_test(with_electrodes(layout)), [0], (1, 2))[0]
    electrode, plated = grid(mesh, ELECTRODE, 16), grid(mesh, PLATED, 16)
    assert (electrode[:, 16:] == electrode[:, :16]).all()
    for number, columns in enumerate(covered, start=1):
        assert sorted({*np.nonzero(electrode[:, :16] == number)[1].tolist()}) == columns
        np.testing.assert_allclose(plated[:, columns], np.broadcast_to(part, (16, len(columns))))
    assert np.count_nonzero(electrode) == np.count_nonzero(plated)


def test_an_electrode_over_the_seam_goes_on_at_the_other_side():
    case = with_electrodes(ElectrodeLayout(mask=tuple(["BB......A......." for _ in range(16)])))
    electrode = grid(fabric_meshes(flat_test(case), [0])[0], ELECTRODE, 16)
    assert sorted({*np.nonzero(electrode == 2)[1].tolist()}) == [0, 1]
    assert sorted({*np.nonzero(electrode == 1)[1].tolist()}) == [8]


def test_a_fabric_without_electrodes_has_no_field_of_them():
    assert not {ELECTRODE, PLATED} & set(fabric_meshes(kept_file(), [0])[0].face_fields)


def test_a_sample_between_clamps_keeps_its_own_nodes():
    test = flat_test(sample(kept_case()))
    assert (closed_nodes(test) == test["position"].values).all()


@pytest.mark.parametrize(
    ("periodic", "repeats", "words"),
    [
        (True, (0, 1), ["repeats 0 1", "1 or more"]),
        (True, (1.5, 1), ["repeats 1.5 1", "whole numbers"]),
        (True, (900, 900), ["207,360,000", "1,000,000"]),
        (False, (2, 1), ["sample", "give 1 1"]),
    ],
)
def test_repeats_that_do_not_fit_are_refused(periodic, repeats, words):
    case = kept_case() if periodic else sample(kept_case())
    with refused(*words):
        fabric_meshes(flat_test(case), [0], repeats)
