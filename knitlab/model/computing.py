"""JAX as simulations need it: in float64, with compiled programs kept, and left as it was found."""

import logging
import os
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import cache

import jax
from jax.experimental.compilation_cache import compilation_cache

from knitlab.io.errors import MachineError, Mistake
from knitlab.model.compiled_programs import cache_flags


class _Kept:
    """How many computations run, and what puts the flags of the process back after the last."""

    lock = threading.Lock()
    count = 0
    flags = ExitStack()


@contextmanager
def computing() -> Iterator[None]:
    """Set JAX to float64, and to keep compiled programs, while a context or a function runs.

    Flags that the user has set are put back. Those of precision are of the calling thread; those of
    kept programs and of messages are of the process, until the last computation ends.

    Raises:
        MachineError: if JAX cannot be used here, whatever the design.
    """
    with ExitStack() as stack:
        for flag in (
            jax.enable_x64(True),
            jax.numpy_dtype_promotion("standard"),
            jax.numpy_rank_promotion("allow"),
            jax.transfer_guard("allow"),
            jax.debug_nans(False),
            jax.debug_infs(False),
            jax.disable_jit(False),
        ):
            stack.enter_context(flag)
        stack.enter_context(_process_flags())
        _check_platform(os.environ.get("XLA_FLAGS", ""))
        yield


@contextmanager
def _process_flags() -> Iterator[None]:
    with _Kept.lock:
        if _Kept.count == 0:
            _Kept.flags.enter_context(_programs_kept())
            _Kept.flags.enter_context(_silent())
        _Kept.count += 1
    try:
        yield
    finally:
        with _Kept.lock:
            _Kept.count -= 1
            if _Kept.count == 0:
                _Kept.flags.close()


@contextmanager
def _programs_kept() -> Iterator[None]:
    flags = cache_flags()
    before = {name: getattr(jax.config, name) for name in flags}
    _update(flags)
    yield
    _update(before)


def _update(flags: Mapping[str, object]) -> None:
    for name, value in flags.items():
        jax.config.update(name, value)
    if flags:
        compilation_cache.reset_cache()  # JAX reads these flags only when it opens its cache


@contextmanager
def _silent() -> Iterator[None]:
    """No messages of JAX and XLA: what goes wrong is raised as an error anyway.

    On some processors XLA writes two long lines about every kept program (jax#38445).
    """
    flag = "jax_logging_level"
    before = getattr(jax.config, flag)
    levels = {logger: logger.level for logger in map(logging.getLogger, ("jax", "jaxlib"))}
    jax.config.update(flag, "CRITICAL")
    yield
    jax.config.update(flag, "WARNING")  # NOTSET would leave XLA's as it is
    jax.config.update(flag, before)
    for logger, level in levels.items():
        logger.setLevel(level)


@cache
def _check_platform(xla_flags: str) -> None:
    """MachineError if JAX has no device, or would end the process."""
    if xla_flags:
        # XLA ends a process with flags that it does not know.
        program = [sys.executable, "-c", "import jax; jax.devices()"]
        tried = subprocess.run(program, capture_output=True, encoding="utf-8", errors="replace")
        if tried.returncode:
            reason = tried.stderr.strip().rpartition("\n")[2]
            message = f"is not accepted by XLA ({reason}); correct or unset it"
            raise MachineError([Mistake(f"XLA_FLAGS {xla_flags}", message)])
    try:
        jax.devices()
    except Exception as error:  # of many types
        platforms = os.environ.get("JAX_PLATFORMS", "default")
        reason = str(error) or type(error).__name__
        message = f"cannot be used ({reason}); unset JAX_PLATFORMS, or install what it names"
        raise MachineError([Mistake(f"JAX's platform {platforms}", message)]) from error
