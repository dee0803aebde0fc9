"""The report on a machine: what it finds wrong, and the result that it compares with."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import knitlab as kl
from knitlab.runs import doctor

PREVIEW = Path(__file__).parents[2] / "results/reference/preview"


def reported(**options):
    lines = []
    is_well = kl.doctor(report=lines.append, **options)
    return is_well, "\n".join(lines)


def test_a_sound_machine_has_no_problem(tmp_path):
    is_well, text = reported(results=tmp_path / "new", simulate=False)
    assert is_well, text
    assert not (tmp_path / "new").exists()
    for expected in ("jax ", "xarray ", "cpu", "float64", str(tmp_path).casefold()):
        assert expected in text.casefold()


def test_a_library_out_of_bounds_is_named_with_the_command_that_replaces_it(monkeypatch):
    wanted = ["numpy>=99", "xarray>=2024", "nothing-like-this>=1", "absent>=2; extra == 'design'"]
    monkeypatch.setattr(doctor, "requires", lambda _: wanted)
    is_well, text = reported(simulate=False)
    assert not is_well
    assert 'pip install "numpy >=99" "nothing-like-this >=1"' in " ".join(text.split())
    assert "absent missing" in text


def test_what_cannot_be_used_is_a_problem_and_the_report_goes_on(tmp_path):
    (tmp_path / "file").touch()
    command = [sys.executable, "-m", "knitlab", "doctor", "--no-simulate"]
    command += ["--results", str(tmp_path / "file" / "results")]
    environment = os.environ | {"JAX_PLATFORMS": "cuda"}
    said = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert said.returncode == 1
    assert "JAX_PLATFORMS" in said.stdout
    assert said.stdout.count("PROBLEM") == 2
    assert "another folder" in said.stdout


def test_the_known_result_is_that_of_the_kept_cube():
    cube = kl.open_cube(PREVIEW).sel(n_stripe=4, n_subunit=16)
    for name, values in doctor.KEPT.items():
        assert (cube[name].values[1:3] == values).all()


@pytest.mark.slow
@pytest.mark.nightly
def test_the_simulation_agrees_and_a_wrong_one_would_not(monkeypatch):
    finding = doctor._simulation()
    assert not finding.problem, finding
    wrong = {name: values * 1.01 for name, values in doctor.KEPT.items()}
    monkeypatch.setattr(doctor, "KEPT", wrong)
    assert "JAX" in doctor._simulation().problem
