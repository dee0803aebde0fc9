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
SCRIPT = "from knitlab.cli import main\nmain()\n"
CATCHING = """
try:
    import knitlab
except KeyboardInterrupt:
    print("caught")
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


@pytest.mark.parametrize("started", ["module", "script"])
def test_ctrl_c_while_the_command_line_is_imported_is_one_line(tmp_path, path, started):
    script = tmp_path / "knitlab"
    script.write_text(SCRIPT)
    words = ["-m", "knitlab"] if started == "module" else [str(script)]
    done = said([*words, "--help"], PYTHONPATH=path)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "Interrupted.\n")


def test_ctrl_c_while_a_program_imports_knitlab_is_its_own(tmp_path, path):
    program = tmp_path / "program.py"
    program.write_text(CATCHING)
    done = said([str(program)], PYTHONPATH=path)
    assert (done.returncode, done.stdout, done.stderr) == (0, "caught\n", "")


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["a file", "below a file", "read-only"])
def test_a_cache_of_the_user_that_cannot_be_written_is_one_warning(tmp_path, kind):
    folder = tmp_path / "chosen"
    if kind == "read-only":
        folder.mkdir(mode=0o500)
        if os.access(folder, os.W_OK):
            pytest.skip("this user may write into read-only folders")
    else:
        folder.touch()
    named = str(folder / "compiled" if kind == "below a file" else folder)
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


@pytest.mark.slow
def test_a_program_with_such_a_cache_is_warned_and_computes(tmp_path):
    (tmp_path / "chosen").touch()
    program = "import knitlab as kl; kl.simulate(kl.Design(4, 8, boundary='periodic'), [0])"
    done = said(["-c", program], JAX_COMPILATION_CACHE_DIR=str(tmp_path / "chosen"))
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("cannot be written, and nothing compiled is kept") == 1


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
@pytest.mark.parametrize("suffix", ["pdf", "png", "svg"])
def test_a_figure_for_which_the_disk_is_full_is_a_sentence(tmp_path, suffix):
    cubes = tmp_path / "cubes"
    cubes.mkdir()
    shutil.copy(ROOT / "results/reference/periodic/cube.nc", cubes)
    disk = tmp_path / "disk"
    disk.mkdir()
    done, left = on_a_full_disk(disk, cubes, 8, f"map auxetic preview -o map.{suffix}")
    assert done.returncode == 2, done.stderr
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"knitlab: map.{suffix}: cannot be written (no space left on device)")
    assert left == ["cube.nc"]


@pytest.mark.slow
@pytest.mark.nightly
def test_a_run_that_has_no_space_for_its_figures_is_a_sentence_and_keeps_its_cube(tmp_path):
    designs = "--set n_stripe=2 --set n_subunit=8 --set strain_max=0.03 --set robustness=0"
    words = f"run preview {designs} --workers 0 --results"
    first = said(["-m", "knitlab", *words.split(), str(tmp_path / "first")])
    assert first.returncode == 0, first.stderr
    results, disk = tmp_path / "first" / "preview", tmp_path / "disk"
    disk.mkdir()
    shutil.rmtree(results / "figures")
    before = {file.name for file in results.rglob("*") if file.is_file()}
    cube = (results / "cube.nc").stat().st_size
    # The cube is written beside the one that it replaces.
    done, left = on_a_full_disk(disk, results, 0, f"{words} .")
    assert (done.returncode, set(left)) == (2, before), done.stderr
    done, left = on_a_full_disk(disk, results, 24 + cube // 1024, f"{words} .")
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    path, problem = done.stderr.splitlines()[-1].removeprefix("knitlab: ").split(": ")
    assert problem.startswith("cannot be written (no space left on device); free some space")
    assert Path(path).parent.name == "figures"
    assert Path(path).name not in left  # nor a part of it under its temporary folder
    assert before <= set(left)
