"""The machine: what its file holds, and what is refused."""

import tomllib

import pytest

from knitlab.export.knitting.machine import Machine, read_machine
from knitlab.io.shipped import shipped
from knitlab.runs.declared_fields import declared, unit_of
from knitlab.runs.yarn import YarnOnMachine
from tests.refusals import refused

FILE = tomllib.loads((shipped("params") / "machine.toml").read_text(encoding="utf-8"))
NAMED = ("machines", "back_ends")  # tables of tables


def test_every_value_of_the_file_has_its_unit_and_source():
    types = {"machine": str} | declared(Machine) | declared(YarnOnMachine)
    named = [each for kind in NAMED for each in FILE[kind].values()]
    for table in (*named, *(FILE[name] for name in FILE.keys() - {*NAMED})):
        for name, entry in table.items():
            assert set(entry) == {"value", "unit", "source"}
            assert entry["unit"] == unit_of(types[name])


@pytest.mark.parametrize("model", FILE["machines"])
def test_every_machine_is_as_its_table_and_its_back_end_say(model):
    machine, table = read_machine({"model": model}), FILE["machines"][model]
    for name, entry in (table | FILE["back_ends"][machine.back_end]).items():
        assert getattr(machine, name) == entry["value"]
    assert machine.pitch == pytest.approx(25.4 / table["needles_per_inch"]["value"])
    # A program names the carriers of a list that its back end takes.
    assert machine.carriers == machine.listed_carriers


def test_the_paper_gives_machine_needles_and_stitch_sizes():
    machine = read_machine()
    assert (machine.model, machine.needles) == ("SWG061N2", 360)
    assert machine.body_stitch_size == 34
    assert machine.plated_stitch_size == 38
    # 360 needles of 15 an inch are the two feet of the machine.
    assert machine.pitch * machine.needles == pytest.approx(24 * 25.4)


def test_the_sizes_of_a_yarn_count_on_its_own_machine_only():
    yarn = YarnOnMachine(yarn="merino", stitch_size=9, machine="Kniterate")
    own, other = read_machine(yarn=yarn), read_machine({"model": "SWG061N2"}, yarn)
    assert (own.model, own.body_yarn, own.body_stitch_size) == ("Kniterate", "merino", 9)
    assert own.plated_stitch_size is own.conductive_yarn is None
    assert (other.model, other.body_yarn, other.body_stitch_size) == ("SWG061N2", "merino", None)
    assert read_machine({"model": "SWG061N2", "body_stitch_size": 30}, yarn).body_stitch_size == 30
    # The sizes of the paper are those of its machine too.
    assert read_machine({"model": "Kniterate"}).body_stitch_size is None


@pytest.mark.parametrize("yarn", [None, YarnOnMachine(machine="Stoll")])
def test_an_unknown_model_is_refused_with_all_that_are_known(yarn):
    with refused("model", "Stoll", *FILE["machines"]):
        read_machine(None if yarn else {"model": "Stoll"}, yarn)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"speed_number": 16}, ["speed_number", "16", "0 to 15"]),
        ({"model": "Kniterate", "body_stitch_number": 12}, ["body_stitch_number", "12", "0 to 9"]),
        ({"ends": "drop"}, ["ends", "did you mean 'end'"]),
        ({"end": "sew"}, ["end", "'bind_off'", "'drop'", "'sew'"]),
        ({"waste_courses": 3}, ["waste_courses", "even", "3"]),
        ({"body_carrier": 12}, ["body_carrier", "12", "10"]),
        ({"body_carrier": 4}, ["body_carrier", "4", "one carrier"]),
        ({"body_yarn": "two\nlines"}, ["body_yarn", "two"]),
        ({"hooks": False}, ["hooks", "knitout-to-dat.js", "back_end"]),
        ({"back_end": "stoll.js"}, ["stoll.js", "knitout-to-dat.js"]),
        ({"needles": 0}, ["needles", "greater than 0"]),
    ],
)
def test_invalid_values_are_refused(changes, words):
    with refused(*words):
        read_machine(changes)
