"""Compiled programs are kept in the user's cache folder, unless the user says otherwise."""

import os
import subprocess
import sys

import pytest

PROGRAM = """
import jax
import jax.numpy as jnp
from knitlab.model.computing import computing
with computing():
    print(jax.jit(lambda x: jnp.cos(x) @ x)(jnp.arange(8.0)))
"""


def files_after(tmp_path, **environment):
    """Cached programs below a home folder after a program has run, and what it printed."""
    unset = ("JAX_COMPILATION_CACHE_DIR", "JAX_ENABLE_COMPILATION_CACHE")
    kept = {name: text for name, text in os.environ.items() if name not in unset}
    home = {"HOME": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env=kept | home | environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert not done.stderr
    return sorted(tmp_path.rglob("*-cache")), done.stdout


@pytest.mark.slow
def test_a_second_process_compiles_nothing_anew(tmp_path):
    first, printed = files_after(tmp_path)
    assert first
    assert all(path.is_relative_to(tmp_path / "cache" / "knitlab") for path in first)
    times = [path.stat().st_mtime_ns for path in first]
    second, again = files_after(tmp_path)
    assert (second, again) == (first, printed)
    assert times == [path.stat().st_mtime_ns for path in second]


@pytest.mark.slow
def test_a_program_whose_process_was_killed_while_it_wrote_is_compiled_again(tmp_path):
    first, printed = files_after(tmp_path)
    killed, *complete = first
    assert complete
    killed.write_bytes(killed.read_bytes()[:40])
    killed.with_name(f"{killed.name.removesuffix('-cache')}-atime").unlink()
    before = killed.stat().st_size
    second, again = files_after(tmp_path)  # nothing on standard error
    assert (second, again) == (first, printed)
    assert killed.stat().st_size > before


@pytest.mark.parametrize(
    "environment", [{"JAX_ENABLE_COMPILATION_CACHE": "0"}, {"JAX_COMPILATION_CACHE_DIR": "{}/own"}]
)
def test_the_users_own_settings_are_kept(tmp_path, environment):
    chosen = {name: text.format(tmp_path) for name, text in environment.items()}
    files, _ = files_after(tmp_path, **chosen)
    assert not any("knitlab" in str(path.relative_to(tmp_path)) for path in files)


@pytest.mark.slow
def test_programs_of_another_number_of_threads_are_not_used(tmp_path):
    one, printed = files_after(tmp_path, PJRT_NPROC="1")
    both, again = files_after(tmp_path, PJRT_NPROC="2")
    assert again == printed
    assert set(one) < set(both)
    assert len(both) == 2 * len(one)
    third, _ = files_after(tmp_path, PJRT_NPROC="2")
    assert third == both


def test_where_no_folder_can_be_made_programs_are_compiled_every_time(tmp_path):
    (tmp_path / "cache").touch()
    files, printed = files_after(tmp_path)
    assert not files
    assert printed
