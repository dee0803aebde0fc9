import re
import shutil

import pytest

from knitlab.io.errors import InputError
from knitlab.io.shipped import shipped
from knitlab.runs.parameters import read_parameters


@pytest.fixture
def folder(tmp_path):
    shutil.copytree(shipped("params"), tmp_path / "params")
    return tmp_path / "params"


def edited(folder, file, pattern, text):
    path = folder / file
    changed, count = re.subn(pattern, text, path.read_text(), count=1)
    assert count == 1
    path.write_text(changed)


def test_the_tables_are_those_of_the_paper():
    stripes = read_parameters(shipped("params")).stripes
    assert sorted(map(int, stripes.rib.n)) == [2, 4, 6, 8]
    assert sorted(map(int, stripes.garter.n)) == [4, 6, 8, 12, 16]
    assert stripes.rib.n["6"].model_dump(exclude_none=True) == {
        "period": 1.93,
        "k_s": 0.562,
        "theta_0": 0.754,
        "k_t": 0.0072,
    }
    assert stripes.garter.n["12"].k_t == 0.025


def test_the_paper_has_twenty_designs():
    pairs = read_parameters(shipped("params")).designs.root["paper"].pairs
    assert len(pairs) == len(set(pairs)) == 20
    assert {m // (2 * n) for n, m in pairs if n == 2} == {4, 5, 6, 7, 8}
    assert {m // (2 * n) for n, m in pairs if n > 2} == {2, 3, 4, 5, 6}


@pytest.mark.parametrize(
    ("file", "pattern", "text", "message"),
    [
        ("stripes.toml", "k_s = 1.825", "k_s = -1.825", r"rib\.n\.2\.k_s: .*-1\.825"),
        ("stripes.toml", "k_s = 1.825", "ks = 1.825", r"rib\.n\.2\.ks: "),
        ("stripes.toml", "k_s = 1.825, ", "", r"rib\.n\.2\.k_s: .*missing"),
        ("stripes.toml", "theta_0 = 0.874", "theta_0 = inf", r"rib\.n\.2\.theta_0: "),
        ("stripes.toml", '"N/mm"', '"N/m"', r"rib\.unit\.k_s: .*'N/mm'"),
        ("stripes.toml", r"\n16 = .*", "", r"designs\.toml: paper: n_stripe = 8.*garter"),
        ("sheet.toml", "source = .*", "", r"z_max\.source: .*missing"),
        ("model.toml", '"relaxed"', '"loose"', r"cell_size\.value: .*'flat' or 'relaxed'"),
        ("gauge.toml", "value = 1.35", "value = 0", r"stitch_width\.value: "),
        ("gauge.toml", r"\[stitch_height\]", "[stitch_hight]", "stitch_hight: "),
        ("designs.toml", r"\[16, 20", "[18, 20", "paper: n_subunit = 18"),
        ("sheet.toml", r"\[z_max\]", "[z_max", r"sheet\.toml: .*TOML"),
    ],
)
def test_a_mistake_is_named_with_its_path(folder, file, pattern, text, message):
    edited(folder, file, pattern, text)
    with pytest.raises(InputError, match=message) as caught:
        read_parameters(folder)
    assert all(str(folder / "") in each.path for each in caught.value.mistakes)


def test_all_mistakes_of_all_files_are_in_one_message(folder):
    edited(folder, "stripes.toml", "k_s = 1.825", "k_s = -1")
    edited(folder, "stripes.toml", "k_t = 0.144", "k_t = 0")
    edited(folder, "sheet.toml", "value = 6.0", 'value = "six"')
    (folder / "solver.toml").unlink()
    with pytest.raises(InputError) as caught:
        read_parameters(folder)
    places = " ".join(each.path for each in caught.value.mistakes)
    for place in ("rib.n.2.k_s", "garter.n.4.k_t", "z_max.value", "solver.toml"):
        assert place in places
