"""Cubes that xarray or another program has changed: the same designs, or what is missing."""

from importlib import import_module

import numpy as np
import pandas as pd
import pint
import pytest
import xarray as xr
from click.testing import CliRunner

import knitlab as kl
from knitlab.cli import main
from knitlab.cubes import cube_file
from knitlab.cubes.cube_file import read_cube
from knitlab.cubes.normalised import NoCube, normalised
from knitlab.observables.status import Status
from tests.cubes.artificial_cubes import STATUS, synthetic_cube
from tests.export.meshes.synthetic import PREVIEW, kept_file
from tests.refusals import refused

DESIGNS = ["n_stripe", "n_subunit"]
WIDTHS = [16.0, 32.0, 64.0]


def base():
    cube = synthetic_cube()
    return normalised(cube.assign(reaction_force=2 * cube["mean_strain_yy"].drop_attrs()))


def halves(cube):
    return cube.isel(n_stripe=[0]), cube.isel(n_stripe=[1, 2])


def merged(cube):
    return xr.merge(halves(cube), join="outer", compat="no_conflicts")


def quantified(cube, **units):
    """The cube as pint-xarray has it, its coordinates included, in some other units."""
    registry = pint.UnitRegistry()

    def quantity(name, variable):
        unit = variable.attrs["units"]
        values = registry.Quantity(variable.values, "" if unit == "1" else unit)
        others = {key: each for key, each in variable.attrs.items() if key != "units"}
        return variable.dims, values.to(units[name]) if name in units else values, others

    numbers = [name for name in cube.data_vars if name not in ("case_id", "status")]
    return cube.assign({name: quantity(name, cube[name]) for name in numbers})


def filled(cube):
    """Integers as programs write them that have no missing ones."""
    periods = cube["periods"].fillna(-2147483647).astype("int32")
    status = cube["status"].astype("int16")
    return cube.assign(
        periods=periods, status=status.where(status != Status.excluded, np.int16(-32767))
    )


def as_objects(cube):
    return cube.assign_coords({dim: cube[dim].values.astype(object) for dim in cube.dims})


WITHOUT_LOSS = {
    "merged": merged,
    "concatenated": lambda cube: xr.concat(halves(cube), "n_stripe"),
    "concatenated from single values": lambda cube: xr.concat(
        [cube.isel(n_stripe=k) for k in range(3)], "n_stripe"
    ),
    "joined strains": lambda cube: xr.concat(
        [cube.isel(applied_strain=[0]), cube.isel(applied_strain=[1, 2])],
        "applied_strain",
        data_vars="all",
    ),
    "masked": lambda cube: cube.where(cube["status"] != Status.excluded),
    "masked along strain": lambda cube: cube.where(cube["applied_strain"] >= 0),
    "transposed": lambda cube: cube.transpose(*reversed([*cube.dims])),
    "reversed": lambda cube: cube.isel({dim: slice(None, None, -1) for dim in cube.dims}),
    "stacked": lambda cube: cube.stack(design=DESIGNS),
    "stacked, planned only": lambda cube: cube.stack(design=DESIGNS).isel(
        design=cube["status"].values.ravel() != Status.excluded
    ),
    "stacked without index": lambda cube: cube.stack(design=DESIGNS).reset_index("design"),
    "stacked with strain": lambda cube: cube.stack(row=[*DESIGNS, "applied_strain"]),
    "in chunks": lambda cube: cube.chunk({"n_stripe": 1}),
    "masked in chunks": lambda cube: cube.chunk({"n_stripe": 1}).where(cube["status"] != 4),
    "quantified": quantified,
    "quantified in chunks": lambda cube: quantified(cube).chunk({"n_stripe": 1}),
    "float labels": lambda cube: cube.assign_coords(n_subunit=WIDTHS),
    "objects": as_objects,
    "strains of 32 bits": lambda cube: cube.assign_coords(
        applied_strain=cube["applied_strain"].values.astype("float32")
    ),
    "without attributes": lambda cube: cube.drop_attrs(),
    "variables as coordinates": lambda cube: cube.set_coords(["periods", "case_id"]),
    "filled integers": filled,
    "status as float": lambda cube: cube.assign(status=cube["status"].astype(float)),
    "status by name": lambda cube: cube.assign(
        status=(DESIGNS, np.array([each.name for each in Status], object)[cube["status"].values])
    ),
    "case_id in bytes": lambda cube: cube.assign(case_id=cube["case_id"].astype("S")),
}


