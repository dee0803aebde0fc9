"""The machine: what its file holds, and what is refused."""

import tomllib

import pytest

from knitlab.io.errors import BadInput
from knitlab.io.shipped import shipped
from knitlab.knitting.machine import Machine, read_machine
from knitlab.sweep.declared_fields import declared, unit_of


def test_every_value_of_the_file_has_its_unit_and_source():
    file = tomllib.loads((shipped("params") / "machine.toml").read_text(encoding="utf-8"))
    entries = {name: entry for table in file.values() for name, entry in table.items()}
    types = declared(Machine)
    assert set(entries) == set(types)
    assert all(set(entry) == {"value", "unit", "source"} for entry in entries.values())
    assert {name: entry["unit"] for name, entry in entries.items()} == {
        name: unit_of(kind) for name, kind in types.items()
    }


def test_the_paper_gives_machine_needles_and_stitch_sizes():
    machine = read_machine()
    assert (machine.model, machine.needles) == ("SWG061N2", 360)
    assert machine.body_stitch_size == 34
    assert machine.plated_stitch_size == 38
    # 360 needles of 15 an inch are the two feet of the machine.
    assert machine.pitch * machine.needles == pytest.approx(24 * 25.4)


def test_the_kniterate_is_taken_by_its_name_and_other_values_replace_its_own():
    machine = read_machine({"model": "kniterate", "waste_courses": 10})
    assert (machine.model, machine.needles, machine.carriers) == ("Kniterate", 252, 6)
    assert not machine.hooks
    assert machine.waste_courses == 10


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"speed_number": 16}, "machine speed_number: is 16, and the table has rows 0 to 15"),
        (
            {"model": "Kniterate", "body_stitch_number": 12},
            "machine body_stitch_number: is 12, and knitout-to-kcode.js takes one digit",
        ),
        ({"ends": "drop"}, "machine ends: there is no setting of the machine 'ends'; did you mean"),
        ({"end": "sew"}, "machine end: input should be 'bind_off' or 'drop', but is 'sew'"),
        ({"waste_courses": 3}, "machine waste_courses: is an even number"),
        ({"body_carrier": 12}, "machine body_carrier: is carrier 12, and there are 10"),
        ({"body_carrier": 4}, "are one carrier; give each its own"),
        ({"body_yarn": "two words"}, "machine body_yarn: is one word without"),
        ({"needles": 0}, "machine needles: input should be greater than 0"),
    ],
)
def test_bad_values_are_refused(changes, message):
    with pytest.raises(BadInput) as caught:
        read_machine(changes)
    assert message in str(caught.value)
