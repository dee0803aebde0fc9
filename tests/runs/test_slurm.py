"""The script of an array job, run without SLURM by a shell; with SLURM see tests/cluster."""

import subprocess
import sys
from pathlib import Path

import pytest

import knitlab as kl
from knitlab.cli import main
from tests.commands import knitlab
from tests.refusals import refused

SCRIPT = Path("results/periodic/submit.sh")


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A working folder whose name a shell would change, where python prints its arguments."""
    place = tmp_path / "a folder's $name 100%"
    place.mkdir()
    monkeypatch.chdir(place)
    program = tmp_path / "python"
    program.write_text('#!/bin/sh\npwd\nprintf "%s\\n" "$@"\n')
    program.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(program))
    return place


def read(words):
    """The arguments of ``knitlab run`` by their names."""
    return main.commands["run"].make_context("run", [*words]).params


def run_of(folder, part):
    """The arguments with which the script runs a part, in the folder of its submission."""
    said = subprocess.run(
        ["bash", folder / SCRIPT],
        cwd="/",
        env={"SLURM_ARRAY_TASK_ID": str(part)},
        capture_output=True,
        text=True,
        check=True,
    )
    place, *words = said.stdout.splitlines()
    assert place == str(folder)
    assert words[:3] == ["-m", "knitlab", "run"]
    return read(words[3:])


def test_each_part_is_the_run_that_was_submitted(folder):
    options = ["--set", "n_stripe=4, 6", "--set", "strain_max=0.06", "--fail-fast"]
    options += ["--retries", "2", "--case-timeout", "60", "--refresh"]
    done = knitlab("submit", "periodic", "--parts", 3, "--dry-run", *options)
    assert done.exit_code == 0, done.output
    whole = read(["periodic", *options]) | {"workers": 0}
    assert run_of(folder, 2) == whole | {"shard": "2/3"}
    assert run_of(folder, 0) == whole
    assert kl.status("periodic").counts == {"pending": 6}


def test_settings_of_python_reach_the_parts(folder):
    settings = {"n_stripe": [4, 6], "strain_max": 0.06, "hinges": "all", "boundary": "periodic"}
    kl.submit("periodic", parts=2, cores=4, dry_run=True, **settings)
    words = run_of(folder, 1)
    made = kl.plan("periodic", words["settings"])
    assert made.cases == kl.plan("periodic", **settings).cases
    assert words["workers"] == 4


def test_a_part_asks_for_more_than_the_plan_estimates(folder):
    made = kl.plan("paper")
    total = sum(batch.estimated_seconds for batch in made.batches)
    largest = max(batch.estimated_bytes for batch in made.batches)
    asked = kl.submit("paper", parts=2, dry_run=True).asked
    hours, minutes, seconds = map(int, asked["time"].split(":"))
    assert hours * 3600 + minutes * 60 + seconds > total / 2
    assert float(asked["mem"].removesuffix("G")) * 2**30 > largest
    given = kl.submit("paper", parts=2, dry_run=True, sbatch=["mem-per-cpu=8G", "exclusive"]).asked
    assert given.keys() >= {"mem-per-cpu", "exclusive", "time"}
    assert "mem" not in given


def test_what_cannot_be_submitted_is_refused(folder, monkeypatch):
    with refused("parts 11", "10 cases", "fewer"):
        kl.submit("periodic", parts=11)
    with refused("sbatch", "'--mem 3G'", "partition=short"):
        kl.submit("periodic", parts=2, sbatch=["--mem 3G"])
    with refused("retries -1"):
        kl.submit("periodic", parts=2, retries=-1)
    programs = Path("programs").resolve()
    programs.mkdir()
    monkeypatch.setenv("PATH", str(programs))
    with refused("sbatch", "SLURM", "dry run"):
        kl.submit("periodic", parts=2)
    (programs / "sbatch").write_text("#!/bin/sh\necho 'sbatch: error: no account' >&2\nexit 1\n")
    (programs / "sbatch").chmod(0o755)
    with refused("sbatch", "no account"):
        kl.submit("periodic", parts=2)
