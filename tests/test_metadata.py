"""CITATION.cff and .zenodo.json agree with pyproject.toml."""

import json
import tomllib
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[1]


def test_what_services_read_agrees_with_the_project():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    zenodo = json.loads((ROOT / ".zenodo.json").read_text(encoding="utf-8"))
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    for each in (zenodo, citation):
        for name in ("version", "license", "keywords"):
            assert each[name] == project[name]
    assert zenodo["creators"] == citation["authors"] == project["authors"]
