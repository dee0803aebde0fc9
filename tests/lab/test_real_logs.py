"""Logs as meters and testing machines write them: overloads, blocks, rows of units."""

import numpy as np
import pytest
import tomli_w

from knitlab.lab.description import read_description
from tests.lab.recorded import capacitance
from tests.refusals import refused


@pytest.mark.parametrize("reading", [9.9e37, -9.9e37, 9.91e37, 2.0])
def test_what_the_meter_could_not_measure_is_left_out_and_counted(laboratory, reading):
    meter = laboratory.meter().astype(float)
    meter["Status"] = 0
    wrong = [80, 81, 150]
    meter.loc[wrong, "C"] = reading
    if reading < 1e3:  # only the status shows it
        meter.loc[wrong, "Status"] = 1
    meter.to_csv(laboratory.folder / "meter.csv", index=False)
    read = laboratory.imported("capacitance")
    assert any("3 readings that report an overload" in line for line in read.summary)
    cube = read.cube.squeeze()
    np.testing.assert_allclose(cube.capacitance, capacitance(cube.applied_strain), rtol=1e-9)


def test_a_status_in_words_is_not_a_number_to_check(laboratory):
    laboratory.meter().assign(status="ok").to_csv(laboratory.folder / "meter.csv", index=False)
    assert np.isfinite(laboratory.imported("capacitance").cube.capacitance).all()


@pytest.mark.parametrize(("reading", "parts"), [(9.9e37, ["0 rows"]), (0, ["column C", "0"])])
def test_a_meter_without_a_reading_is_refused(laboratory, reading, parts):
    laboratory.meter().assign(C=reading).to_csv(laboratory.folder / "meter.csv", index=False)
    with refused(*parts):
        laboratory.imported("capacitance")


BLOCKS = {
    "Bluehill, raw": ["Specimen properties : Width,45.0,mm", 'Specimen label,"A"', ""],
    "Bluehill, results": [
        '"Results Table 1"',
        ',"Maximum Load"',
        ',"(cN)"',
        '"1","90"',
        "",
        '"Results Table 2"',
    ],
    "TestXpert": ["Prüfer;Ann", "Datum;27.11.2026", "Prüfgeschwindigkeit;0,8;mm/s"],
    "WinTest": ["Test name\tsheet", "Gauge length\t80\tmm", ""],
}


@pytest.mark.parametrize("program", BLOCKS)
@pytest.mark.parametrize("units_below", [True, False])
def test_exports_of_testing_machines_are_the_plain_table(laboratory, program, units_below):
    plain = laboratory.imported("tensile").cube.reaction_force
    separator = {"TestXpert": ";", "WinTest": "\t"}.get(program, ",")
    machine = laboratory.machine()
    units = {"time": "min", "extension": "cm", "trigger": "V", "force": "cN"}
    header = list(machine) if units_below else [f"{name} ({units[name]})" for name in machine]
    lines = [*BLOCKS[program], separator.join(header)]
    if units_below:
        lines.append(separator.join(f"({units[name]})" for name in machine))
    mark = "," if program == "TestXpert" else "."
    lines += [
        separator.join(repr(float(value)).replace(".", mark) for value in row)
        for row in machine.to_numpy()
    ]
    text = "\r\n".join(lines) + "\r\n"
    encoding = "cp1252" if program == "TestXpert" else "utf-16" if program == "WinTest" else "utf-8"
    (laboratory.folder / "tensile.csv").write_bytes(text.encode(encoding))
    np.testing.assert_array_equal(laboratory.imported("tensile").cube.reaction_force, plain)


def test_a_unit_in_the_file_that_contradicts_the_description_is_refused(laboratory):
    machine = laboratory.machine().rename(columns={"force": "force [N]"})
    machine.to_csv(laboratory.folder / "tensile.csv", index=False)
    with refused("force", "[N]", "cN"):
        laboratory.imported("tensile")


def test_of_several_tests_in_a_log_the_stated_one_is_read(laboratory):
    machine = laboratory.machine()
    plain = laboratory.imported("tensile").cube.reaction_force
    softer = machine.assign(force=machine.force / 2).to_csv(index=False)
    (laboratory.folder / "tensile.csv").write_text(
        f"Specimen 1\n{softer}\nSpecimen 2\n{machine.to_csv(index=False)}"
    )
    with refused("table 1", "table 2", "line 2", "table = "):
        laboratory.imported("tensile")
    description = laboratory.description()
    description["tensile"]["table"] = 2
    laboratory.folder.joinpath("sheet.toml").write_text(tomli_w.dumps(description))
    read = laboratory.imported("tensile")
    np.testing.assert_array_equal(read.cube.reaction_force, plain)
    assert any("not read: line 2" in line for line in read.summary)


def test_a_decimal_mark_that_the_numbers_do_not_show_is_stated(laboratory):
    meter = laboratory.meter().astype(float)
    rows = [f"{t / 1000:.0f};{c / 1000:.3f};{k:.0f}" for t, c, k in meter.to_numpy()]
    path = laboratory.folder / "meter.csv"
    path.write_text("\n".join(["t, s;C, pF;TRIG", *rows[::8]]).replace(".", ","))
    description = laboratory.description()
    description["capacitance"] |= {"time": {"column": "t, s", "unit": "s"}}
    description["capacitance"] |= {"capacitance": {"column": "C, pF", "unit": "pF"}}
    laboratory.folder.joinpath("sheet.toml").write_text(tomli_w.dumps(description))
    with refused("decimal = ", "decimal commas"):
        laboratory.imported("capacitance")
    description["capacitance"]["decimal"] = ","
    laboratory.folder.joinpath("sheet.toml").write_text(tomli_w.dumps(description))
    cube = laboratory.imported("capacitance").cube.squeeze()
    np.testing.assert_allclose(cube.capacitance[1:-1], capacitance(cube.applied_strain)[1:-1])


def test_what_a_description_does_not_state_does_not_change_its_cases(laboratory):
    """Keys that came later are not in the text from which the case identifier follows."""
    text = read_description(laboratory.folder / "sheet.toml", "markers").model_dump_json()
    assert not [key for key in ("decimal", "first_frame") if key in text]
