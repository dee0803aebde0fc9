"""Output that nobody reads stops no work."""

import subprocess
import sys

import pytest

from knitlab.cubes.cube_file import open_cube

RUN = [
    *(sys.executable, "-m", "knitlab", "run", "preview", "--workers", "1"),
    *("--set", "n_stripe=2", "--set", "n_subunit=8", "--set", "strain_max=0.06"),
    *("--set", "robustness=0"),
]


def shell(command, **named):
    return subprocess.run(["bash", "-c", command], timeout=240, capture_output=True, **named)


def test_a_reader_that_takes_one_line_ends_no_command_with_an_error():
    command = f"{sys.executable} -m knitlab query --list results/reference/periodic"
    done = shell(f"set -o pipefail; {command} | head -1")
    assert done.returncode == 0, done.stderr
    assert b"Traceback" not in done.stderr


@pytest.mark.slow
def test_a_run_writes_its_cube_and_figures_although_nobody_reads_its_output(tmp_path):
    done = shell(f"set -o pipefail; {' '.join(RUN)} --results {tmp_path} 2>&1 | head -1")
    assert done.returncode == 0, done.stderr
    assert (open_cube(tmp_path / "preview")["status"] == 1).all()
    assert (tmp_path / "preview" / "figures" / "auxetic.png").stat().st_size > 0
