import numpy as np
import pytest

from knitlab.io.errors import BadInput
from knitlab.io.table_file import read_tension_curve

GOOD = "strain [1],force [N]\n0,0\n0.1,0.2\n0.2,0.5\n0.3,0.9\n"


def written(tmp_path, text):
    path = tmp_path / "curve.csv"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("header", "strain", "force", "options"),
    [
        ("strain [1],force [N]", 1, 1, {}),
        ("Strain [%], Force [cN]", 100, 100, {}),
        ("strain [mm/mm],force [mN],time [s]", 1, 1000, {}),
        ("strain [1],stress [N/mm]", 1, 1 / 0.5, {"width": 0.5}),
        ("strain [1],stress [N/m]", 1, 1000 / 0.5, {"width": 0.5}),
        ("strain [1],stress [MPa]", 1, 1 / (0.5 * 2), {"width": 0.5, "thickness": 2.0}),
        ("strain [1],stress [kPa]", 1, 1000 / (0.5 * 2), {"width": 0.5, "thickness": 2.0}),
    ],
)
def test_units_of_the_header_are_converted(tmp_path, header, strain, force, options):
    extra = ",7" if "time" in header else ""
    strains, forces = [0.0, 0.1, 0.1, 0.3, 0.4], [0.0, 0.2, 0.5, 0.9, 1.0]
    rows = [f"{strain * a},{force * b}{extra}" for a, b in zip(strains, forces, strict=True)]
    path = written(tmp_path, "\n".join(["# a comment", header, *rows]))
    curve = read_tension_curve(path, **options)
    np.testing.assert_allclose(curve.strain, strains)
    np.testing.assert_allclose(curve.force, forces)


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        (GOOD.replace("[N]", ""), {}, "column force: has no unit"),
        (GOOD.replace("strain [1]", "strain"), {}, "column strain: has no unit"),
        (GOOD.replace("[N]", "[]"), {}, "column force: has no unit"),
        (GOOD.replace("[N]", "[mm]"), {}, r"is in mm; give it in a unit of force"),
        (GOOD.replace("[N]", "[wurble]"), {}, "unknown unit 'wurble'"),
        (GOOD.replace("strain [1]", "strain [N]"), {}, "is in N"),
        (GOOD.replace("strain [1]", "time [s]"), {}, "column strain: is missing"),
        (GOOD.replace("force [N]", "load [N]"), {}, "has neither"),
        (GOOD.replace("0.2,0.5", "0.2,nan"), {}, "point 3 is 'nan'"),
        (GOOD.replace("0.2,0.5", "0.2,"), {}, "point 3 is empty"),
        (GOOD.replace("0.2,0.5", "0.2,inf"), {}, "point 3 is 'inf'"),
        (GOOD.replace("0.2,0.5", "0.05,0.5"), {}, r"decreases from 0.1 to 0.05 at point 3"),
        (GOOD.replace("0,0\n", "-1,0\n"), {}, "goes down to -1"),
        ("strain [1],force [N]\n0,0\n0.1,1\n", {}, "has 2 points"),
        ("strain [1],force [N]\n", {}, "has 0 points"),
        ("", {}, "is not a CSV table"),
        (GOOD.replace("0.2,0.5", "0.2,0.5,3"), {}, "is not a CSV table"),
        ("strain [1],force [N]\n0,0,0,0\n0,1,0,5\n0,2,0,9\n0,3,1,0\n", {}, "is not a CSV"),
        (GOOD.replace("0.2,", "0.1,").replace("0.3,", "0.1,"), {}, "has 2 points"),
        (GOOD, {"width": 0.3}, "width 0.3: is for stress"),
        (GOOD.replace("force [N]", "stress [N/mm]"), {}, "give its width in mm"),
        (GOOD.replace("force [N]", "stress [MPa]"), {"width": 0.3}, "give the thickness in mm"),
        (GOOD.replace("force", "strain"), {}, "occurs twice"),
        (GOOD.replace("force [N]", "strain [1]"), {}, "occurs twice"),
        (GOOD.replace("strain [1]", "strain [deg]"), {}, "is in deg"),
        (GOOD.replace("strain [1]", "strain [dB]"), {}, "is in dB"),
        (GOOD.replace("0.2,0.5", "0.2,0.5 # slack"), {}, "point 3 is '0.5 # slack'"),
        (GOOD.replace("0.2,0.5", "0.2"), {}, "point 3 is empty"),
    ],
)
def test_a_bad_curve_is_refused(tmp_path, text, options, message):
    with pytest.raises(BadInput, match=message):
        read_tension_curve(written(tmp_path, text), **options)


def test_all_faults_are_in_one_message(tmp_path):
    path = written(tmp_path, "strain [m],force [kg]\n0,0\nx,1\n0.2,2\n0.3,nan\n")
    with pytest.raises(BadInput) as caught:
        read_tension_curve(path)
    assert len(caught.value.faults) == 4


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(BadInput, match=r"nowhere\.csv: cannot be read"):
        read_tension_curve(tmp_path / "nowhere.csv")
