"""A sleeve on a limb: closed forms of a cylinder, and the tension of the fabric that was pulled."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

import knitlab as kl
from knitlab.export.laws.compression import compression_class
from knitlab.export.laws.sleeve import Knit, Limb, needles_for, worn
from knitlab.export.laws.worn_sensor import add_readings, sensor_of
from tests.commands import knitlab
from tests.export.laws.test_law import LAW, STIFFNESS, Quadratic
from tests.refusals import refused

AROUND = np.array([190.0, 220.0, 250.0])  # [mm]


class Linear(Quadratic):
    def stress(self, strain):
        return super().stress(np.asarray(strain))

    def covers(self, strain):
        return abs(strain[0]) < 0.5


KNIT = Knit(Linear(), wales=20, width=20.0, force_error=0.1)
LIMB = Limb(np.arange(3.0), AROUND)
RAISED = Limb(LIMB.height, AROUND + 5 * np.pi)


@pytest.mark.slow
@pytest.mark.nightly
def test_a_sleeve_held_in_length_is_tight_as_a_test_that_holds_the_wales(tmp_path):
    """At strains between those that the law was fitted to."""
    design = kl.Design(4, 16, boundary="periodic")
    protocol = kl.Protocol(load="biaxial_weft", load_ratio=0.0, strain_max=0.22, strain_step=0.055)
    held = kl.simulate(design, protocol=protocol).isel(applied_strain=slice(1, None))
    around = 1 + held["mean_strain_xx"].values
    per_length = held["reaction_force"] / held["relaxed_cell_y"]
    factor = np.sqrt(  # mm of cloth per mm of the network
        held["knit_cell_x"] * held["knit_cell_y"] / held["relaxed_cell_x"] / held["relaxed_cell_y"]
    )
    limb = limb_of(tmp_path / "limb.csv", *(7 * float(held["knit_cell_x"]) * around))
    table = kl.wear(LAW, limb, needles=224, thickness=0, length_ratio=1.0)
    np.testing.assert_allclose(table["tension"], (per_length / factor).values, rtol=0.065)
    assert table["between"].all()


def limb_of(path, *around):
    lines = [f"{80 * number},{each}" for number, each in enumerate(around)]
    path.write_text("\n".join(["height [mm],circumference [mm]", *lines]))
    return path


def test_a_cylinder_of_linear_cloth_has_its_closed_form():
    table = worn(KNIT, LIMB, needles=200)
    a = AROUND / 200
    around = (a**2 - 1) / 2
    # Without force along the limb E_yy follows, and the modulus around is that of C⁻¹.
    along = -STIFFNESS[0, 1] / STIFFNESS[1, 1] * around
    stress = around / np.linalg.inv(STIFFNESS)[0, 0]
    tension = a * stress / np.sqrt(1 + 2 * along)
    tension[0] = 0  # loose
    np.testing.assert_allclose(table["tension"], tension, atol=1e-9)
    np.testing.assert_allclose(table["length_ratio"][1:], np.sqrt(1 + 2 * along)[1:])
    # The two cut edges of half a cylinder carry the pressure on its diameter.
    diameter = AROUND / np.pi
    np.testing.assert_allclose(table["pressure"] / 1000 * diameter, 2 * tension, atol=1e-9)
    np.testing.assert_allclose(table["pressure_mmHg"] * 0.133322, table["pressure"], rtol=1e-5)
    np.testing.assert_allclose(table["error_mmHg"], 0.1 * table["pressure_mmHg"])


def test_needles_are_whole_unit_cells_of_the_nearest_pressure():
    narrow = Limb(LIMB.height[:1], AROUND[:1])
    wanted = worn(KNIT, narrow, needles=160)["pressure_mmHg"][0]
    assert needles_for(KNIT, LIMB, 1.01 * wanted) == 160


@pytest.mark.slow
def test_the_tension_is_that_of_the_fabric_that_was_pulled(tmp_path):
    cube = kl.open_cube(LAW).squeeze()
    pulled = cube.sel(sample=1)  # along the courses
    cell = float(cube["knit_cell_x"][0])
    stretches = 1 + pulled["applied_strain"].values[2:]
    (relaxed,) = kl.export(LAW, tmp_path / "relaxed.obj", sample=1).meshes
    around = 10 * cell * stretches - np.pi * np.ptp(relaxed.nodes[:, 2])
    table = kl.wear(LAW, limb_of(tmp_path / "limb.csv", *around), needles=320)  # ten unit cells
    lengths = 1 + pulled["mean_strain_yy"].values[2:]
    tension = pulled["force_per_width"].values[2:] / lengths
    np.testing.assert_allclose(table["stretch"], stretches - 1, atol=1e-6)
    np.testing.assert_allclose(table["tension"], tension, rtol=0.05)
    np.testing.assert_allclose(table["length_ratio"], lengths, atol=0.01)


def test_the_middle_of_folded_cloth_lies_half_its_thickness_above_the_skin():
    thick, thin = worn(replace(KNIT, thickness=5.0), LIMB, 200), worn(KNIT, RAISED, 200)
    np.testing.assert_allclose(thick["tension"], thin["tension"])
    np.testing.assert_allclose(thick["pressure"] * AROUND, 2000 * np.pi * thin["tension"])
    assert (thick["error_mmHg"] > thin["error_mmHg"]).all()


@pytest.mark.parametrize(("name", "inside"), [("ral-2", [True, False, False]), ("ral-4", [False])])
def test_a_class_is_wanted_at_the_narrowest_place(name, inside):
    wanted = compression_class(name)
    fine = replace(KNIT, wales=1, width=1.0)
    table = worn(fine, LIMB, needles_for(fine, LIMB, wanted.middle))
    said = wanted.judge(table)
    narrowest = table["pressure_mmHg"][0]
    assert table["in_class"].tolist()[: len(inside)] == inside
    assert inside[0] == (wanted.lowest <= narrowest <= wanted.highest)
    assert {f"{narrowest:.3g}", f"{wanted.lowest:g}"} <= set(said.split())


def test_a_class_that_no_standard_has_is_refused():
    with refused("compression_class", "ral-7", "ral-4"):
        compression_class("ral-7")


@pytest.fixture
def sensor():
    """The kept tests, one of them a pull along the courses, with a synthetic capacitance."""
    cube = kl.open_cube(LAW)
    return cube.assign(capacitance=(2 + cube["mean_strain_xx"] ** 2).assign_attrs(units="pF"))


def test_a_sensor_reads_the_stretch_of_a_sleeve(sensor):
    stretches = np.array([-0.1, 0.0, 0.06, 0.16, 0.4])
    table = worn(KNIT, Limb(stretches, 200 * (1 + stretches)), 200)
    add_readings(table, sensor_of(sensor, sensor.squeeze().sel(sample=1), {}))
    between = np.mean([0.15**2, 0.15**2, 0.18**2])  # at a third of the way
    changes = np.array([0, 0, 0.06**2, between, np.nan])
    np.testing.assert_allclose(table["capacitance"], 2 + changes)
    np.testing.assert_allclose(table["capacitance_change"], changes, atol=1e-9)
    np.testing.assert_allclose(table["capacitance_slope"][2:4], [0.12, 0.32], rtol=1e-6)


def test_a_sensor_of_a_sleeve_held_in_length_is_of_a_pull_that_holds_the_wales(sensor):
    design = sensor.squeeze().sel(sample=1)
    sample = int(sensor_of(sensor, design, {}, 1.0)["sample"])
    assert sample != int(sensor_of(sensor, design, {})["sample"])
    held = sensor.squeeze().sel(sample=sample)
    np.testing.assert_allclose(held["mean_strain_yy"], 0, atol=1e-9)
    np.testing.assert_allclose(held["mean_strain_xx"], held["applied_strain"], atol=1e-9)
    with refused("1.1", "biaxial_weft", "load_ratio = 0"):
        sensor_of(sensor, design, {}, 1.1)


def test_a_sensor_of_another_design_or_pull_is_refused(sensor):
    design = sensor.squeeze().sel(sample=1)
    with refused("design", "load = weft"):
        sensor_of(sensor, design.assign(rib_k_s=1.1 * design["rib_k_s"]), {})
    closed = sensor.assign(capacitance=sensor["capacitance"].where(sensor["applied_strain"] == 0))
    with refused("1 strains", "2", "layout"):
        sensor_of(closed, design, {})
    with refused("law", "capacitance", "give"):
        sensor_of(kl.open_cube(LAW), design, {})
    with refused("courses", "load = weft"):
        sensor_of(sensor.isel(sample=slice(1, None)), design, {})
    with refused("electrodes", "layout"):
        sensor_of(sensor.isel(sample=[0, 0]), design, {})


def test_what_cannot_be_worn_is_refused(tmp_path):
    path = tmp_path / "limb.csv"
    path.write_text("height [mm],circumference [mm]\n0,240\n80,260\n")
    with refused("needles", "pressure", "one"):
        kl.wear(LAW, path)
    with refused("thickness", "-3", "0 or more"):
        kl.wear(LAW, path, needles=224, thickness=-3)
    path.write_text("height [kg],circumference [mm]\n0,24\n8,26\n")
    with refused("height", "kg", "mm"):
        kl.wear(LAW, path, needles=200)
    path.write_text("height [mm],circumference [mm]\n0,-240\n80,260\n")
    with refused("-240", "above 0"):
        kl.wear(LAW, path, needles=200)
    shutil.copy(LAW / "cube.nc", tmp_path)
    with refused(tmp_path.name, "case files", "thickness"):
        kl.wear(tmp_path / "cube.nc", limb_of(path, 230), needles=224)


@pytest.mark.slow
def test_the_command_says_where_a_sleeve_is_stretched_beyond_the_tests(tmp_path):
    path = limb_of(tmp_path / "limb.csv", 250, 400)
    path.write_text(f"{path.read_text()}\n\nmean,325\n")
    said = knitlab("wear", LAW, "--limb", path, "--needles", 240, "--format", "csv")
    assert "not read" in said.stderr
    assert said.exit_code == 1
    assert [line.rpartition(",")[2] for line in said.stdout.splitlines()[1:3]] == ["True", "False"]
