"""Public functions are reached by their names, although packages have the same."""

import importlib

import pytest

import knitlab as kl


@pytest.mark.parametrize("name", ["claims", "design", "export"])
def test_a_package_does_not_hide_the_function_of_its_name(name):
    importlib.import_module(f"knitlab.{name}")
    assert callable(getattr(kl, name))