@pytest.mark.parametrize("change", WITHOUT_LOSS)
def test_what_xarray_makes_of_a_cube_has_the_same_designs(change):
    cube = base()
    read = normalised(WITHOUT_LOSS[change](cube))
    planned = cube["status"] != Status.excluded
    xr.testing.assert_equal(read.where(planned), cube.where(planned))
    for name in cube.variables:
        assert read[name].dims == cube[name].dims
        assert read[name].dtype.kind == cube[name].dtype.kind or name == "case_id"
        if name in ("periods", "poisson_ratio", "reaction_force"):
            assert read[name].attrs == cube[name].attrs


def test_a_kept_cube_is_as_it_was_and_not_changed():
    cube = read_cube(PREVIEW)
    before = cube.copy(deep=True)
    xr.testing.assert_identical(normalised(cube), before)
    kl.query(merged(cube))
    xr.testing.assert_identical(cube, before)
    assert normalised(cube).encoding["source"] == cube.encoding["source"]


def test_two_cubes_that_are_merged_have_their_two_designs(tmp_path):
    cube = base()
    two = [cube.sel(n_stripe=[2], n_subunit=[16]), cube.sel(n_stripe=[4], n_subunit=[32])]
    both = xr.merge(two, join="outer", compat="no_conflicts", combine_attrs="drop_conflicts")
    both.to_netcdf(tmp_path / "both.nc", engine="netcdf4")
    for each in (both, tmp_path / "both.nc"):
        table = kl.query(each)
        assert table[[*DESIGNS, "status"]].values.tolist() == [[2, 16, "ok"], [4, 32, "ok"]]
    for kind in ("auxetic", "curves", "grid"):
        assert getattr(kl.plot, kind)(both).axes


@pytest.mark.parametrize(
    "selected",
    [{"n_stripe": 4}, {"n_subunit": 16}, {"n_stripe": 4, "n_subunit": 16}, {"applied_strain": 0.1}],
)
def test_a_single_value_counts_as_a_list_of_one(selected):
    cube = base()
    one = cube.sel(selected)
    kept = cube.sel({dim: [value] for dim, value in selected.items()})
    xr.testing.assert_identical(normalised(one), normalised(kept))
    pd.testing.assert_frame_equal(one.knitlab.query(), kept.knitlab.query())
    for kind in ("auxetic", "curves", "grid"):
        assert len(getattr(kl.plot, kind)(one).axes) == len(getattr(kl.plot, kind)(kept).axes)


def test_a_squeezed_design_is_a_cube_and_a_simulated_one_stays_a_test():
    one = base().isel(n_stripe=[1], n_subunit=[0]).squeeze()
    assert kl.query(one)[DESIGNS].values.tolist() == [[4, 16]]
    case = kept_file()
    assert normalised(case)["status"].dims == ()
    both = [case.drop_vars("position"), case.drop_vars("position").assign_coords(n_subunit=99)]
    assert len(kl.query(xr.concat(both, "n_subunit"))) == 2


def test_a_mask_leaves_the_designs_for_which_it_holds():
    cube = base()
    low = kl.query(cube.where(cube["poisson_ratio_min"] < -0.3))
    assert low[DESIGNS].values.tolist() == [[4, 16], [4, 32]]
    early = cube.where(cube["applied_strain"] < 0.15, drop=True)
    assert len(kl.query(early)) == sum(each is not Status.excluded for each in STATUS.values())
    assert early.knitlab.query(applied_strain=0.1)["poisson_ratio"].min() == -0.8


