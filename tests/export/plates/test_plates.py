"""Plates of cases and cubes, their table and cards, and what is refused with a sentence."""

import json
import shutil

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from click.testing import CliRunner

import knitlab as kl
from knitlab.cli import main
from knitlab.cubes.case_file import LENGTH_FACTOR, in_cloth
from knitlab.export.plates.plate_stiffness import case_plates, in_plane, stiffness_matrix
from knitlab.solvers.plate_condensation import PlateStatus
from tests.export.meshes.synthetic import PREVIEW, kept_case, kept_file, sample
from tests.refusals import refused

ONE = {"n_stripe": 4, "n_subunit": 16, "applied_strain": 0.15}
TEXT = ["plate", str(PREVIEW), *(f"--select={name}={value}" for name, value in ONE.items())]


@pytest.fixture(scope="module")
def plates() -> xr.Dataset:
    """Both designs whose shapes are kept, at three strains."""
    return kl.plate_stiffness(PREVIEW, applied_strain=[0.12, 0.15, 0.45])


@pytest.fixture(scope="module")
def state(plates) -> xr.Dataset:
    return plates.sel(ONE)


def test_every_design_with_a_shape_has_its_place(plates):
    sizes = {"n_stripe": 2, "n_subunit": 2, "applied_strain": 3}
    assert plates.sizes == sizes | {"row": 3, "column": 3}
    status = plates["plate_status"].max("applied_strain").values
    assert (status[[0, 1], [1, 0]] == PlateStatus.no_shape).all()
    assert (status[[0, 1], [0, 1]] < PlateStatus.unstable).all()
    assert np.isnan(plates["modulus_x"].sel(n_stripe=4, n_subunit=64)).all()
    assert {plates[name].attrs["units"] for name in plates if "stiffness" in str(name)} == {
        *("N/mm", "N", "N mm")
    }


def test_forces_over_the_width_of_cloth_are_those_of_the_test(plates):
    pulled = plates["membrane_force"].sel(row="yy") * plates["length_x"]
    force = kl.open_cube(PREVIEW)["reaction_force"].sel(pulled.drop_vars("row").coords)
    known = pulled.notnull()
    assert known.sum() == 6
    np.testing.assert_allclose(pulled.where(known, 0), force.where(known, 0), atol=1e-8)


def test_in_cloth_the_network_is_larger_and_its_forces_are_the_same():
    case, chosen = kept_file(), {"applied_strain": 0.15}
    cloth = in_cloth(case, kl.open_cube(PREVIEW).sel(n_stripe=4, n_subunit=16))
    factor = cloth.attrs[LENGTH_FACTOR]
    assert factor == pytest.approx(cloth["length_x"].values[0] / case["length_x"].values[0])
    small, large = case_plates(case, chosen), case_plates(cloth, chosen)
    assert small.attrs["length_unit"] == "mm of network"
    assert large.attrs["length_unit"] == "mm"
    powers = {"membrane_stiffness": -1, "coupling_stiffness": 0, "bending_stiffness": 1}
    powers |= {"membrane_force": -1, "moment": 0, "modulus_y": -1, "length_y": 1}
    for name, power in powers.items():
        np.testing.assert_allclose(large[name], small[name] * factor**power, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.2, np.pi / 2])
def test_the_modulus_along_an_angle_is_that_of_turned_axes(state, angle):
    cosine, sine = np.cos(angle), np.sin(angle)
    # Strain (xx, yy, 2 xy) in the model's axes from that in axes turned by the angle.
    turned = np.array(
        [
            [cosine**2, sine**2, -cosine * sine],
            [sine**2, cosine**2, cosine * sine],
            [2 * cosine * sine, -2 * cosine * sine, cosine**2 - sine**2],
        ]
    )
    membrane = state["membrane_stiffness"].values
    compliance = np.linalg.inv(turned.T @ membrane @ turned)
    modulus, ratio = in_plane(membrane, angle)
    assert modulus == pytest.approx(1 / compliance[0, 0])
    assert ratio == pytest.approx(-compliance[0, 1] / compliance[0, 0])


def test_a_cube_a_test_and_a_condition_give_the_same(state):
    cube = kl.open_cube(PREVIEW)
    where = kl.plate_stiffness(cube, where="n_stripe == 4", applied_strain=0.15)
    test = in_cloth(kept_file(), cube.sel(n_stripe=4, n_subunit=16))
    xr.testing.assert_allclose(where.squeeze()["moment"], state["moment"])
    alone = kl.plate_stiffness(test, applied_strain=0.15).squeeze()
    np.testing.assert_allclose(stiffness_matrix(alone), stiffness_matrix(state), atol=1e-12)


def test_a_card_of_abaqus_has_the_upper_triangle_by_columns(state, tmp_path):
    said = CliRunner().invoke(main, [*TEXT, "-o", str(tmp_path / "card.inp")])
    assert said.exit_code == 0, said.output
    lines = (tmp_path / "card.inp").read_text().splitlines()
    keyword = lines.index("*SHELL GENERAL SECTION, ELSET=KNIT")
    assert all(line.startswith("**") for line in lines[:keyword])
    rows = [[float(entry) for entry in line.split(",")] for line in lines[keyword + 1 :]]
    assert [len(row) for row in rows] == [8, 8, 5]
    matrix = np.zeros((6, 6))
    matrix.T[np.tril_indices(6)] = np.concatenate(rows)
    matrix = matrix + np.triu(matrix, 1).T
    np.testing.assert_allclose(matrix, stiffness_matrix(state), rtol=1e-8, atol=1e-8)
    assert np.linalg.eigvalsh(matrix)[0] > 0


