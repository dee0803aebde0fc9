"""Any name and any damaged byte of a results folder: the right numbers or a sentence."""

import errno
import json
import shutil
import socket
from contextlib import suppress

import click
import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner
from hypothesis import HealthCheck, Phase, example, given, settings
from hypothesis import strategies as st
from PIL import Image

from knitlab.cli.options import CommandGroup
from knitlab.cubes.cube_file import open_cube
from knitlab.cubes.query import query_cubes
from knitlab.figures.claims_page import _escaped
from knitlab.figures.explorer.explorer import write_explorer
from knitlab.io.checksum import LENGTH
from knitlab.io.errors import InputError
from knitlab.io.image_file import read_image
from knitlab.io.names import is_name, one_line
from knitlab.runs.merge import merge_folders
from knitlab.runs.plan import make_plan
from knitlab.runs.results_folder import CaseState
from knitlab.runs.status import status
from knitlab.runs.workers import connected
from tests.runs import fake_simulator

FUZZ = settings(
    deadline=None,
    derandomize=True,
    max_examples=12,
    phases=(Phase.explicit, Phase.generate),
    suppress_health_check=list(HealthCheck),
)
FEW = ("n_stripe=4", "n_subunit=16,32", "strain_max=0.06")


def ran(folder, plan=None):
    return fake_simulator.ran(plan or make_plan("periodic", FEW), folder)


@pytest.fixture(scope="module")
def undamaged(tmp_path_factory):
    folder = tmp_path_factory.mktemp("results") / "periodic"
    return folder, ran(folder).cube


@pytest.fixture
def folder(undamaged, tmp_path):
    shutil.copytree(undamaged[0], tmp_path / "periodic")
    return tmp_path / "periodic"


def numbers(cube):
    return cube.drop_attrs().load()


