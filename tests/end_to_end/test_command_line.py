"""The commands as a user types them, on a design small enough for a test."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
import xarray as xr
from distributed import Client
from hypothesis import given
from hypothesis import strategies as st

from knitlab.cli.options import read_selections
from tests.commands import knitlab

PREVIEW = str(Path(__file__).parents[2] / "results/reference/preview")
SMALL = ("--set", "n_stripe=4", "--set", "n_subunit=8", "--set", "strain_max=0.06")


pytestmark = pytest.mark.usefixtures("in_folder")


@pytest.mark.slow
def test_a_sweep_from_plan_to_map():
    planned = knitlab("plan", "periodic", *SMALL)
    assert planned.exit_code == 0
    assert "1 cases, 3 strains from 0 to 0.06" in planned.output
    assert json.loads(Path("results/periodic/plan.json").read_text())["cases"]

    ran = knitlab("run", "periodic", *SMALL, "--workers", "0")
    assert ran.exit_code == 0, ran.output
    assert "1 cases simulated, 0 already there" in ran.output
    figures = {path.name for path in Path("results/periodic/figures").iterdir()}
    assert figures == {"curves.png", "auxetic.png", "shape.png"}

    again = knitlab("run", "periodic", *SMALL, "--workers", "0")
    assert "0 cases simulated, 1 already there" in again.output

    cube = "results/periodic/cube.nc"
    answered = knitlab("query", cube, "--where", "poisson_ratio_min < 1", "--format", "json")
    (design,) = json.loads(answered.stdout)
    assert (design["n_stripe"], design["n_subunit"], design["status"]) == (4, 8, "ok")
    stored = xr.load_dataset(cube)["poisson_ratio_min"].item()
    assert design["poisson_ratio_min"] == pytest.approx(stored)

    drawn = knitlab("map", "auxetic", cube, "-o", "map.pdf")
    assert drawn.exit_code == 0
    assert Path("map.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize(
    "words",
    [
        ("run", "periodic", "--set", "n_stripe=5", "--set", "n_subunit=20"),
        ("run", "periodic", "--workers", "-1"),
        ("run", "periodic", "--scheduler", "tcp://127.0.0.1:9"),
        ("query", "nowhere.nc"),
        ("map", "auxetic", "nowhere.nc", "-o", "new/map.png"),
        ("export", "nowhere.nc", "-o", "new/shape.vtu"),
    ],
)
def test_bad_input_is_a_sentence_and_exit_code_2_and_writes_nothing(words, tmp_path, monkeypatch):
    # Not the ten seconds that a scheduler has to answer.
    monkeypatch.setattr("distributed.Client", lambda address, **_: Client(address, timeout=0.5))
    result = knitlab(*words)
    assert result.exit_code == 2
    assert result.output.strip()
    assert "Traceback" not in result.output
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "selection"),
    [
        (("query", PREVIEW), "n_stripe"),
        (("query", PREVIEW), "n_stripe=4,5"),
        (("compare", PREVIEW, PREVIEW), "simulation=1"),
        (("export", PREVIEW, "-o", "a.vtu"), "repeats=2"),
        (("map", "auxetic", PREVIEW, "-o", "a.pdf"), "cell_x=1"),
        (("claims", PREVIEW), "n_stripe=4"),
        (("knit", PREVIEW), "n_stripe=four"),
    ],
)
def test_an_invalid_selection_is_named_as_it_was_given(words, selection):
    said = knitlab(*words, "--select", selection)
    assert said.exit_code == 2
    assert f"--select {selection}" in said.output


@given(values=st.lists(st.integers() | st.floats(allow_nan=False), min_size=1))
def test_selected_numbers_are_read_as_numbers(values):
    (read,) = read_selections((f" name = {' , '.join(map(str, values))}",)).values()
    assert read == values
    assert [type(value) for value in read] == [type(value) for value in values]


@pytest.mark.parametrize("label", ["04", "1e3", "barrier", "4 x 2"])
def test_a_selected_label_keeps_its_letters(label):
    assert read_selections((f"name={label}",)) == {"name": [label]}


@pytest.mark.parametrize("command", ["status", "run"])
@pytest.mark.skipif(sys.platform != "linux", reason="no limit of address space")
def test_little_address_space_is_a_sentence(command):
    words = f"ulimit -v 200000; exec {sys.executable} -m knitlab {command} periodic"
    done = subprocess.run(["bash", "-c", words], capture_output=True, text=True, timeout=60)
    (line,) = done.stderr.splitlines()
    assert (done.returncode, "0.2 GB" in line, "ulimit -v" in line) == (2, True, True)


@pytest.mark.parametrize("name", ["../../victim", "..", "/victim", "a\\b", "", "x" * 300])
def test_a_name_that_leaves_its_folder_is_a_sentence(name, tmp_path):
    cube = xr.load_dataset(f"{PREVIEW}/cube.nc")
    cube["case_id"] = xr.full_like(cube["case_id"].astype(object), name)
    (tmp_path / "folder/cases").mkdir(parents=True)
    for place in (tmp_path / "victim.nc", tmp_path / "folder/victim.nc"):
        place.write_text("not to be read", encoding="utf-8")
    cube.to_netcdf(tmp_path / "folder/cube.nc")
    before = sorted(tmp_path.rglob("*"))
    for words in (
        ("export", str(tmp_path / "folder"), "--select", "n_stripe=4", "-o", "a.vtu"),
        ("map", "shape", str(tmp_path / "folder"), "-o", "a.png"),
        ("map", name, PREVIEW, "-o", "a.png"),
        ("reproduce", name, "--results", str(tmp_path)),
        ("status", name, "--results", str(tmp_path)),
        ("plan", name, "--results", str(tmp_path)),
    ):
        done = knitlab(*words)
        assert (done.exit_code, type(done.exception)) == (2, SystemExit), (words, done.output)
    assert sorted(tmp_path.rglob("*")) == before
