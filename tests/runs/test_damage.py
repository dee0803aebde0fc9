"""Any name and any damaged byte of a results folder: the right numbers or a sentence."""

import errno
import hashlib
import json
import math
import os
import shutil
import socket
import time
from contextlib import suppress
from pathlib import Path

import click
import pytest
import xarray as xr
from click.testing import CliRunner
from hypothesis import HealthCheck, Phase, example, given, settings
from hypothesis import strategies as st
from PIL import Image

from knitlab.cli import main
from knitlab.cli.options import CommandGroup
from knitlab.cli.output import droppable_output
from knitlab.cubes.case_file import read_case
from knitlab.cubes.cube_file import open_cube, write_cube
from knitlab.cubes.query import formatted, query_cubes
from knitlab.figures.claims_page import _escaped
from knitlab.figures.explorer.explorer import write_explorer
from knitlab.io.errors import InputError
from knitlab.io.image_file import read_image
from knitlab.io.json_file import with_checksum
from knitlab.io.names import is_name
from knitlab.io.seal import LENGTH
from knitlab.io.text_file import read_text
from knitlab.runs.merge import merge_folders
from knitlab.runs.patterns import Pattern
from knitlab.runs.plan import make_plan
from knitlab.runs.results_folder import CaseState, status
from knitlab.runs.run import RunOptions, run_plan
from knitlab.runs.workers import connected
from tests.runs import stand_in

FUZZ = settings(
    deadline=None,
    derandomize=True,
    max_examples=12,
    phases=(Phase.explicit, Phase.generate),
    suppress_health_check=list(HealthCheck),
)
FEW = ("n_stripe=4", "n_subunit=16,32", "strain_max=0.06")


def ran(folder, plan=None):
    plan = plan or make_plan("periodic", FEW)
    return run_plan(plan, folder, RunOptions(simulate=stand_in.simulate))


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


@pytest.mark.parametrize("name", ["../victim", "/absolute", "", "..", "=cmd", "\x1b[31m"])
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
    for suffix in (".nc", ".sha256"):
        first, second = one.with_suffix(suffix), other.with_suffix(suffix)
        texts = first.read_bytes(), second.read_bytes()
        own, others = (path.name.encode() for path in (one, other))
        first.write_bytes(texts[1].replace(others, own))
        second.write_bytes(texts[0].replace(own, others))
    (folder / "cube.nc").unlink()
    run = ran(folder)
    assert set(run.states_before.values()) == {CaseState.damaged}
    xr.testing.assert_identical(numbers(run.cube), numbers(undamaged[1]))


@pytest.mark.parametrize("dims", [("n_stripe",), ("n_stripe", "n_subunit"), ("foreign",)])
def test_variables_of_other_programs_are_left_out(folder, undamaged, dims, tmp_path):
    cube = open_cube(folder)
    sizes = [cube.sizes.get(dim, 3) for dim in dims]
    foreign = xr.DataArray(range(sizes[0]), dims=dims[:1]).expand_dims(
        dict(zip(dims[1:], sizes[1:], strict=True))
    )
    cube = cube.assign(mine=foreign)
    cube.to_netcdf(tmp_path / "other.nc")
    shutil.copy(tmp_path / "other.nc", folder / "cube.nc")
    for run in (ran(folder).cube, merge_folders([folder], tmp_path / "merged").cube):
        xr.testing.assert_identical(numbers(run), numbers(undamaged[1]))


@pytest.mark.parametrize(
    "change",
    [
        {"cases": None},
        {"workflow": None},
        {"dims": 3},
        {"dims": []},
        {"inputs": [1]},
        {"excluded": [None]},
        {"gauge": {}},
        {"figures": None},
        {"overrides": [1]},
        {"cases": {"a": [1]}},
        {"cases": {"a": {"design": None}}},
    ],
)
def test_a_plan_of_another_schema_is_a_sentence(folder, change, tmp_path):
    record = json.loads((folder / "plan.json").read_text()) | change
    text = json.dumps(record, indent=1) + "\n"
    (folder / "plan.json").write_text(with_checksum(text))
    for read in (
        lambda: status("periodic", results=tmp_path),
        lambda: merge_folders([folder], tmp_path / "merged"),
    ):
        with pytest.raises(InputError, match=r"plan\.json: is not a plan"):
            read()
    assert not ran(folder).failures


