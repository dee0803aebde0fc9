"""What other systems refuse or lack, as far as Linux can show it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PREVIEW = ROOT / "results/reference/preview"
SAMPLE = ROOT / "workflows/laboratory/synthetic_4_16.toml"


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="plays the other systems")
def test_commands_work_without_what_other_systems_lack(tmp_path):
    console = {"PYTHONIOENCODING": "cp1252", "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    done = subprocess.run(
        [
            *(sys.executable, "-X", "warn_default_encoding", "-m", "tests.other_systems"),
            *(tmp_path / "naïve ε", PREVIEW, SAMPLE),
        ],
        cwd=ROOT,
        env=os.environ | console,
        capture_output=True,
        check=False,
    )
    said = done.stderr.decode("cp1252").splitlines()
    assert done.returncode == 2, done.stderr
    assert b"-0.4661" in done.stdout
    assert ["ipctk" in said[-1], "contact = none" in said[-1]] == [True, True]
    assert not [line for line in said if line.startswith(f"{ROOT}/knitlab/")]  # warnings