@pytest.mark.parametrize("labels", [[6.0, 3.0], None])
def test_joined_along_something_new_it_is_a_swept_setting(labels):
    index = "z_max" if labels is None else pd.Index(labels, name="z_max", dtype=object)
    table = kl.query(xr.concat([base(), base()], index))
    assert table["z_max"].unique().tolist() == (labels or [0, 1])
    assert len(table) == 2 * len(kl.query(base()))


@pytest.mark.parametrize("attribute", [False, True])
def test_numbers_are_in_the_units_of_the_schema(attribute):
    cube = base()
    changed = quantified(cube, reaction_force="cN", applied_strain_at_min="percent")
    if attribute:
        values = 100 * cube["reaction_force"]
        changed = cube.assign(reaction_force=values.assign_attrs(units="cN"))
    read = normalised(changed)
    xr.testing.assert_allclose(read, cube)
    assert read["reaction_force"].attrs["units"] == "N"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda cube: cube.drop_vars("status"), ["status", "tables", "keep"]),
        (lambda cube: cube["poisson_ratio"], ["poisson_ratio", "alone", "dataset"]),
        (lambda cube: cube.to_dataframe(), ["DataFrame", "results folder"]),
        (lambda cube: 5, ["int", "file"]),
        (lambda cube: cube.isel(n_stripe=0, drop=True), ["n_stripe", "drop=True"]),
        (lambda cube: cube.mean("n_stripe"), ["n_stripe", "n_stripe=[4]"]),
        (lambda cube: cube.drop_vars("n_stripe"), ["n_stripe", "coordinate"]),
        (lambda cube: cube.drop_vars("applied_strain"), ["applied_strain", "coordinate"]),
        (lambda cube: cube.assign_coords(n_stripe=[2, 4.5, 8]), ["n_stripe", "4.5"]),
        (lambda cube: xr.concat([cube, cube], "n_stripe"), ["n_stripe = 2", "keep one"]),
        (lambda cube: cube.assign(status=9 + cube["status"]), ["status", "9, 10", "another"]),
        (lambda cube: with_unit(cube, "mm"), ["reaction_force", "mm", "as N"]),
        (lambda cube: with_unit(cube, "bananas"), ["reaction_force", "bananas", "as N"]),
        (lambda cube: with_unit(cube, 5), ["reaction_force", "5", "as N"]),
        (lambda cube: cube.assign(periods=cube["case_id"]), ["periods", "numbers"]),
        (lambda cube: cube.assign(case_id=cube["periods"]), ["case_id", "float64"]),
        (lambda cube: cube.assign(periods=("odd", [1.0])), ["periods", "odd"]),
        (lambda cube: cube.assign(periods=cube["poisson_ratio"]), ["periods", "applied_strain"]),
    ],
)
def test_what_is_no_cube_names_what_is_wrong(change, words):
    changed = change(base())
    with refused("cube", *words, error=NoCube):
        kl.query(changed)


def test_experiments_along_their_source_are_one_at_a_time():
    one = base().assign_coords(source="first")
    alone = xr.concat([one], pd.Index(["first"], name="source"))
    assert normalised(alone)["source"].item() == "first"
    assert normalised(alone)["status"].dims == ("n_stripe", "n_subunit")
    both = xr.concat([one.drop_vars("source")] * 2, pd.Index(["first", "second"], name="source"))
    with refused("cube", "first, second", "each"):
        kl.query(both)


@pytest.mark.parametrize("dropped", ["reaction_force", "unit_cells_x", "unit_cells_y"])
def test_what_would_follow_from_a_lacking_variable_is_left_out(dropped):
    cube = base()
    cells = {f"{name}_{side}": 2.0 for name in ("knit_cell", "unit_cells") for side in "xy"}
    cube = normalised(cube.assign(cells))
    cube["reaction_force_unloading"] = cube["reaction_force"] / 2
    cube["load_direction"] = 0 * cube["status"]
    assert {"force_per_width", "energy_recovery"} <= {*cube.knitlab.query(applied_strain=0.1)}
    table = cube.drop_vars(dropped).knitlab.query(applied_strain=0.1)
    assert not {"force_per_width", "force_ratio"} & {*table}