@pytest.mark.parametrize("text", ["[" * 100_000, "9" * 5000, '{"a": ' * 5000])
def test_a_plan_without_end_is_a_sentence(folder, tmp_path, text):
    (folder / "plan.json").write_text(text)
    with pytest.raises(InputError, match=r"plan\.json: is not a plan"):
        status("periodic", results=tmp_path)


@pytest.mark.parametrize(
    "line", ["[null]", "null", '{"case_id": 5}', '"x"', '{"failures": [null]}']
)
def test_a_foreign_line_among_the_failures_is_ignored(folder, line, undamaged):
    (folder / "failures.jsonl").write_text(line + "\n")
    xr.testing.assert_identical(numbers(ran(folder).cube), numbers(undamaged[1]))


def test_a_cube_of_an_unknown_status_is_built_again(folder, undamaged):
    cube = xr.load_dataset(folder / "cube.nc")
    cube["status"][0, 0] = 99
    write_cube(cube, folder / "cube.nc")
    with pytest.raises(InputError, match="unknown status 99"):
        open_cube(folder)
    run = ran(folder)
    xr.testing.assert_identical(numbers(run.cube), numbers(undamaged[1]))
    (said,) = run.remarks(run.cube["status"].dims, folder)
    assert "cube.nc was not as it had been written; it is kept as cube-damaged.nc" in said


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda cube: cube.drop_vars("applied_strain"), "no applied_strain that tells"),
        (lambda cube: cube.isel(applied_strain=1), "no applied_strain that tells"),
        (lambda cube: cube.assign(poisson_ratio=("odd", [1.0])), "poisson_ratio along odd"),
        (lambda cube: cube.assign_coords(n_subunit=[16.0, math.nan]), "no n_subunit that tells"),
        (lambda cube: cube.assign_coords(n_subunit=[16, 16]), "no n_subunit that tells"),
        (lambda cube: cube.assign_coords(applied_strain=[*"abc"]), "applied_strain that is no"),
        (lambda cube: cube.assign(status=cube["status"].astype(str)), "status of the type"),
        (lambda cube: cube.assign(code=cube["periods"]), "code of the type"),
        (lambda cube: cube.assign_attrs(gauge_stitch_width="x"), "gauge_stitch_width that is no"),
        (lambda cube: with_unit(cube, "poisson_ratio", 5), "poisson_ratio whose unit"),
    ],
)
def test_a_cube_of_another_form_is_a_sentence_and_built_again(folder, undamaged, change, problem):
    cube = change(xr.load_dataset(folder / "cube.nc"))
    cube.to_netcdf(folder / "cube.nc")
    with pytest.raises(InputError, match=problem):
        open_cube(folder)
    xr.testing.assert_identical(numbers(ran(folder).cube), numbers(undamaged[1]))


def with_unit(cube, name, unit):
    cube[name].attrs["units"] = unit
    return cube


def test_a_cube_without_the_name_of_its_workflow_is_merged_as_its_folder(folder, tmp_path):
    (folder / "plan.json").unlink()
    cube = xr.load_dataset(folder / "cube.nc")
    del cube.attrs["workflow"]
    cube.to_netcdf(folder / "cube.nc")
    assert merge_folders([folder], tmp_path / "merged").folder.name == "periodic"


def test_a_cube_without_unit_cells_is_of_another_version(folder, tmp_path):
    xr.load_dataset(folder / "cube.nc").drop_vars("unit_cells_x").to_netcdf(folder / "cube.nc")
    for use in (ran, lambda folder: merge_folders([folder], tmp_path / "merged")):
        with pytest.raises(InputError, match=r"cube\.nc: is of another version of knitlab"):
            use(folder)


