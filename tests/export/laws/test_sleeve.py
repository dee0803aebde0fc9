"""A sleeve on a limb: closed forms of a cylinder, and the tension of the fabric that was pulled."""

import numpy as np
import pytest

import knitlab as kl
from knitlab.export.laws.sleeve import Knit, Limb, needles_for, worn
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


def test_the_tension_is_that_of_the_fabric_that_was_pulled(tmp_path):
    cube = kl.open_cube(LAW).squeeze()
    pulled = cube.sel(sample=1)  # along the courses
    cell = float(cube["knit_cell_x"][0])
    stretches = 1 + pulled["applied_strain"].values[2:]
    path = tmp_path / "limb.csv"
    lines = [f"{number},{10 * cell * a}" for number, a in enumerate(stretches)]
    path.write_text("\n".join(["height [mm],circumference [mm]", *lines]))
    table = kl.wear(LAW, path, needles=320)  # ten unit cells
    lengths = 1 + pulled["mean_strain_yy"].values[2:]
    tension = pulled["force_per_width"].values[2:] / lengths
    np.testing.assert_allclose(table["stretch"], stretches - 1, rtol=1e-6)
    np.testing.assert_allclose(table["tension"], tension, rtol=0.05)
    np.testing.assert_allclose(table["length_ratio"], lengths, atol=0.01)


def test_what_cannot_be_worn_is_refused(tmp_path):
    path = tmp_path / "limb.csv"
    path.write_text("height [mm],circumference [mm]\n0,240\n80,260\n")
    with refused("needles", "pressure", "one"):
        kl.wear(LAW, path)
    path.write_text("height [cm],circumference [cm]\n0,24\n8,26\n")
    with refused("height", "cm", "mm"):
        kl.wear(LAW, path, needles=200)
    path.write_text("height [mm],circumference [mm]\n0,-240\n80,260\n")
    with refused("-240", "above 0"):
        kl.wear(LAW, path, needles=200)


@pytest.mark.slow
def test_the_command_says_where_a_sleeve_is_stretched_beyond_the_tests(tmp_path):
    path = tmp_path / "limb.csv"
    path.write_text("height [mm],circumference [mm]\n0,270\n80,400\n")
    said = knitlab("wear", LAW, "--limb", path, "--needles", 240, "--format", "csv")
    assert said.exit_code == 1
    assert [line.rpartition(",")[2] for line in said.stdout.splitlines()[1:3]] == ["True", "False"]
