"""Export of shapes: from a cube, from a test, and what is refused."""

import shutil

import numpy as np
import pytest
import xarray as xr

import knitlab as kl
from knitlab.cubes.case_file import case_path, read_case, write_case_file
from knitlab.io.errors import InputError
from knitlab.observables.status import Status
from tests.commands import knitlab
from tests.export.meshes.synthetic import CASE_ID, PREVIEW, kept_file, vtu_arrays

ONE = {"n_stripe": 4, "n_subunit": 16}


@pytest.fixture
def results(tmp_path):
    """A copy of the kept results of a workflow, to damage."""
    shutil.copytree(PREVIEW, tmp_path / "periodic", ignore=shutil.ignore_patterns("figures"))
    return tmp_path / "periodic"


def in_cloth(lengths):
    """Lengths of the network of (4, 16), scaled by the root of the areas of a unit cell."""
    cube = kl.open_cube(PREVIEW).sel(ONE)
    areas = [float(cube[f"{kind}_cell_x"] * cube[f"{kind}_cell_y"]) for kind in ("knit", "relaxed")]
    return np.sqrt(areas[0] / areas[1]) * lengths


def test_a_cube_its_path_its_file_and_a_test_give_one_mesh(tmp_path):
    sources = [PREVIEW, str(PREVIEW / "cube.nc"), kl.open_cube(PREVIEW)]
    exported = [kl.export(each, tmp_path / "a.vtu", **ONE, applied_strain=0.15) for each in sources]
    for each in exported:
        assert each.files == (tmp_path / "a.vtu",)
        assert each.applied_strain == (0.15,)
        assert each.unit == "mm"
        assert (each.meshes[0].nodes == exported[0].meshes[0].nodes).all()
    # A case file alone has no gauge.
    of_file = kl.export(kept_file(), tmp_path / "b.vtu", applied_strain=0.15)
    assert of_file.unit == "mm of network"
    np.testing.assert_allclose(in_cloth(of_file.meshes[0].nodes), exported[0].meshes[0].nodes)
    assert (vtu_arrays(tmp_path / "a.vtu")["Points", "Points"] == exported[0].meshes[0].nodes).all()


def test_without_a_strain_the_shape_is_relaxed(tmp_path):
    exported = kl.export(PREVIEW, tmp_path / "a.obj", **ONE)
    assert exported.applied_strain == (0.0,)
    relaxed = in_cloth(kept_file()["position"].values[0].reshape(-1, 3))
    assert set(map(tuple, relaxed)) <= set(map(tuple, exported.meshes[0].nodes))


def test_a_series_has_the_selected_strains_or_all(tmp_path):
    some = kl.export(PREVIEW, tmp_path / "a.pvd", **ONE, applied_strain=[0, 0.3], triangles=True)
    assert [path.name for path in some.files] == ["a.pvd", "strain_0.vtu", "strain_0.3.vtu"]
    assert (vtu_arrays(some.files[2])["Cells", "types"] == 5).all()  # VTK_TRIANGLE
    every = kl.export(PREVIEW, tmp_path / "b.pvd", **ONE)
    assert every.applied_strain == tuple(kept_file()["applied_strain"].values)


@pytest.mark.parametrize(
    ("name", "selections", "options", "words"),
    [
        ("a.dae", ONE, {}, ["a.dae", ".vtu", ".pvd"]),
        ("a", ONE, {}, [".vtu"]),
        ("a.vtu", {}, {}, ["10 designs", "n_stripe of 2, 4, 6, 8"]),
        ("a.vtu", {"n_stripe": 4}, {}, ["3 designs", "n_subunit of 16, 24, 32"]),
        ("a.vtu", {"n_stripe": 4, "n_subunit": 64}, {}, ["no design"]),
        ("a.vtu", {"yarn": 1}, {}, ["yarn", "n_stripe"]),
        ("a.vtu", {"n_stripe": 4, "n_subunit": 24}, {}, ["n_subunit = 24", "run"]),
        ("a.vtu", ONE | {"applied_strain": 0.17}, {}, ["applied_strain = 0.17"]),
        ("a.vtu", ONE | {"applied_strain": [0, 0.3]}, {}, ["0, 0.3", ".pvd"]),
        ("a.stl", ONE, {"thickness": 0.0}, ["thickness 0", "0 mm"]),
        ("a.stl", ONE, {"thickness": 3.0}, ["thickness 3", "at most 1.3 mm"]),
        ("a.stl", ONE, {"repeats": (0, 1)}, ["repeats 0 1", "1 or more"]),
    ],
)
def test_what_cannot_be_exported_is_one_mistake_and_writes_nothing(
    tmp_path, name, selections, options, words
):
    with pytest.raises(InputError) as refused:
        kl.export(PREVIEW, tmp_path / name, **options, **selections)
    (mistake,) = refused.value.mistakes
    assert not [word for word in words if word not in str(mistake)]
    assert not [*tmp_path.iterdir()]


