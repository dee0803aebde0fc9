"""The paper's designs at 31 strains: how large the page is, and how long a browser unpacks it."""

import shutil

import numpy as np
import pytest
import xarray as xr
from scipy.ndimage import zoom

from knitlab.cubes.case_file import write_case_file
from knitlab.cubes.cube_file import open_cube, write_cube
from knitlab.figures.explorer.explorer import write_explorer
from knitlab.observables.schema import Status
from tests.figures.explorer.conftest import PREVIEW, started
from tests.figures.explorer.test_browser import Page

pytestmark = pytest.mark.slow
DESIGNS = {2: range(4, 9), 4: range(2, 7), 6: range(2, 7), 8: range(2, 7)}
"""Periods of the paper's designs, by n_stripe."""
STRAINS = np.linspace(0, 0.45, 31)
LARGEST_PAGE = 5e6
LONGEST_MS = 2000
UNPACK = """
const done = arguments[0];
const { cubes } = JSON.parse(document.getElementById("content").textContent);
import("explorer/positions").then(async ({ positionsOf }) => {
  const start = performance.now();
  let numbers = 0;
  for (const { shape } of cubes[0].designs) {
    const frames = await positionsOf(shape);
    numbers += frames.length * frames[0].length;
  }
  done([numbers, performance.now() - start]);
});
"""


def enlarged(case, nodes, rng):
    """A case of another size, rougher along the strain than a simulated one by a level."""
    coarse = case["position"].interp(applied_strain=STRAINS).values
    factor = nodes / coarse.shape[1]
    fine = zoom(coarse, (1, factor, factor, 1), order=1)
    fine += rng.normal(size=fine.shape) * np.ptp(fine, axis=(0, 1, 2)) / 4095
    rest = case.drop_vars("position").interp(applied_strain=STRAINS)
    rest["position"] = ("applied_strain", "node_y", "node_x", "component"), fine
    rest.attrs = case.attrs
    return rest


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("large") / "large"
    with xr.open_dataset(next((PREVIEW / "cases").glob("8-64-*.nc"))) as opened:
        case = opened.load()
    rng = np.random.default_rng(1)
    labels = sorted({2 * n * p for n, periods in DESIGNS.items() for p in periods})
    numbers = open_cube(PREVIEW).drop_vars(["boundary_x", "boundary_y"])
    text = {"case_id": "", "code": "", "status": Status.excluded}
    fill = {name: text.get(name, np.nan) for name in numbers.data_vars}
    cube = numbers.interp(applied_strain=STRAINS).reindex(n_subunit=labels, fill_value=fill)
    for n_stripe, periods in DESIGNS.items():
        for p in periods:
            design = {"n_stripe": n_stripe, "n_subunit": 2 * n_stripe * p}
            case_id = f"{n_stripe}-{2 * n_stripe * p}"
            record = case.attrs["parameters"].replace('"periods": 4', f'"periods": {p}')
            one = enlarged(case.assign_attrs(parameters=record), 8 * p, rng)
            write_case_file(folder, case_id, one.assign(case_id=case_id))
            cube["case_id"].loc[design] = case_id
            cube["status"].loc[design] = Status.ok
            for name, variable in cube.data_vars.items():
                if variable.dims[:2] == ("n_stripe", "n_subunit") and variable.dtype.kind == "f":
                    shape = variable.sel(design).shape
                    cube[name].loc[design] = rng.normal(size=shape)
    shutil.copytree(PREVIEW / "figures", folder / "figures")
    write_cube(cube, folder / "cube.nc")
    return folder


def test_twenty_designs_at_31_strains_fit_five_megabytes(folder, tmp_path):
    page = write_explorer([open_cube(folder)], tmp_path / "explorer.html")
    assert 1e6 < page.stat().st_size < LARGEST_PAGE
    with started(tmp_path / "profile") as driver:
        opened = Page(driver, page)
        numbers, milliseconds = driver.execute_async_script(UNPACK)
        nodes = sum((8 * p) ** 2 for periods in DESIGNS.values() for p in periods)
        assert numbers == nodes * len(STRAINS) * 3
        assert milliseconds < LONGEST_MS
        assert opened.is_quiet()
