"""The installed wheel: only the package, with its input files."""

import subprocess
import sys
import zipfile

import pytest

from knitlab.io.shipped import PACKAGE

pytestmark = pytest.mark.slow
ROOT = PACKAGE.parent


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """Names of what the wheel installs."""
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "pip", "wheel", "--no-deps", "-w", str(folder), str(ROOT)]
    subprocess.run(command, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    return zipfile.ZipFile(wheel).namelist()


def test_the_wheel_installs_one_package(installed):
    tops = {name.split("/")[0] for name in installed}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"knitlab"}


def test_the_wheel_holds_every_module_every_input_and_py_typed(installed):
    modules = {file.relative_to(ROOT).as_posix() for file in PACKAGE.rglob("*.py")}
    inputs = {
        f"knitlab/shipped/{file.relative_to(ROOT).as_posix()}"
        for folder in ("params", "workflows")
        for file in (ROOT / folder).glob("*.toml")
    }
    assert modules | inputs | {"knitlab/py.typed"} <= set(installed)


def test_the_wheel_holds_the_page_of_the_explorer(installed):
    page = {file.relative_to(ROOT).as_posix() for file in (PACKAGE / "explorer" / "page").iterdir()}
    assert {"knitlab/explorer/page/main.js", "knitlab/explorer/page/page.html"} <= page
    assert page <= set(installed)
