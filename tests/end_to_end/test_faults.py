"""Ctrl-C during imports, a cache that cannot be written, and a full disk are one sentence each."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from knitlab.io.shipped import PACKAGE

ROOT = PACKAGE.parent
INTERRUPTING = """
import os, signal, time
os.kill(os.getpid(), signal.SIGINT)
time.sleep(20)
"""
COMPUTING = """
import click
from knitlab.cli.options import CommandGroup

@click.group(cls=CommandGroup)
def main():
    pass

@main.command()
def compute():
    import jax, knitlab.model
    import jax.numpy as jnp
    print(jax.jit(lambda x: jnp.cos(x) @ x)(jnp.arange(8.0)))

main()
"""


def said(words, **environment):
    def heeding_ctrl_c():
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # tests in the background ignore it

    return subprocess.run(
        [sys.executable, *words],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=120,
        preexec_fn=heeding_ctrl_c,
    )


@pytest.fixture
def path(tmp_path):
    """A search path on which what knitlab imports first gets Ctrl-C while it is imported."""
    (tmp_path / "modules").mkdir()
    (tmp_path / "modules" / "lazy_loader.py").write_text(INTERRUPTING)
    return f"{tmp_path / 'modules'}{os.pathsep}{ROOT}"


def test_ctrl_c_while_the_command_line_is_imported_is_one_line(path):
    done = said(["-m", "knitlab", "--help"], PYTHONPATH=path)
    assert (done.returncode, done.stdout) == (130, "")
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.slow
def test_a_cache_of_the_user_that_cannot_be_written_is_one_warning(tmp_path):
    (tmp_path / "chosen").touch()
    named = str(tmp_path / "chosen" / "compiled")
    own = {"HOME": str(tmp_path / "home"), "XDG_CACHE_HOME": str(tmp_path / "home")}
    own["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
    bad = said(["-c", COMPUTING, "compute"], **own, JAX_COMPILATION_CACHE_DIR=named)
    assert bad.returncode == 0, bad.stderr
    (line,) = bad.stderr.splitlines()
    assert line.startswith(f"knitlab: JAX_COMPILATION_CACHE_DIR {named}: cannot be written")
    assert not list(tmp_path.rglob("*-cache"))
    good = said(
        ["-c", COMPUTING, "compute"], **own, JAX_COMPILATION_CACHE_DIR=str(tmp_path / "new")
    )
    assert (good.stdout, good.stderr) == (bad.stdout, "")
    assert list((tmp_path / "new").glob("*-cache"))


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
