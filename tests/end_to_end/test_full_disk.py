"""A full disk is one sentence, and harms no file."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from knitlab.io.shipped import PACKAGE

ROOT = PACKAGE.parent


def on_a_full_disk(disk, contents, left, words):
    """Run a command where a small disk holds a copy of a folder, and some KiB are left.

    Returns what it said, and the names of all files of the disk but the file that fills it.
    """
    namespace = ["unshare", "--user", "--map-root-user", "--mount", "bash", "-c"]
    mounting = f"mount -t tmpfs -o size=8m tmpfs {disk}"
    if not shutil.which("unshare") or subprocess.run([*namespace, mounting]).returncode:
        pytest.skip("this machine lets nobody mount a small disk of his own")
    script = f"""{mounting} && cp -r {contents} {disk}/preview && cd {disk}
        free=$(df -k --output=avail . | tail -1)
        head -c $(((free - {left}) * 1024)) /dev/zero > fill
        {sys.executable} -m knitlab {words} >&2; code=$?; find . -type f; exit $code"""
    done = subprocess.run(
        [*namespace, script],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )
    return done, sorted({Path(line).name for line in done.stdout.splitlines()} - {"fill"})


@pytest.mark.slow
def test_a_figure_for_which_the_disk_is_full_is_a_sentence(tmp_path):
    cubes = tmp_path / "cubes"
    cubes.mkdir()
    shutil.copy(ROOT / "results/reference/periodic/cube.nc", cubes)
    disk = tmp_path / "disk"
    disk.mkdir()
    done, left = on_a_full_disk(disk, cubes, 8, "map auxetic preview -o map.png")
    assert done.returncode == 2, done.stderr
    (line,) = done.stderr.splitlines()
    assert line.startswith("knitlab: map.png: cannot be written")
    assert left == ["cube.nc"]
