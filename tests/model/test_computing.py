"""JAX while a simulation runs: in float64 whatever the user has set, and put back afterwards."""

import logging
import threading
from contextlib import suppress

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import knitlab as kl
from knitlab.io.errors import MachineError
from knitlab.model import computing as module
from knitlab.model.computing import computing
from knitlab.model.threads import Threads

DESIGN = kl.Design(4, 8, boundary="periodic")
PROCESS_FLAGS = (
    "jax_compilation_cache_dir",
    "jax_compilation_cache_max_size",
    "jax_enable_compilation_cache",
    "jax_logging_level",
)


def relaxed():
    return kl.simulate(DESIGN, [0, 0.03])["position"].values


@pytest.fixture(scope="module")
def usual():
    return relaxed()


@pytest.mark.parametrize(
    "setting",
    [
        pytest.param(lambda: jax.enable_x64(False), id="x64"),
        pytest.param(lambda: jax.numpy_rank_promotion("raise"), id="ranks", marks=pytest.mark.slow),
        pytest.param(
            lambda: jax.numpy_dtype_promotion("strict"), id="types", marks=pytest.mark.slow
        ),
        pytest.param(
            lambda: jax.transfer_guard("disallow"), id="transfers", marks=pytest.mark.slow
        ),
        pytest.param(lambda: jax.debug_nans(True), id="nans", marks=pytest.mark.slow),
    ],
)
def test_no_setting_of_the_user_changes_a_number(setting, usual):
    with setting():
        assert np.array_equal(relaxed(), usual)


def test_settings_are_put_back_after_an_error():
    before = [getattr(jax.config, name) for name in PROCESS_FLAGS]
    with jax.enable_x64(False):
        with suppress(ZeroDivisionError), computing():
            inside = jnp.ones(1).dtype
            raise ZeroDivisionError
        assert inside == jnp.float64
        assert jnp.ones(1).dtype == jnp.float32
    assert [getattr(jax.config, name) for name in PROCESS_FLAGS] == before


def test_the_users_level_of_messages_is_put_back():
    logger = logging.getLogger("jax")
    before = logger.level
    logger.setLevel(logging.INFO)
    try:
        with computing():
            assert logger.level > logging.ERROR
        assert logger.level == logging.INFO
    finally:
        logger.setLevel(before)


def test_every_thread_computes_in_double_precision():
    with jax.enable_x64(False), computing():
        kinds = Threads(2).each(lambda number: jnp.ones(number).dtype, range(1, 9))
    assert set(kinds) == {np.dtype("float64")}


def test_kept_programs_are_a_setting_until_the_last_of_several_computations_ends(monkeypatch):
    flags = {"jax_compilation_cache_max_size": 12345}
    monkeypatch.setattr(module, "cache_flags", lambda: dict(flags))
    before = jax.config.jax_compilation_cache_max_size
    begun, may_end = threading.Event(), threading.Event()

    def first():
        with computing():
            begun.set()
            may_end.wait()

    thread = threading.Thread(target=first)
    thread.start()
    begun.wait()
    with computing():
        assert jax.config.jax_compilation_cache_max_size == 12345
    assert jax.config.jax_compilation_cache_max_size == 12345
    may_end.set()
    thread.join()
    assert jax.config.jax_compilation_cache_max_size == before


def test_flags_that_xla_does_not_accept_are_named_before_anything_is_computed(monkeypatch):
    monkeypatch.setenv("XLA_FLAGS", "--xla_no_such_flag=1")
    with pytest.raises(MachineError) as refused, computing():
        pass
    assert "--xla_no_such_flag=1" in str(refused.value)
    assert "unset" in str(refused.value)


def test_a_platform_that_is_not_there_is_named(monkeypatch):
    def absent():
        raise RuntimeError("Unable to initialize backend 'cuda'")

    monkeypatch.setenv("JAX_PLATFORMS", "cuda")
    monkeypatch.setattr(jax, "devices", absent)
    module._check_platform.cache_clear()
    with pytest.raises(MachineError) as refused, computing():
        pass
    assert "cuda" in str(refused.value)
    assert "JAX_PLATFORMS" in str(refused.value)
