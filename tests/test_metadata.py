"""CITATION.cff, .zenodo.json and the addresses on pages agree with pyproject.toml."""

import json
import re
import tomllib
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))


def test_what_services_read_agrees_with_the_project():
    zenodo = json.loads((ROOT / ".zenodo.json").read_text(encoding="utf-8"))
    for each in (zenodo, CITATION):
        for name in ("version", "license", "keywords"):
            assert each[name] == PROJECT[name]
    assert zenodo["creators"] == CITATION["authors"] == PROJECT["authors"]
    (paper,) = CITATION["references"]
    pages = ("README.md", "paper.bib", "results/reference/claims.md")
    for text in (*zenodo["references"], *map(_without_breaks, pages)):
        assert paper["title"] in text


def _without_breaks(page):
    return " ".join((ROOT / page).read_text(encoding="utf-8").split())


def test_every_address_is_that_of_the_project():
    urls = PROJECT["urls"]
    assert CITATION["repository-code"] == urls["Repository"]
    assert CITATION["url"] == urls["Documentation"]
    names = ("*.md", "pyproject.toml", "docs/**/*.md", "CITATION.cff")
    pages = [path.read_text(encoding="utf-8") for name in names for path in ROOT.glob(name)]
    text = "\n".join(pages)
    repositories = re.findall(r"https://github\.com/[\w-]+/knitlab", text)
    sites = re.findall(r"https://[\w-]*\.readthedocs\.io", text)
    assert set(repositories) == {urls["Repository"]}
    assert {site for site in sites if "knitlab" in site} == {urls["Documentation"]}
