"""The reference of the Python API: all that ``knitlab.__all__`` names, by autodoc."""

import inspect
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import xarray as xr

import knitlab

GRADIENTS = ("knitlab.mechanics.adjoint.Adjoint", "knitlab.capacitance.wedge.wedge_capacitance")
"""Differentiable functions that the guides name and that are not in ``knitlab`` itself."""


def page() -> str:
    """The public names of knitlab, of its namespaces, and what is reached through them."""
    names = [name for name in knitlab.__all__ if not name.startswith("_")]
    spaces = [name for name in names if inspect.ismodule(getattr(knitlab, name))]
    own = [f"knitlab.{name}" for name in names if name not in spaces]
    parts = list(_section("Functions and classes", own))
    for space in spaces:
        module: ModuleType = getattr(knitlab, space)
        parts += _section(f"knitlab.{space}", [f"knitlab.{space}.{its}" for its in _public(module)])
    accessor = xr.Dataset.knitlab
    parts += _section("On an open cube", [f"{accessor.__module__}.{accessor.__qualname__}"])
    parts += _section("Gradients", list(GRADIENTS))
    return "\n".join(parts)


def _public(module: ModuleType) -> list[str]:
    listed: list[str] = getattr(module, "__all__", [])
    return listed or [
        name for name, its in vars(module).items() if name[0] != "_" and inspect.isfunction(its)
    ]


def _section(heading: str, paths: list[str]) -> Iterator[str]:
    yield from (heading, "-" * len(heading), "")
    if len(paths) > 1:
        yield from (
            ".. autosummary::",
            "   :nosignatures:",
            "",
            *(f"   {its}" for its in paths),
            "",
        )
    for path in paths:
        kind, options = _directive(_found(path))
        yield from (f".. {kind}:: {path}", *(f"   {option}" for option in options), "")


def _directive(its: Any) -> tuple[str, tuple[str, ...]]:
    if inspect.isclass(its):
        return "autoclass", (":members:",)
    return ("autofunction" if callable(its) else "autodata"), ()


def _found(path: str) -> Any:
    module, _, name = path.rpartition(".")
    return getattr(__import__(module, fromlist=[name]), name)