@pytest.mark.parametrize("name", ["status", "case_id"])
def test_a_target_is_a_number(name):
    with refused(name, "number", "give"):
        kl.find(base(), targets=f"{name} = 1")


def with_unit(cube, unit):
    return cube.assign(reaction_force=cube["reaction_force"].assign_attrs(units=unit))


def test_the_grid_of_many_stacked_designs_is_limited():
    many = np.arange(2000)
    labels = pd.MultiIndex.from_arrays([many, many], names=DESIGNS)
    coordinates = xr.Coordinates.from_pandas_multiindex(labels, "design")
    cube = xr.Dataset({"status": ("design", np.ones(2000, np.int8))}, coordinates)
    with refused("4e+06 designs", "n_stripe", "fewer"):
        kl.query(cube)


@pytest.mark.parametrize(
    ("use", "missing"),
    [
        (lambda cube: kl.plot.auxetic(cube.drop_vars("applied_strain_at_min")), "at_min"),
        (lambda cube: kl.plot.auxetic(cube[["status", "poisson_ratio_min"]]), "applied_strain"),
        (lambda cube: kl.plot.shape(cube.drop_vars("case_id")), "case_id"),
        (lambda cube: kl.explore(cube.drop_vars("case_id"), output="page.html"), "case_id"),
        (lambda cube: kl.export(cube.drop_vars("case_id"), "shape.vtu"), "case_id"),
    ],
)
def test_the_variable_that_a_figure_or_a_shape_needs_is_named(use, missing):
    with refused(missing, "need", "keep it"):
        use(base())


@pytest.mark.parametrize("use", [kl.plot.shape, lambda cube: kl.export(cube, "shape.vtu")])
def test_shapes_are_not_sought_in_the_current_folder(use):
    with refused("cube", "not opened from a file", "path"):
        use(base())


def test_subsets_have_tables_and_figures_of_what_they_hold(tmp_path):
    subset = base()[["status", "poisson_ratio"]]
    subset.to_netcdf(tmp_path / "subset.nc", engine="netcdf4")
    for each in (subset, tmp_path / "subset.nc"):
        assert kl.query(each, applied_strain=0.1)["poisson_ratio"].min() == -0.8
        assert kl.plot.curves(each).axes
    subset.drop_vars("status").to_netcdf(tmp_path / "none.nc", engine="netcdf4")
    with refused("none.nc", "no status", "keep it"):
        kl.query(tmp_path / "none.nc")


def test_a_file_that_another_program_wrote_has_the_same_designs(tmp_path):
    cube = base()
    filled(cube).to_netcdf(tmp_path / "filled.nc", engine="netcdf4")
    cube.to_netcdf(tmp_path / "classic.nc", engine="scipy")
    for name in ("filled", "classic"):
        pd.testing.assert_frame_equal(kl.query(tmp_path / f"{name}.nc"), kl.query(cube))


@pytest.mark.parametrize("error", [AttributeError, TypeError, RuntimeError, ImportError])
def test_a_library_that_cannot_be_imported_is_no_damage(tmp_path, monkeypatch, error):
    (tmp_path / "broken_library.py").write_text(f"raise {error.__name__}('of another version')")
    monkeypatch.syspath_prepend(tmp_path)
    base().to_netcdf(tmp_path / "cube.nc", engine="netcdf4")

    def open_dataset(*given, **named):
        return import_module("broken_library")

    monkeypatch.setattr(cube_file.xr, "open_dataset", open_dataset)
    with refused("broken_library", "another version", "install", error=ImportError):
        kl.open_cube(tmp_path / "cube.nc")
    result = CliRunner().invoke(main, ["query", str(tmp_path)])
    assert result.exit_code == 2
    assert "knitlab: broken_library: cannot be imported" in result.stderr