@pytest.mark.slow
@pytest.mark.nightly
@FUZZ
@given(data=st.data())
def test_a_damaged_byte_gives_the_right_numbers_or_a_sentence(undamaged, tmp_path, data):
    original, cube = undamaged
    folder, merged = tmp_path / "periodic", tmp_path / "merged"
    for old in (folder, merged):
        shutil.rmtree(old, ignore_errors=True)
    shutil.copytree(original, folder)
    names = [path.relative_to(folder) for path in sorted(folder.rglob("*")) if path.is_file()]
    path = folder / data.draw(st.sampled_from([name for name in names if "lock" not in name.name]))
    contents = bytearray(path.read_bytes())
    if contents:
        contents[data.draw(st.integers(0, len(contents) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    path.write_bytes(contents)
    wanted = query_cubes([open_cube(original)])

    def read():
        assert set(status("periodic", results=tmp_path, check=True).counts) <= {"ok", "damaged"}
        assert query_cubes([open_cube(folder, lazily=True)]).equals(wanted)
        xr.testing.assert_identical(numbers(merge_folders([folder], merged).cube), numbers(cube))

    with suppress(InputError):
        read()
    xr.testing.assert_identical(numbers(ran(folder).cube), numbers(cube))
    read()


LETTERS = st.text(st.sampled_from("aé9_ .-/\\<=\x1b\n\0\u202e$'\""), max_size=12)


@FUZZ
@given(name=LETTERS | st.text(max_size=120))
@example(name="my border 2.1_b-é")
@example(name="a/../../../../../outside/evil")
def test_a_name_works_everywhere_or_is_refused_with_its_place(tmp_path_factory, name):
    folder = tmp_path_factory.mktemp("names")
    patterns = folder / "patterns.toml"
    key = json.dumps(name, ensure_ascii=False)
    patterns.write_text(f'[{key}]\nrows = ["GR", "RG"]\n', encoding="utf-8")
    overrides = {"pattern_files": [str(patterns)], "pattern": [name, "checkerboard"]}
    overrides |= {"n_stripe": 4, "n_subunit": 16, "strain_max": 0.03}
    before = {*folder.parent.iterdir()}
    taken = name == "checkerboard" or not set(name.upper()) - set("RGP")
    if not is_name(name) or taken:
        with pytest.raises(InputError, match="pattern"):
            make_plan("periodic", overrides)
        return
    plan = make_plan("periodic", overrides)
    ran(folder / "results" / "periodic", plan)
    assert {*folder.parent.iterdir()} == before
    assert status("periodic", results=folder / "results").counts == {"ok": 2}
    cube = open_cube(folder / "results" / "periodic")
    assert name in set(query_cubes([cube])["pattern"])
    write_explorer([cube], folder / "page.html")


@pytest.mark.parametrize("name", ["../victim", "/absolute", "", "..", "=cmd", "\x1b[31m", "con.1"])
@pytest.mark.parametrize("where", ["plan", "cube"])
def test_a_stated_name_leads_nowhere_else(folder, tmp_path, name, where):
    if where == "plan":
        record = json.loads((folder / "plan.json").read_text())
        record.pop("sha256")
        (folder / "plan.json").write_text(json.dumps(record | {"workflow": name}))
    else:
        (folder / "plan.json").unlink()
        cube = xr.load_dataset(folder / "cube.nc")
        cube.assign_attrs(workflow=str(name)).to_netcdf(folder / "cube.nc")
    with pytest.raises(InputError):
        merge_folders([folder], tmp_path / "merged" / "here")
    assert not list(tmp_path.glob("victim*"))


def test_exchanged_case_files_are_computed_again(folder, undamaged):
    one, other = sorted((folder / "cases").glob("*.nc"))
    exchanged = one.read_bytes(), other.read_bytes()
    one.write_bytes(exchanged[1])
    other.write_bytes(exchanged[0])
    (folder / "cube.nc").unlink()
    run = ran(folder)
    assert set(run.states_before.values()) == {CaseState.damaged}
    xr.testing.assert_identical(numbers(run.cube), numbers(undamaged[1]))


@pytest.mark.parametrize("dims", [("n_stripe",), ("n_stripe", "n_subunit"), ("foreign",)])
def test_variables_of_other_programs_are_left_out(folder, undamaged, dims, tmp_path):
    cube = open_cube(folder)
    sizes = {dim: cube.sizes.get(dim, 3) for dim in dims}
    foreign = xr.Variable(dims, np.zeros(tuple(sizes.values())))
    cube.assign(mine=foreign).to_netcdf(tmp_path / "other.nc")
    shutil.copy(tmp_path / "other.nc", folder / "cube.nc")
    for run in (ran(folder).cube, merge_folders([folder], tmp_path / "merged").cube):
        xr.testing.assert_identical(numbers(run), numbers(undamaged[1]))


def test_a_cube_that_does_not_match_the_schema_is_named_and_built_again(folder, undamaged):
    xr.load_dataset(folder / "cube.nc").drop_vars("applied_strain").to_netcdf(folder / "cube.nc")
    with pytest.raises(InputError, match="applied_strain"):
        open_cube(folder)
    run = ran(folder)
    xr.testing.assert_identical(numbers(run.cube), numbers(undamaged[1]))
    (remark,) = run.remarks(run.cube["status"].dims, folder)
    assert "cube-damaged.nc" in remark


def test_a_cube_that_lost_strains_is_read_and_completed(folder, undamaged):
    xr.load_dataset(folder / "cube.nc").isel(applied_strain=1).to_netcdf(folder / "cube.nc")
    assert open_cube(folder)["poisson_ratio"].sizes["applied_strain"] == 1
    xr.testing.assert_identical(numbers(ran(folder).cube), numbers(undamaged[1]))


@pytest.mark.parametrize("complete", [True, False])
def test_a_damaged_name_of_an_attribute_is_noticed(folder, undamaged, complete):
    contents = (folder / "cube.nc").read_bytes()
    contents = contents if complete else contents[:-LENGTH]
    (folder / "cube.nc").write_bytes(contents.replace(b"workflow", b"workfloh"))
    with pytest.raises(InputError, match="damaged"):
        open_cube(folder)
    xr.testing.assert_identical(numbers(ran(folder).cube), numbers(undamaged[1]))


MANY = [1 + k / 1000 for k in range(1000)]


@pytest.mark.parametrize(
    ("overrides", "problem"),
    [
        ({"unit_cells": [1_000_000, 1_000_000]}, "grid"),
        ({"unit_cells": [10**11, 1]}, "1000000"),
        ({"k_t_factor": MANY, "k_s_factor": MANY}, "cases"),
        ({"n_stripe": [4] * 5000, "n_subunit": [16] * 5000}, "300"),
        (("n_stripe=" + "9" * 5000,), "integer"),
        (("n_stripe=0x" + "f" * 5000,), "too long"),
        ({"further_strains": [0.1 + k / 1e5 for k in range(2000)]}, "1000"),
        (("k_t_factor=" + "," * 90_000,), "^.{500,1000}number"),
        *((("n_stripe=4", text), "Poisson's ratio") for text in ("tolerance=0.05", "rest_force=1")),
        (("n_stripe=4", "relative_tolerance=0.01"), "coarse"),
    ],
)
def test_a_sweep_that_is_too_large_or_too_coarse_is_refused(overrides, problem):
    with pytest.raises(InputError, match=problem):
        make_plan("periodic", overrides)


@pytest.mark.parametrize("condition", ["abs(" * 5000, "1" * 5000 + " > 0", f"n_stripe > {10**900}"])
def test_a_condition_that_is_too_large_is_refused(folder, condition):
    with pytest.raises(InputError, match=r"too long|cannot be computed"):
        open_cube(folder).knitlab.query(condition)


def test_an_image_of_another_format_is_refused(tmp_path):
    Image.new("RGB", (32, 32)).save(tmp_path / "map.icns")
    with pytest.raises(InputError, match="PNG"):
        read_image(tmp_path / "map.icns")


def test_an_unresponsive_scheduler_is_named():
    with socket.create_server(("127.0.0.1", 0)) as unresponsive:
        address = f"tcp://127.0.0.1:{unresponsive.getsockname()[1]}"
        with pytest.raises(InputError, match=address):
            connected(address)


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (MemoryError(), "memory"),
        (OSError(errno.EMFILE, "Too many open files"), "open files"),
        (PermissionError(errno.EACCES, "Permission denied", "here"), "here: "),
        (FileNotFoundError(errno.ENOENT, "No such file"), "folder"),
        (KeyError("n_stripe"), "KeyError: 'n_stripe'"),
    ],
)
def test_what_a_machine_lacks_or_forbids_is_one_line(error, said):
    @click.group(cls=CommandGroup)
    def program():
        pass

    @program.command()
    def fail():
        raise error

    result = CliRunner().invoke(program, ["fail"])
    assert result.exit_code == 2
    (line,) = result.stderr.splitlines()
    assert line.startswith("knitlab: ")
    assert said in line


def test_text_of_users_is_escaped():
    assert one_line("a\x1b[31mred\x9bm\nb") == "a\\x1b[31mred\\x9bm\\x0ab"
    assert _escaped("<b>[x](y)`") == r"\<b\>\[x\](y)\`"