def change_cube(results, **values):
    cube = xr.load_dataset(results / "cube.nc")
    for name, value in values.items():
        cube[name].loc[ONE] = value
    cube.to_netcdf(results / "cube.nc")


def test_a_design_that_failed_or_has_not_run_is_named(results, tmp_path):
    case_path(results, CASE_ID).unlink()
    for status, message in (
        (Status.failed, "n_stripe = 4, n_subunit = 16: failed"),
        (Status.pending, "run it"),
    ):
        change_cube(results, status=status)
        with pytest.raises(InputError, match=message):
            kl.export(results, tmp_path / "a.vtu", **ONE)


def test_a_damaged_case_file_is_not_read(results, tmp_path):
    path = case_path(results, CASE_ID)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(InputError, match=rf"{CASE_ID}.nc: .*damaged.*run"):
        kl.export(results, tmp_path / "a.vtu", **ONE)


def test_a_design_that_did_not_reach_its_last_strains_is_exported_up_to_there(results, tmp_path):
    case = read_case(results, CASE_ID)
    case["position"][10:] = np.nan
    write_case_file(results, CASE_ID, case.assign_attrs(reason="no equilibrium at 0.3"))
    change_cube(results, status=Status.not_converged)
    with pytest.raises(InputError, match=r"applied_strain 0.36.*no equilibrium at 0.3.*0.27"):
        kl.export(results, tmp_path / "a.vtu", **ONE, applied_strain=0.36)
    exported = kl.export(results, tmp_path / "a.pvd", **ONE)
    assert exported.applied_strain[-1] == 0.27
    case["position"][:] = np.nan
    with pytest.raises(InputError, match="no shape"):
        kl.export(case, tmp_path / "b.vtu")


def test_a_cube_in_memory_and_a_test_say_what_they_take(tmp_path):
    cube = kl.open_cube(PREVIEW).copy()
    with pytest.raises(InputError, match=r"swatch.*measured"):
        kl.export(cube.assign_coords(source="swatch"), tmp_path / "a.vtu", **ONE)
    cube.encoding.clear()
    with pytest.raises(InputError, match="give its path"):
        kl.export(cube, tmp_path / "a.vtu", **ONE)
    with pytest.raises(InputError, match="cube"):
        kl.export(xr.Dataset(), tmp_path / "a.vtu", **ONE)
    with pytest.raises(InputError, match=r"n_stripe.*applied_strain"):
        kl.export(kept_file(), tmp_path / "a.vtu", **ONE)


DESIGN = ("--select", "n_stripe=4", "--select", "n_subunit=16")


def test_the_command_says_what_it_wrote(tmp_path):
    output = tmp_path / "shape.glb"
    said = knitlab("export", PREVIEW, *DESIGN, "--repeats", "2x3", "-o", output)
    assert said.exit_code == 0, said.output
    first, last = said.output.splitlines()
    assert first.startswith("applied_strain 0: 1617 nodes, 3072 triangles, ")
    assert first.endswith(" mm")
    assert last == f"mesh    {output}"


@pytest.mark.slow
def test_the_command_says_how_often_a_fabric_passes_through_itself(tmp_path):
    folded = {"contact": "none", "strain_max": 0.03, "robustness": 0}
    cube = kl.run("periodic", **ONE, **folded, results=tmp_path)
    crossing = int(cube["self_intersections"].squeeze().sel(applied_strain=0).item())
    assert crossing > 0
    said = knitlab("export", tmp_path / "periodic", *DESIGN, "-o", tmp_path / "shape.glb")
    assert said.exit_code == 0, said.output
    assert f"{crossing} pairs" in said.output.splitlines()[0]