@pytest.mark.parametrize("sealed", [True, False])
def test_a_damaged_name_of_an_attribute_is_a_sentence(folder, undamaged, sealed):
    contents = (folder / "cube.nc").read_bytes()
    contents = contents if sealed else contents[:-LENGTH]
    (folder / "cube.nc").write_bytes(contents.replace(b"workflow", b"workfloh"))
    with pytest.raises(InputError, match="a damaged one"):
        open_cube(folder)
    xr.testing.assert_identical(numbers(ran(folder).cube), numbers(undamaged[1]))


def test_a_csv_has_no_formulas(folder):
    cube = open_cube(folder)
    cube["case_id"][0, 0] = "=cmd|' /C calc'!A0"
    text = formatted(query_cubes([cube], columns=["case_id", "poisson_ratio_min"]), "csv")
    assert "\n'=cmd" in text or "\n\"'=cmd" in text


def test_a_file_that_never_ends_is_a_sentence(folder, tmp_path):
    case = next((folder / "cases").glob("4-16-*.nc"))
    for path in (case, case.with_suffix(".sha256"), folder / "plan.json", folder / "cube.nc"):
        path.unlink()
        os.mkfifo(path)
        with suppress(InputError):
            status("periodic", results=tmp_path, check=True)
        path.unlink()
    holder = folder / ".lock.holder"
    holder.unlink()
    os.mkfifo(holder)
    assert not ran(folder).failures


MANY = [1 + k / 1000 for k in range(1000)]


@pytest.mark.parametrize(
    ("overrides", "problem"),
    [
        ({"unit_cells": [1_000_000, 1_000_000]}, "makes a grid of"),
        ({"unit_cells": [10**11, 1]}, "less than or equal to 1000000"),
        ({"k_t_factor": MANY, "k_s_factor": MANY}, "asks for"),
        ({"n_stripe": [4] * 5000, "n_subunit": [16] * 5000}, "at most 300"),
        (("n_stripe=" + "9" * 5000,), "valid integer"),
        (("n_stripe=" + "[" * 5000,), "valid integer"),
        (("n_stripe=0x" + "f" * 5000,), "a number too long to show"),
        ({"further_strains": [0.1 + k / 1e5 for k in range(2000)]}, "at most 1000"),
        ({"k_t_factor": [1.0] * 1_000_000}, "has 1,000,000 values, above 100,000"),
        (("k_t_factor=" + "," * 90_000,), "^.{500,1000}valid number"),
    ],
)
def test_a_sweep_that_is_too_large_is_refused_before_it_is_expanded(overrides, problem):
    with pytest.raises(InputError, match=problem):
        make_plan("periodic", overrides)


@pytest.mark.parametrize("text", ["[" * 100_000, "title = " + "9" * 5000, "a = {" * 5000])
def test_a_workflow_that_is_too_large_is_a_sentence(tmp_path, text):
    (tmp_path / "large.toml").write_text(text)
    with pytest.raises(InputError, match="is not TOML"):
        make_plan(str(tmp_path / "large.toml"))


def test_a_file_is_too_long_or_has_its_first_faults_listed(tmp_path):
    path = tmp_path / "large.toml"
    path.write_text(f'title = "{"x" * 6_000_000}"')
    with pytest.raises(InputError, match="has more than 5,000,000 characters"):
        make_plan(str(path))
    path.write_text("".join(f"a{number} = 1\n" for number in range(20_000)))
    with pytest.raises(InputError, match="there is no setting 'a0'") as caught:
        make_plan(str(path))
    assert len(caught.value.mistakes) <= 200


