"""The installed wheel: only the package, with its input files, and it runs without the checkout."""

import email
import json
import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from knitlab.io.shipped import PACKAGE

pytestmark = pytest.mark.slow
ROOT = PACKAGE.parent
PIP = (sys.executable, "-m", "pip")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Path of a wheel of the checkout, built without a network."""
    folder = tmp_path_factory.mktemp("wheel")
    options = ("--no-deps", "--no-build-isolation", "-w", str(folder))
    subprocess.run([*PIP, "wheel", *options, str(ROOT)], check=True, capture_output=True)
    (built,) = folder.glob("*.whl")
    return built


def test_the_wheel_holds_one_package_with_its_inputs_and_pages(wheel):
    installed = set(zipfile.ZipFile(wheel).namelist())
    tops = {name.split("/")[0] for name in installed}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"knitlab"}
    files = [*PACKAGE.rglob("*.py"), *(PACKAGE / "figures" / "explorer" / "page").iterdir()]
    inputs = [file for folder in ("params", "workflows") for file in (ROOT / folder).glob("*.toml")]
    assert {file.relative_to(ROOT).as_posix() for file in files} <= installed
    assert {f"knitlab/shipped/{file.relative_to(ROOT).as_posix()}" for file in inputs} <= installed
    assert "knitlab/py.typed" in installed


def test_every_link_of_the_description_leads_to_a_file_of_the_repository(wheel):
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        metadata = email.message_from_bytes(archive.read(name))
    description = str(metadata.get_payload())
    repository = dict(url.split(", ") for url in metadata.get_all("Project-URL", []))["Repository"]
    raw = repository.replace("//github.com", "//raw.githubusercontent.com")
    version = metadata["Version"]
    files = f"(?:{repository}/blob|{raw})/v{version}/"
    links = re.findall(r'(?:\]\(|src=")([^)"]*)', description)
    assert all(link.startswith("https://") for link in links)
    paths = [re.sub(files, "", link).split("#")[0] for link in links if re.match(files, link)]
    assert len(paths) > 40
    assert not [path for path in paths if not (ROOT / path).exists()]


def test_the_installed_wheel_runs_a_workflow_with_its_own_files(wheel, tmp_path):
    site, work = tmp_path / "site", tmp_path / "work"
    work.mkdir()
    options = ("--no-deps", "--no-index", "--target", str(site))
    subprocess.run([*PIP, "install", *options, str(wheel)], check=True, capture_output=True)

    program = "import knitlab, knitlab.cli; print(knitlab.__file__); knitlab.cli.main()"
    settings = ("n_stripe=4", "n_subunit=16", "strain_max=0.03")
    words = ["run", "periodic", *(word for each in settings for word in ("--set", each))]
    said = subprocess.run(
        [sys.executable, "-c", program, *words],
        cwd=work,
        env={**os.environ, "PYTHONPATH": str(site)},
        capture_output=True,
        text=True,
    )
    assert said.returncode == 0, said.stderr
    assert Path(said.stdout.splitlines()[0]).is_relative_to(site)
    assert "1 cases simulated, 0 already there" in said.stdout

    results = work / "results" / "periodic"
    assert (results / "cube.nc").is_file()
    read = [Path(path) for path in json.loads((results / "plan.json").read_text())["inputs"]]
    assert {"periodic.toml", "stripes.toml"} <= {path.name for path in read}
    assert all(path.is_relative_to(site) for path in read)