def test_json_and_csv_have_every_number_and_its_unit(plates, tmp_path):
    kl.plate_stiffness(PREVIEW, tmp_path / "card.json", applied_strain=[0.12, 0.15])
    card = json.loads((tmp_path / "card.json").read_text(encoding="utf-8"))
    assert len(card["states"]) == 4
    for each in card["states"]:
        wanted = stiffness_matrix(plates.sel({name: each[name] for name in ONE}))
        np.testing.assert_allclose(each["ABD"], wanted, atol=1e-8)
    kl.plate_stiffness(PREVIEW, tmp_path / "table.csv", applied_strain=[0.12, 0.15, 0.45])
    table = pd.read_csv(tmp_path / "table.csv", dtype=str)
    assert table["status"].tolist() == ["ok"] * 5 + ["negative"]
    row = table[(table["n_stripe"] == "4") & (table["applied_strain"] == "0.15")].iloc[0]
    state = plates.sel(ONE)
    assert float(row["A12 [N/mm]"]) == state["membrane_stiffness"].sel(row="xx", column="yy")
    assert float(row["B61 [N]"]) == state["coupling_stiffness"].sel(row="xy", column="xx")
    assert float(row["D66 [N mm]"]) == state["bending_stiffness"].sel(row="xy", column="xy")
    assert float(row["M2 [N]"]) == state["moment"].sel(row="yy")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"applied_strain": 0.14}, ["applied_strain", "0.14"]),
        ({"cell_x": 0}, ["cell_x", "n_stripe"]),
        ({"n_subunit": 24}, ["n_subunit = 24", "case file"]),
        ({"where": "n_stripe > 9"}, ["where", "no design"]),
        ({"output": "card.txt"}, ["card.txt", ".csv", ".json", ".inp"]),
        ({"output": "card.inp", "applied_strain": [0.12, 0.15]}, ["card.inp", "one", "2"]),
    ],
)
def test_invalid_input_is_refused_and_nothing_written(change, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with refused(*words):
        kl.plate_stiffness(PREVIEW, **(ONE | change))
    assert not list(tmp_path.iterdir())


def test_a_state_that_is_no_plate_is_reported_and_has_no_card(tmp_path):
    words = ["plate", str(PREVIEW), "--select", "n_stripe=8", "--select", "applied_strain=0.45"]
    said = CliRunner().invoke(main, words)
    assert said.exit_code == 1
    assert " negative " in said.output
    said = CliRunner().invoke(main, [*words, "-o", str(tmp_path / "card.inp")])
    assert said.exit_code == 2
    assert "is negative" in said.output


def test_clamped_samples_are_refused(tmp_path):
    said = CliRunner().invoke(main, ["plate", str(PREVIEW.with_name("paper"))])
    assert said.exit_code == 2
    assert "boundary = periodic" in said.output
    record = json.dumps(sample(kept_case()).record)
    with refused("clamped", "boundary = periodic"):
        case_plates(kept_file().assign_attrs(parameters=record))


def test_a_strain_that_was_not_reached_is_reported():
    case = kept_file().copy(deep=True)
    case["position"][-1] = np.nan
    status = case_plates(case, {"applied_strain": [0.42, 0.45]})["plate_status"].values
    assert status.tolist() == [PlateStatus.ok, PlateStatus.not_converged]


@pytest.mark.slow
def test_where_layers_touch_a_plate_is_unknown_and_elsewhere_it_balances_the_test():
    held = kl.simulate(kl.Design(4, 16, boundary="periodic"), [0.0, 0.1])
    assert (held["energy_contact"] > 0).values.tolist() == [True, False]
    found = kl.plate_stiffness(held)
    assert found["plate_status"].values[0] == PlateStatus.plies_touch
    assert np.isnan(found["bending_stiffness"][0]).all()
    pulled = (found["membrane_force"].sel(row="yy") * found["length_x"])[1]
    np.testing.assert_allclose(pulled, held["reaction_force"][1], atol=1e-6)


def test_designs_without_any_shape_are_refused(tmp_path):
    shutil.copy(PREVIEW / "cube.nc", tmp_path)
    with refused("10 designs", "cases"):
        kl.plate_stiffness(tmp_path)


def test_the_figure_shows_moduli_along_every_direction(plates):
    figure = kl.plot.polar(PREVIEW, n_stripe=4, n_subunit=16, applied_strain=[0.12, 0.15])
    modulus, ratio = figure.axes
    assert [text.get_text() for text in figure.legends[0].get_texts()][1] == "pulled 15%"
    state = plates.sel(ONE)
    quarter = 90
    assert modulus.lines[1].get_ydata()[0] == pytest.approx(float(state["modulus_x"]))
    assert modulus.lines[1].get_ydata()[quarter] == pytest.approx(float(state["modulus_y"]))
    assert ratio.lines[1].get_ydata()[quarter] == pytest.approx(float(state["poisson_ratio_y"]))
