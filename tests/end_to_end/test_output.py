"""Output that nobody reads stops no work."""

import subprocess
import sys

import pytest


@pytest.mark.skipif(sys.platform == "win32", reason="pipes by bash")
def test_a_reader_that_takes_one_line_ends_no_command_with_an_error():
    command = f"{sys.executable} -m knitlab query --list results/reference/periodic"
    piped = ["bash", "-c", f"set -o pipefail; {command} | head -1"]
    done = subprocess.run(piped, timeout=240, capture_output=True)
    assert done.returncode == 0, done.stderr
    assert b"Traceback" not in done.stderr