def test_an_image_of_many_patches_and_a_list_of_many_columns_take_a_moment(folder, tmp_path):
    Image.new("RGB", (2000, 2000)).save(tmp_path / "map.png")
    began = time.process_time()
    rows = Pattern(image="map.png", colours={"black": "R"}).patches(tmp_path)
    assert rows == ("R" * 2000,) * 2000
    words = ["query", str(folder), "--columns", "n_stripe," * 100_000]
    said = CliRunner().invoke(main, words)
    assert said.stdout.split() == ["n_stripe", "4", "4"]
    assert time.process_time() - began < 3.0


@pytest.mark.parametrize("condition", ["abs(" * 5000, "1" * 5000 + " > 0", f"n_stripe > {10**900}"])
def test_a_condition_that_is_too_large_is_a_sentence(folder, condition):
    with pytest.raises(InputError, match=r"is too long|cannot be computed"):
        open_cube(folder).knitlab.query(condition)


@pytest.mark.parametrize(
    "setting",
    ["tolerance=0.05", "tolerance=1e-6,1e-3", "rest_force=0.05", "relative_tolerance=0.01"],
)
def test_a_loose_tolerance_is_refused(setting):
    problem = r"would change Poisson's ratio by more than 0\.001|is too coarse"
    with pytest.raises(InputError, match=problem):
        make_plan("periodic", ("n_stripe=4", setting))


@pytest.mark.parametrize(
    ("name", "damaged_name"),
    [(b"poisson_ratio", b"poisson\xefratio"), (b"applied_strain", b"applied_{train")],
    ids=["text", "dimension"],
)
def test_a_case_file_damaged_before_its_checksum_is_a_sentence(folder, name, damaged_name):
    path = next((folder / "cases").glob("*.nc"))
    damaged = path.read_bytes().replace(name, damaged_name)
    path.write_bytes(damaged)
    path.with_suffix(".sha256").write_text(f"{hashlib.sha256(damaged).hexdigest()}  {path.name}\n")
    with pytest.raises(InputError, match="is no case file"):
        read_case(folder, path.stem)


def test_a_file_name_with_a_zero_byte_is_a_sentence():
    with pytest.raises(InputError, match="zero byte in its name"):
        read_text(Path("a\0b"))


def test_an_image_of_a_format_that_is_not_read_is_a_sentence(tmp_path):
    Image.new("RGB", (32, 32)).save(tmp_path / "map.icns")
    with pytest.raises(InputError, match="save it as PNG"):
        read_image(tmp_path / "map.icns")


def test_a_mute_scheduler_is_a_sentence():
    with socket.create_server(("127.0.0.1", 0)) as mute:
        address = f"tcp://127.0.0.1:{mute.getsockname()[1]}"
        with pytest.raises(InputError, match="no dask scheduler answers"):
            connected(address)


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (MemoryError(), "this machine cannot do it: there is not enough memory"),
        (OSError(errno.EMFILE, "Too many open files"), "this machine cannot do it"),
        ("\udcff".encode, "this machine cannot do it"),
        (PermissionError(errno.EACCES, "Permission denied", "here"), "here: cannot be used (Perm"),
        (FileNotFoundError(errno.ENOENT, "No such file"), "the current folder: cannot be used"),
    ],
)
def test_what_a_machine_lacks_or_forbids_is_a_sentence(error, sentence):
    @click.group(cls=CommandGroup)
    def program():
        pass

    @program.command()
    def fail():
        if callable(error):
            error()
        raise error

    said = CliRunner().invoke(program, ["fail"])
    assert said.exit_code == 2
    assert said.stderr.startswith(f"knitlab: {sentence}")


def test_nothing_in_a_name_is_obeyed_by_a_terminal_or_a_page(capsys):
    with droppable_output():
        print("a\x1b[31mred\x9bm\tb\u202e")
    assert capsys.readouterr().out == "a\\x1b[31mred\\x9bm\tb\\u202e\n"
    assert _escaped("<b>[x](y)`") == r"\<b\>\[x\](y)\`"
