"""The places that CONTRIBUTING.md names exist, are documented, and are on the way that it says."""

import inspect
import re
from importlib import import_module
from pathlib import Path

import pytest

from benchmarks.calls import calls_to_a_factorisation

TEXT = (Path(__file__).parents[1] / "CONTRIBUTING.md").read_text(encoding="utf-8")
PLACES = re.findall(r"^\| [^|]+ \| `(knitlab(?:\.\w+)+)` \|$", TEXT, flags=re.MULTILINE)


def test_all_places_are_read():
    assert len(PLACES) >= 10


@pytest.mark.parametrize("place", PLACES)
def test_a_place_is_a_documented_function_defined_there(place):
    module, name = place.rsplit(".", 1)
    function = getattr(import_module(module), name)
    assert inspect.isfunction(function)
    assert function.__module__ == module
    assert inspect.getdoc(function)


def test_a_run_passes_the_places_on_its_way_to_a_factorisation():
    passed = {
        f"knitlab.{file.removesuffix('.py').replace('/', '.')}.{function}"
        for file, function in calls_to_a_factorisation()
    }
    way = "sweep.run.run_plan", "simulation.simulate.simulate_batch"
    way += "equilibrium.tensile_test.stretch", "equilibrium.equilibrium.find_equilibrium"
    assert {f"knitlab.{place}" for place in way} <= passed & set(PLACES)
