"""The folder in which the user has JAX keep compiled programs. Needs no JAX."""

from pathlib import Path

from knitlab.io.atomic_write import can_write_into

VARIABLE = "JAX_COMPILATION_CACHE_DIR"


def cache_problem(named: str) -> str:
    """Why nothing can be kept in a folder; empty if it can, or if it is on no file system."""
    if not named or "://" in named or can_write_into(Path(named)):
        return ""
    return f"{VARIABLE} {named}: cannot be written, so nothing is kept there; name another folder"
