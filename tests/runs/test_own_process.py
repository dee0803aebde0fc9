"""What a run with workers does to the process of the user: nothing that stays."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from knitlab.io import lock

ROOT = Path(__file__).parents[2]
SCRIPT = """
import logging, os, sys
from pathlib import Path

print("begins")

def state():
    levels = {name: logging.getLogger(name).level for name in ("distributed", "tornado")}
    names = {name: globals().get(name) for name in ("__file__", "__spec__")}
    return dict(os.environ) | levels | names

from knitlab.runs.run_options import RunOptions
from knitlab.runs.run import run_plan
from tests.runs.fake_simulator import plan_of, simulate

import scipy.io  # a library below it sets a variable of the environment when it is imported

before = state()
done = run_plan(plan_of(), Path("results"), RunOptions(workers=2, simulate=simulate))
after = state()
print(len(done.simulated), {name for name in before | after if before.get(name) != after.get(name)})
"""


@pytest.mark.slow
@pytest.mark.parametrize("piped", [False, True], ids=["script", "standard input"])
def test_a_script_without_guard_runs_once_and_finds_its_process_as_it_was(tmp_path, piped):
    (tmp_path / "analysis.py").write_text(SCRIPT)
    # Those that pytest and its parts set would hide what the run sets.
    environment = {name: os.environ[name] for name in ("PATH", "HOME") if name in os.environ}
    done = subprocess.run(
        [sys.executable, "-" if piped else "analysis.py"],
        input=SCRIPT if piped else None,
        cwd=tmp_path,
        env=environment | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "begins\n40 set()\n"


def test_a_user_without_a_name_is_named_by_number(monkeypatch):
    def unnamed():
        raise KeyError("getpwuid(): uid not found: 12345")

    monkeypatch.setattr(lock.getpass, "getuser", unnamed)
    assert str(os.getuid()) in lock._user()
