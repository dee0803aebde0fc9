"""The fingerprint changes with the code of every module that can change a number."""

import ast
import os
import shutil

import pytest
import xarray as xr

import knitlab.runs.results_folder as survey_module
from knitlab.io import fingerprint
from knitlab.io.fingerprint import (
    OF_NO_CASE,
    code_fingerprint,
    computing_files,
    fingerprint_of,
)
from knitlab.io.shipped import PACKAGE
from knitlab.observables.schema import Status
from knitlab.runs.results_folder import CaseState, survey
from tests.runs.stand_in import plan_of, write

COMPUTES_NOTHING = {
    "cube/case_file.py": "how files are written",
    "cube/schema.py": "names and units",
    "measure/knit_size.py": "sizes of the cube only, recomputed for every cube",
    "io/errors.py": "messages",
    "io/atomic_write.py": "how files are written",
    "io/fingerprint.py": "this fingerprint, and who computed",
    "io/shipped.py": "where files lie",
    "io/names.py": "paths, made of names",
    "io/text_file.py": "how files are read",
    "__init__.py": "enables float64, without which no test passes",
}
"""Modules that the simulation imports and whose code changes no number, and why."""
OLDER = {
    "even_auxetic",
    "fineness",
    "fineness_stripes",
    "graded",
    "laboratory",
    "options",
    "options_stripes",
    "paper",
    "periodic",
    "preview",
    "relaxation",
    "sensor",
    "sensor_contact",
    "sensor_layouts",
    "sensor_stripes",
    "small_samples",
    "stripes",
}
"""Kept cubes of earlier code (issues 63 and 64). Stripes of own yarns now have springs along their
ridges; fabrics of the paper's stripes are the same to the last digit. Before that, contact in time
changed: it moves ν of samples by at most 0.008."""


def imported(name):
    """Modules of the package that one of them imports, by their path in it."""
    for node in ast.walk(ast.parse((PACKAGE / name).read_text(encoding="utf-8"))):
        names = []
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        for module in names:
            path = "/".join(module.split(".")[1:]) + ".py"
            if module.startswith("knitlab.") and (PACKAGE / path).is_file():
                yield path


def reached_from(name):
    reached, left = set(), [name]
    while left:
        module = left.pop()
        if module not in reached:
            reached.add(module)
            left += imported(module)
    return reached


def test_every_module_of_the_simulation_is_hashed_or_known_to_compute_nothing():
    reached = reached_from("simulation/simulate.py")
    assert len(reached) > 50
    assert reached - COMPUTES_NOTHING.keys() <= set(computing_files(PACKAGE))


def test_modules_that_are_not_hashed_are_not_imported_or_compute_nothing():
    assert all((PACKAGE / name).is_file() for name in OF_NO_CASE)
    reached = reached_from("simulation/simulate.py")
    assert reached & set(OF_NO_CASE) <= COMPUTES_NOTHING.keys()


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("results")
    plan = plan_of(factors=1)
    case = next(iter(plan.cases.values()))
    write(folder, case, Status.ok)
    return folder, {case.case_id: plan.designs[case.case_id]}


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    copied = tmp_path_factory.mktemp("copy") / "knitlab"
    shutil.copytree(PACKAGE, copied)
    return copied


ONE_OF_EVERY_PACKAGE = {name.partition("/")[0]: name for name in computing_files(PACKAGE)}


@pytest.mark.slow
@pytest.mark.parametrize("name", ONE_OF_EVERY_PACKAGE.values())
def test_an_edited_module_makes_results_stale(name, package, results, monkeypatch):
    folder, designs = results
    assert set(survey(designs, folder, {}, check=True).values()) == {CaseState.done}
    module = package / name
    before = module.read_text(encoding="utf-8")
    try:
        module.write_text(f"{before}\nEDITED = True\n", encoding="utf-8")
        edited = fingerprint_of(package)
    finally:
        module.write_text(before, encoding="utf-8")
    monkeypatch.setattr(survey_module, "code_fingerprint", lambda: edited)
    assert set(survey(designs, folder, {}, check=True).values()) == {CaseState.stale_code}


@pytest.mark.parametrize("name", ["cube/query.py", "measure/knit_size.py"])
def test_an_edited_module_that_computes_nothing_leaves_them(name, package):
    (package / name).write_text("EDITED = True\n", encoding="utf-8")
    assert fingerprint_of(package) == code_fingerprint()


@pytest.mark.slow
def test_a_kept_fingerprint_is_used_and_a_damaged_one_computed_again(tmp_path, monkeypatch):
    computed = code_fingerprint()
    monkeypatch.setattr(fingerprint, "user_cache_path", tmp_path.joinpath)

    def again():
        code_fingerprint.cache_clear()
        return code_fingerprint()

    assert again() == computed
    (file,) = (tmp_path / "knitlab" / "fingerprints").iterdir()
    kept = file.read_text()
    other = fingerprint.text_fingerprint(f"other text of the package{'0' * 12}")
    flipped = f"{int(kept[0], 16) ^ 1:x}{kept[1:]}"
    for text in ("", kept[:12], kept[:-1], flipped, "0" * 12, f"{'0' * 12} {other}", "\0", "{}"):
        file.write_text(text)
        assert again() == computed
        assert file.read_text() == kept
    with monkeypatch.context() as patch:
        patch.setattr(fingerprint, "fingerprint_of", None)
        assert again() == computed
    for make in (os.mkfifo, os.mkdir):
        file.unlink()
        make(file)
        assert again() == computed
    code_fingerprint.cache_clear()


def test_kept_cubes_are_of_this_code():
    for path in (PACKAGE.parent / "results" / "reference").glob("*/cube.nc"):
        with xr.open_dataset(path) as cube:
            codes = {*cube["code"].values.ravel().astype(str)} - {""} if "code" in cube else set()
        if path.parent.name not in OLDER:
            assert codes <= {code_fingerprint()}, path.parent.name
