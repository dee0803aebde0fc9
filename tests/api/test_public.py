"""The public surface: what ``dir(knitlab)`` lists, documented, with examples that run."""

import doctest
import importlib
import inspect
import logging

import jax
import pytest

import knitlab
from knitlab.cubes.query import KnitlabAccessor
from knitlab.runs.figure_names import FIGURE_NAMES

PUBLIC = {name: getattr(knitlab, name) for name in knitlab.__all__ if not name.startswith("_")}
DOCUMENTED = PUBLIC | {"cube.knitlab": KnitlabAccessor, "knitlab": knitlab}


def examples() -> list[doctest.DocTest]:
    finder = doctest.DocTestFinder(recurse=True)
    collected = [
        finder.find(public, name, module=inspect.getmodule(public), globs={})
        for name, public in DOCUMENTED.items()
    ]
    return [test for tests in collected for test in tests if test.examples]


def test_dir_lists_what_all_does():
    assert dir(knitlab) == sorted(knitlab.__all__)


@pytest.mark.parametrize("name", PUBLIC)
def test_every_public_name_is_documented(name):
    assert inspect.getdoc(PUBLIC[name])


@pytest.mark.parametrize("name", ["claims", "design", "export"])
def test_a_package_does_not_hide_the_function_of_its_name(name):
    importlib.import_module(f"knitlab.{name}")
    assert callable(getattr(knitlab, name))


LONG = {"calibrate_friction"}  # examples that are run nightly


@pytest.mark.slow
@pytest.mark.parametrize(
    "example",
    [
        pytest.param(each, id=each.name, marks=pytest.mark.nightly if each.name in LONG else ())
        for each in examples()
    ],
)
def test_examples_run_in_double_precision_whatever_jax_is_set_to(
    example, tmp_path, monkeypatch, caplog
):
    monkeypatch.chdir(knitlab.__path__[0] + "/..")
    example.globs = {"folder": tmp_path, "kl": knitlab}
    caplog.set_level(logging.DEBUG, "jax")
    with jax.enable_x64(False), jax.log_compiles():
        failed = doctest.DocTestRunner(verbose=False).run(example).failed
    assert not failed
    assert not [each.getMessage() for each in caplog.records if "float32" in each.getMessage()]


def test_every_figure_has_a_function():
    assert sorted(knitlab.plot.__all__) == sorted(FIGURE_NAMES)
    assert all(inspect.getdoc(getattr(knitlab.plot, name)) for name in knitlab.plot.__all__)
