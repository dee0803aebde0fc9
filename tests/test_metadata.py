"""The files that services read agree with pyproject.toml."""

import json
import tomllib
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[1]


def parsed(name):
    text = (ROOT / name).read_text(encoding="utf-8")
    return json.loads(text) if name.endswith(".json") else yaml.safe_load(text)


def test_what_services_read_agrees_with_the_project():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    authors = project["authors"]
    zenodo, citation = parsed(".zenodo.json"), parsed("CITATION.cff")
    for each in (zenodo, citation):
        assert each["title"] == project["name"]
        assert (each["version"], each["license"]) == (project["version"], project["license"])
        assert each["keywords"] == project["keywords"]
    assert zenodo["description"] == project["description"]
    assert zenodo["creators"] == citation["authors"] == authors

    manual, ci = parsed(".readthedocs.yaml"), parsed(".github/workflows/ci.yml")
    (install,) = manual["python"]["install"]
    assert set(install["extra_requirements"]) <= set(project["optional-dependencies"])
    assert (ROOT / manual["sphinx"]["configuration"]).is_file()
    (job,) = ci["jobs"].values()
    least = project["requires-python"].removeprefix(">=")
    assert least in job["strategy"]["matrix"]["python"]
    assert (ROOT / job["steps"][-1]["run"]).is_file()
