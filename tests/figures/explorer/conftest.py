"""Cubes to explore, and a browser that asks for nothing but the page."""

import json
import shutil
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from knitlab.cubes.cube_file import open_cube, write_cube
from knitlab.figures.explorer.explorer import write_explorer
from knitlab.io.shipped import PACKAGE
from knitlab.observables.status import Status

REFERENCE = PACKAGE.parent / "results" / "reference"
PREVIEW = REFERENCE / "periodic"
HOSTILE = "</script><script>document.title = 'taken'</script><img src=x onerror=alert(1)>"
CHROMIUM, DRIVER = "chromium", "chromedriver"
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


@pytest.fixture(scope="session")
def troubled(tmp_path_factory):
    """The preview with a design that failed, one that ended early, one pending, one folded through.

    Texts of it are hostile.
    """
    folder = tmp_path_factory.mktemp("troubled") / "troubled"
    shutil.copytree(PREVIEW / "cases", folder / "cases")
    cube = open_cube(PREVIEW)
    cube.attrs["title"] = HOSTILE
    cube["poisson_ratio"].attrs["description"] = HOSTILE
    strains = cube["applied_strain"].values

    def spoil(design, status, first):
        cube["status"].loc[design] = status
        for name, variable in cube.data_vars.items():
            if variable.dtype.kind == "f" and "applied_strain" in variable.dims:
                cube[name].loc[design | {"applied_strain": slice(first, None)}] = np.nan

    failed = {"n_stripe": 6, "n_subunit": 48}
    spoil(failed, Status.failed, 0)
    spoil({"n_stripe": 4, "n_subunit": 24}, Status.not_converged, 0.2)
    spoil({"n_stripe": 8, "n_subunit": 32}, Status.pending, 0)
    through = {"n_stripe": 8, "n_subunit": 64}
    cube["self_intersections"].loc[through | {"applied_strain": strains[2]}] = 17
    snapped = {"n_stripe": 6, "n_subunit": 36}
    cube["snapped"].loc[snapped | {"applied_strain": strains[6]}] = 1
    entry = {"case_id": cube["case_id"].sel(failed).item(), "status": "failed", "reason": HOSTILE}
    entry |= {"case": {"method": "equilibrium"}}
    (folder / "failures.jsonl").write_text(json.dumps(entry) + "\n")
    write_cube(cube, folder / "cube.nc")
    return folder


@pytest.fixture(scope="session")
def page(tmp_path_factory):
    """The explorer of the preview, of which two designs have their shapes."""
    return write_explorer([open_cube(PREVIEW)], tmp_path_factory.mktemp("page") / "explorer.html")


@pytest.fixture(scope="session")
def troubled_page(troubled, tmp_path_factory):
    return write_explorer([open_cube(troubled)], tmp_path_factory.mktemp("page") / "troubled.html")


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with started(tmp_path_factory.mktemp("browser")) as driver:
        yield driver


@contextmanager
def started(profile: Path, *flags: str):
    """A headless browser with a new profile; skips the test where there is none."""
    paths = [shutil.which(name) for name in (CHROMIUM, DRIVER)]
    if None in paths:
        pytest.skip("Chromium and its driver are not installed (Debian: chromium, chromium-driver)")
    webdriver = pytest.importorskip("selenium.webdriver", reason="Selenium is not installed")
    options = webdriver.ChromeOptions()
    options.binary_location = paths[0]
    for flag in (*FLAGS, *flags, f"--user-data-dir={profile}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options, webdriver.ChromeService(paths[1]))
    driver.set_window_size(1400, 1000)
    try:
        yield driver
    finally:
        driver.quit()
